from types import SimpleNamespace

import numpy as np
import pytest

from oed import candidate_positions, sobol_positions
from robotmodels import InvalidInput

LIMITS = np.array([[-1.0, 3.0], [0.0, 2.0], [-0.5, 0.5]])
ARM = SimpleNamespace(motor_joints=("base", "elbow", "wrist"), position_limits=LIMITS)


def arm(n):
    return SimpleNamespace(
        motor_joints=tuple(f"j{i}" for i in range(n)), position_limits=np.tile([-1.0, 1.0], (n, 1))
    )


def test_grid_reaches_both_limits_and_the_last_joint_runs_fastest():
    grid = candidate_positions(ARM, (1, 2, 3))
    expected = [[1, a, b] for a in (0, 2) for b in (-0.5, 0, 0.5)]
    np.testing.assert_allclose(grid, expected)


@pytest.mark.parametrize(("n", "count"), [(1, 1), (2, 6), (3, 36), (4, 144), (6, 2304), (7, 9216)])
def test_usual_grid(n, count):
    assert candidate_positions(arm(n)).shape == (count, n)


def test_one_number_serves_all_joints():
    assert len(candidate_positions(ARM, 3)) == 27


def test_joints_not_named_stay_in_the_middle():
    grid = candidate_positions(ARM, {"elbow": 5})
    np.testing.assert_allclose(grid[:, [0, 2]], np.tile([1.0, 0.0], (5, 1)))


def test_limits_narrow_the_range():
    grid = candidate_positions(ARM, 2, limits={"wrist": (0.1, 0.2)})
    assert set(grid[:, 2]) == {0.1, 0.2}
    assert set(grid[:, 0]) == {-1.0, 3.0}
    narrow = 0.5 * LIMITS
    np.testing.assert_allclose(candidate_positions(ARM, 2, limits=narrow).min(axis=0), narrow[:, 0])


def test_a_range_of_one_value_holds_a_joint():
    assert set(candidate_positions(ARM, 1, limits={"wrist": (0.3, 0.3)})[:, 2]) == {0.3}


def test_joint_without_limits_needs_a_range():
    endless = SimpleNamespace(motor_joints=("j",), position_limits=np.array([[-np.inf, np.inf]]))
    with pytest.raises(InvalidInput, match=r"joint 'j': \[-inf, inf\] is not a finite range"):
        candidate_positions(endless)
    assert candidate_positions(endless, 2, limits=[(-1, 1)]).ravel().tolist() == [-1, 1]


@pytest.mark.parametrize(
    ("per_joint", "limits", "message"),
    [
        ((1, 0, 2), None, "per_joint of joint 'elbow': 0; a whole number >= 1"),
        ((1, 2.5, 2), None, "joint 'elbow': 2.5"),
        ({"wrist": True}, None, "joint 'wrist': True"),
        ((1, 2), None, "per_joint: 2 numbers for 3 joints"),
        ({"wirst": 2}, None, r"'wirst' is not a driven joint \(did you mean 'wrist'\?\)"),
        (2, {"elbow": (0.0, 2.5)}, r"joint 'elbow': \[0, 2.5\] reaches outside .* \[0, 2\]"),
        (2, {"elbow": (1.0, 0.5)}, "joint 'elbow': low 1 is above high 0.5"),
        (2, {"elbow": (1.0, 1.0)}, "joint 'elbow': low and high are both 1"),
        (2, {"elbow": (1.0,)}, "joint 'elbow': .* is not a pair"),
        (2, {"ellbow": (1.0, 2.0)}, "limits: 'ellbow' is not a driven joint"),
        (2, [(0.0, 1.0)], "limits: 1 ranges for 3 joints"),
    ],
)
def test_errors_name_the_joint(per_joint, limits, message):
    with pytest.raises(InvalidInput, match=message):
        candidate_positions(ARM, per_joint, limits)


def test_sobol_points_halve_every_range_evenly():
    """Any power of two of scrambled points has equally many in each dyadic half of each axis."""
    for rng in (None, np.random.default_rng(4)):
        points = sobol_positions(ARM, 64 if rng is not None else 63, rng=rng)
        low, high = LIMITS.T
        assert ((points >= low) & (points <= high)).all()
        below = (points < (low + high) / 2).sum(axis=0)
        # The plain sequence leaves out its first point, a corner.
        np.testing.assert_array_equal(below, 32 if rng is not None else 31)


def test_sobol_points_of_any_number_and_narrowed():
    points = sobol_positions(ARM, 5, limits={"elbow": (1.0, 1.0)})
    assert points.shape == (5, 3)
    np.testing.assert_array_equal(points[:, 1], 1.0)
    assert len(np.unique(points[:, 0])) == 5


@pytest.mark.parametrize("count", [0, -1, 2.5, True])
def test_number_of_sobol_points(count):
    with pytest.raises(InvalidInput, match=r"sobol: points: .*; a whole number >= 1"):
        sobol_positions(ARM, count)
