from pathlib import Path

import numpy as np
import pytest

import robotmodels
from oed.study.settings.candidates_settings import CandidatesChoice
from oed.study.stages.candidates import gather, refusals

LIMITS = {"shoulder_lift_joint": [-2.5, 0.5], "elbow_joint": [-2.5, 2.5]}


@pytest.fixture(scope="module")
def robot():
    return robotmodels.load_robot(Path(__file__).parents[1] / "engines" / "two_joints.yaml")


@pytest.fixture(scope="module")
def settings():
    return CandidatesChoice(
        per_joint={"shoulder_lift_joint": 9, "elbow_joint": 9}, limits=LIMITS, floor=0.0
    )


def test_every_refused_position_has_its_reasons(robot, settings):
    screened = gather(settings, robot)
    refused, why = refusals(settings, robot, screened, most=1000)
    assert len(refused) == len(why) == screened.proposed - len(screened) > 10
    assert all(why)
    assert any("floor" in words for words in why)
    both = np.vstack([screened.positions, refused])
    assert len(np.unique(both, axis=0)) == screened.proposed


def test_of_many_some_are_chosen_evenly(robot, settings):
    screened = gather(settings, robot)
    every, _ = refusals(settings, robot, screened, most=1000)
    some, why = refusals(settings, robot, screened, most=5)
    step = -(-len(every) // 5)
    np.testing.assert_array_equal(some, every[::step])
    assert len(why) == len(some) <= 5


def test_where_nothing_is_refused_there_is_nothing(robot):
    free = CandidatesChoice(
        per_joint={"shoulder_lift_joint": 2, "elbow_joint": 2},
        limits={"shoulder_lift_joint": [-1.7, -1.4], "elbow_joint": [-0.2, 0.2]},
    )
    refused, why = refusals(free, robot, gather(free, robot))
    assert refused.shape == (0, 2)
    assert why == []
