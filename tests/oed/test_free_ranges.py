import numpy as np
from collision_arm import arm

from oed import Workcell
from oed.candidates.free_ranges import free_margin, free_ranges
from oed.candidates.screening import usable
from robotmodels import Plane


def share(robot, ranges, cell):
    low, high = np.asarray(ranges).T
    drawn = np.random.default_rng(7).uniform(low, high, (500, len(low)))
    return usable(robot, drawn, cell.surroundings(robot)).mean()


def test_ranges_narrow_until_most_positions_are_free(tmp_path):
    robot = arm(tmp_path)
    ranges = np.array([[-3.0, 3.0], [-2.0, 2.0], [-0.5, 0.5]])
    # A wall on one side of an arm that turns in a plane.
    cell = Workcell(obstacles=[Plane("wall", (-1, 0, 0), -0.1)], self_collision=False)
    before = share(robot, ranges, cell)
    found = free_ranges(robot, ranges, cell)
    assert before < 0.5
    assert share(robot, found, cell) > 0.55
    assert (found[:, 0] >= ranges[:, 0]).all()
    assert (found[:, 1] <= ranges[:, 1]).all()
    assert (found[:, 1] - found[:, 0] > 0.2 * (ranges[:, 1] - ranges[:, 0])).all()


def test_ranges_stay_where_all_or_nothing_is_free(tmp_path):
    robot = arm(tmp_path)
    ranges = np.array([[-1.0, 1.0], [0.3, 0.3], [-0.5, 0.5]])
    assert np.array_equal(free_ranges(robot, ranges, Workcell(self_collision=False)), ranges)
    buried = Workcell(obstacles=[Plane("wall", (0, 0, 1), 9.0)])
    assert np.array_equal(free_ranges(robot, ranges, buried), ranges)


def test_a_margin_that_links_never_keep_is_not_taken(tmp_path):
    robot = arm(tmp_path)
    ranges = np.array([[-1.0, 1.0], [-0.5, 0.5], [-0.5, 0.5]])
    assert free_margin(robot, ranges, Workcell(), (0.02, 0.01)) == 0.02
    assert free_margin(robot, ranges, Workcell(), (0.5, 0.01)) == 0.01
    assert free_margin(robot, ranges, Workcell(), (0.5, 0.49)) == 0.0
