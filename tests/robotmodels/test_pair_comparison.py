"""Pairs compared once per combination of angles, against every pair compared in every position."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from collision_arm import arm

from oed import candidate_positions
from robotmodels import Box, Plane, Sphere, load_robot, surroundings
from robotmodels.collision import comparison
from robotmodels.collision.pair_checker import PairChecker
from robotmodels.collision.turntable import Turntable
from robotmodels.common.arrays import distinct_rows
from robotmodels.elastic.rigid_pose import configurations

AROUND = (
    Plane("wall", (-1.0, 0.2, 0.0), -0.9),
    Box("crate", (0.5, 0.4, 0.2), (0.3, 0.3, 0.4), (0.0, 0.0, 0.3)),
    Sphere("ball", (-0.3, -0.5, 0.3), 0.25),
)


@pytest.fixture
def compared(monkeypatch):
    """Return the numbers of configurations in which pairs were compared, call by call."""
    counts = []

    class Counting(PairChecker):
        def __call__(self, configured):
            counts.append(len(configured))
            return super().__call__(configured)

    monkeypatch.setattr(comparison, "PairChecker", Counting)
    return counts


def everywhere(around, positions):
    """Return what each pair does in each position, compared one by one."""
    checker = around._checker
    hits = checker(configurations(around.robot, positions))
    groups = around._groups.values()
    return np.stack([hits[:, group].any(axis=1) for group in groups], axis=1)


@pytest.mark.parametrize(
    ("name", "per_joint"), [("ur10", [4, 4, 4, 3, 3, 2]), ("panda", [3, 3, 3, 3, 3, 3, 2])]
)
@pytest.mark.parametrize("obstacles", [(), AROUND])
def test_a_grid_is_compared_as_its_positions_are(name, per_joint, obstacles, compared):
    robot = load_robot(name)
    around = surroundings(robot, floor=0.05, obstacles=obstacles)
    positions = candidate_positions(robot, per_joint)
    touching = around.touching(positions)
    assert np.array_equal(touching, everywhere(around, positions))
    assert touching.any(axis=0).sum() > 5  # otherwise there is nothing to tell
    if not obstacles:
        assert max(compared) <= len(positions) / per_joint[0]


def test_positions_that_share_no_angle(compared):
    robot = load_robot("ur10")
    around = surroundings(robot, floor=0.0, margin=0.02)
    low, high = robot.position_limits.T
    positions = np.random.default_rng(4).uniform(low, high, (1000, 6))
    seen = []
    touching = around.touching(positions, lambda *done: seen.append(done))
    assert np.array_equal(touching, everywhere(around, positions))
    assert compared[:2] == [1, 1000]  # the shoulder above the floor, and all others at once
    assert seen[-1] == (1000, 1000)


def test_a_first_joint_that_is_not_upright_counts(tmp_path):
    """All joints of the arm turn about y: a floor is not the same at all angles of the first."""
    robot = arm(tmp_path)
    around = surroundings(robot, floor=0.1, obstacles=[Plane("side", (0.0, 1.0, 0.0), -0.04)])
    positions = candidate_positions(robot, [16, 16, 8])
    touching = around.touching(positions)
    assert np.array_equal(touching, everywhere(around, positions))
    shares = dict(zip([str(pair) for pair in around.pairs], touching.mean(axis=0), strict=True))
    assert 0 < shares["'lower' and 'floor'"] < 1
    assert shares["'lower' and 'side'"] == 1  # whose normal is the axis; 5 cm thick


class Travelling(ThreadPoolExecutor):
    """Pickles what it is given, as a pool of processes does."""

    def submit(self, fn, /, *args, **kwargs):
        return super().submit(*pickle.loads(pickle.dumps((fn, *args))), **kwargs)


def test_tasks_of_an_executor(monkeypatch):
    monkeypatch.setattr(comparison, "_TASK", 300)
    robot = load_robot("ur10")
    around = surroundings(robot, floor=0.0, obstacles=AROUND)
    positions = candidate_positions(robot, [2, 5, 5, 4, 3, 2])
    with Travelling(2) as executor:
        touching = around.touching(positions, executor=executor)
    assert np.array_equal(touching, around.touching(positions))


def test_cylinders_enclose_what_they_stand_for():
    around = surroundings(load_robot("ur10"), obstacles=AROUND)
    turntable = Turntable.of(around.robot.rigid)
    np.testing.assert_allclose(turntable.axis, [0, 0, 1], atol=1e-15)
    base, (wall, crate, ball) = around._things[0], around._things[-3:]
    assert turntable.cylinder(wall) is None
    assert not turntable.keeps(wall)
    assert not turntable.keeps(base)
    assert turntable.cylinder(base).hull.radius < 0.15
    for shape, farthest, top in (
        (crate, np.hypot(0.5, 0.4) + np.hypot(0.15, 0.15), 0.4),
        (ball, np.hypot(0.3, 0.5) + 0.25, 0.55),
    ):
        cylinder = turntable.cylinder(shape)
        assert turntable.keeps(cylinder)
        height = cylinder.placement.translation[2] + cylinder.hull.halfLength
        assert farthest - 0.02 < cylinder.hull.radius < 1.2 * farthest
        assert height == pytest.approx(top, abs=2e-4)


def test_distinct_rows():
    rng = np.random.default_rng(2)
    columns = [rng.integers(0, count, 500) for count in (3, 4, 5)]
    first, group = distinct_rows(columns, 500)
    rows = np.stack(columns, axis=1)
    assert len(np.unique(rows, axis=0)) == len(first)
    assert np.array_equal(rows[first][group], rows)
    assert distinct_rows([np.arange(500)], 500) is None
    assert [len(part) for part in distinct_rows([], 500)] == [1, 500]
