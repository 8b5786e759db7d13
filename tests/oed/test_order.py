from itertools import pairwise, permutations

import numpy as np
import pytest

from oed import MoveLimits, move, visiting_order
from oed.experiment.moves import move_times
from robotmodels import InvalidInput

LIMITS = MoveLimits(("a", "b"), [[-3, 3], [-3, 3]], [1.0, 2.0], [2.0, 5.0])


def duration(order, positions, start=None, back=False):
    """Return the time of the moves by the formula of a quintic's peaks, one by one."""
    stops = [] if start is None else [np.asarray(start, dtype=float)]
    stops += [positions[i] for i in order]
    if back:
        stops.append(stops[0])
    total = 0.0
    for one, other in pairwise(stops):
        away = np.abs(other - one)
        slow = 15 / 8 * away / LIMITS.speed
        late = np.sqrt(10 / np.sqrt(3) * away / LIMITS.acceleration)
        total += max(slow.max(), late.max())
    return total


@pytest.mark.parametrize(
    ("start", "back"), [(None, False), ((0.5, 0.5), False), ((1.0, -2.0), True)]
)
@pytest.mark.parametrize("n", [1, 2, 6])
def test_against_every_order(n, start, back):
    positions = np.random.default_rng(n).uniform(-3, 3, (n, 2))
    found = visiting_order(positions, LIMITS, start, back=back)
    best = min(duration(order, positions, start, back) for order in permutations(range(n)))
    assert found.optimal
    assert found.duration == pytest.approx(best)
    assert found.duration == pytest.approx(duration(found.order, positions, start, back))
    assert found.unordered_duration == pytest.approx(duration(range(n), positions, start, back))
    assert sorted(found.order) == list(range(n))


@pytest.mark.parametrize("n", [5, 14])
def test_moves_that_are_not_free_are_avoided(n):
    """A wall at a = 0 that only the highest positions on both sides see across."""
    rng = np.random.default_rng(n)
    positions = rng.uniform(-3, 1.9, (n, 2))
    positions[:2] = [[-1.0, 2.5], [1.0, 2.5]]

    def free(at, goals):
        above = (at[1] > 2) & (goals[:, 1] > 2)
        return above | (at[0] * goals[:, 0] > 0)

    start = np.array([-2.0, -2.0])
    found = visiting_order(positions, LIMITS, start, free=free)
    stops = [start, *positions[found.order]]
    assert all(free(one, other[None])[0] for one, other in pairwise(stops))
    assert found.duration == pytest.approx(duration(found.order, positions, start))
    if n == 5:
        ways = [
            duration(order, positions, start)
            for order in permutations(range(n))
            if all(
                free(one, other[None])[0]
                for one, other in pairwise([start, *positions[list(order)]])
            )
        ]
        assert found.duration == pytest.approx(min(ways))


def test_many_positions_on_a_line_are_visited_along_it():
    positions = np.zeros((20, 2))
    positions[:, 0] = np.random.default_rng(0).permutation(np.linspace(-3, 3, 20))
    found = visiting_order(positions, LIMITS, start=(-3.0, 0.0))
    assert not found.optimal
    np.testing.assert_allclose(positions[found.order, 0], np.linspace(-3, 3, 20))


def least_duration(positions):
    """Return the duration of the best order, by dynamic programming over sets of positions."""
    n = len(positions)
    times = [[duration((i, j), positions) for j in range(n)] for i in range(n)]
    best = {(1 << i, i): 0.0 for i in range(n)}
    for visited in range(1, 1 << n):
        for i in range(n):
            if (here := best.get((visited, i))) is None:
                continue
            for j in range(n):
                if not visited >> j & 1:
                    key = (visited | 1 << j, j)
                    best[key] = min(best.get(key, np.inf), here + times[i][j])
    return min(best[(1 << n) - 1, i] for i in range(n))


def test_beyond_twelve_it_comes_close_to_the_best():
    for seed in range(2):
        positions = np.random.default_rng(seed).uniform(-3, 3, (13, 2))
        found = visiting_order(positions, LIMITS)
        assert not found.optimal
        assert 1 - 1e-9 <= found.duration / least_duration(positions) < 1.05
    drawn = np.random.default_rng(9).uniform(-3, 3, (30, 2))
    found = visiting_order(drawn, LIMITS)
    assert found.duration < 0.7 * found.unordered_duration


def test_move_times_are_those_of_moves():
    positions = np.random.default_rng(2).uniform(-3, 3, (4, 2))
    times = move_times(positions, positions, LIMITS)
    for i in range(4):
        for j in range(4):
            walked = move(positions[i], positions[j], LIMITS, 1e-3).duration
            assert times[i, j] <= walked + 1e-12
            assert walked <= times[i, j] + 1e-3


def test_bad_input():
    with pytest.raises(InvalidInput, match="position 0: motor 'a' at 4 is outside"):
        visiting_order(np.array([[4.0, 0.0]]), LIMITS)
    with pytest.raises(InvalidInput, match="start: the robot cannot go back"):
        visiting_order(np.zeros((2, 2)), LIMITS, back=True)
    with pytest.raises(InvalidInput, match="positions: shape"):
        visiting_order(np.empty((0, 2)), LIMITS)
