import numpy as np
import pytest

from oed import MoveLimits, move
from robotmodels import InvalidInput

LIMITS = MoveLimits(("a", "b"), np.array([[-2.0, 2.0], [0.0, 1.0]]), [1.0, 0.5], [4.0, 1.0])
T = 1e-3


@pytest.mark.parametrize(
    ("start", "goal"), [((-2, 0), (2, 1)), ((0, 0.2), (0.01, 0.2)), ((1, 1), (1, 0.5))]
)
def test_a_move_respects_every_limit_and_wastes_no_time(start, goal):
    path = move(start, goal, LIMITS, T)
    whole = np.vstack([path.positions, goal])
    np.testing.assert_allclose(whole[0], start)
    low, high = LIMITS.positions.T
    assert ((whole >= low) & (whole <= high)).all()
    # Speeds by finite differences, and at rest at both ends.
    speeds = np.vstack([path.speeds, [0, 0]])
    np.testing.assert_allclose(np.gradient(whole, T, axis=0)[1:-1], speeds[1:-1], atol=1e-3)
    assert not speeds[0].any()
    used_speed = np.abs(speeds).max(axis=0) / LIMITS.speed
    accelerations = np.abs(np.diff(speeds, axis=0)).max(axis=0) / T / LIMITS.acceleration
    used = max(used_speed.max(), accelerations.max())
    assert 0.97 < used <= 1 + 1e-9
    assert path.duration == pytest.approx(len(path) * T)


def test_motors_arrive_together_on_a_straight_line():
    path = move((0, 0), (1, 0.5), LIMITS, T)
    np.testing.assert_allclose(path.positions[:, 1], 0.5 * path.positions[:, 0], atol=1e-15)


def test_no_move_takes_no_time():
    path = move((1, 0.5), (1, 0.5), LIMITS, T)
    assert (len(path), path.duration, path.positions.shape) == (0, 0.0, (0, 2))


@pytest.mark.parametrize(
    ("start", "goal", "message"),
    [
        ((0, 0), (0, 1.1), r"goal 0: motor 'b' at 1.1 is outside its limits \[0, 1\]"),
        ((-3, 0), (0, 1), "start 0: motor 'a' at -3 is outside"),
        ((0, np.nan), (0, 1), "start 0: motor 'b' at nan is outside"),
        ((0,), (0, 1), r"starts: shape \(1, 1\) given; \(Q, 2\) is needed"),
    ],
)
def test_errors_name_the_motor(start, goal, message):
    with pytest.raises(InvalidInput, match=message):
        move(start, goal, LIMITS, T)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"positions": [[0, 1]]}, r"shape \(1, 2\); \(2, 2\) is needed"),
        ({"positions": [[0, 1], [1, 0]]}, r"motor 'b': position limits \[1, 0\]"),
        ({"positions": [[0, np.inf], [0, 1]]}, r"motor 'a': position limits \[0, inf\]"),
        ({"speed": [1, 0]}, "motor 'b': speed of moves: 0 is not a number > 0"),
        ({"speed": [1, 1, 1]}, r"speed of moves: shape \(3,\)"),
        ({"acceleration": np.nan}, "motor 'a': acceleration of moves: nan"),
    ],
)
def test_errors_of_limits(changed, message):
    good = {"motors": ("a", "b"), "positions": [[0, 1], [0, 1]], "speed": 1.0, "acceleration": 1.0}
    MoveLimits(**good)
    with pytest.raises(InvalidInput, match=message):
        MoveLimits(**{**good, **changed})


def test_sample_time_must_be_positive():
    with pytest.raises(InvalidInput, match=r"sample_time \[s\]: 0 is not a number > 0"):
        move((0, 0), (1, 1), LIMITS, 0)
