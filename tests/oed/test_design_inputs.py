"""What a study file asks of a design, in indices of candidates."""

import numpy as np
import pytest

from oed.study.settings.design_settings import DesignChoice, RobustChoice
from oed.study.stages.design_inputs import constraints_of, parameter_samples
from robotmodels import ElasticRobot, InvalidInput, NoEquilibrium, load_robot
from robotmodels.description.robot_file import Fitted

ROBOT = load_robot("manutec_r3")
POSITIONS = np.linspace(-1, 1, 42).reshape(7, 6)


def limits(**keys):
    return constraints_of(DesignChoice.model_validate(keys), ROBOT, POSITIONS)


def test_no_limits_but_the_number_are_none():
    assert limits(experiments=3) is None


@pytest.mark.parametrize("error", [0.0, 1e-13, -4e-7])
def test_mandatory_positions_are_candidates_by_index(error):
    mandatory = (POSITIONS[[4, 1]] + error).tolist()
    assert limits(mandatory=mandatory).mandatory == {4: 1.0, 1: 1.0}


def test_a_mandatory_position_that_is_no_candidate_is_named_beside_the_nearest():
    away = POSITIONS[5] + 1e-3
    message = r"design.mandatory\[1\]: .* the nearest is candidate 5, .* 0.001 away; name it in"
    with pytest.raises(InvalidInput, match=message):
        limits(mandatory=[POSITIONS[0].tolist(), away.tolist()])
    with pytest.raises(InvalidInput, match=r"design.mandatory\[0\]: 2 angles; 6 are needed"):
        limits(mandatory=[[0.0, 1.0]])


def test_ranges_choose_candidates_by_joint():
    joint = ROBOT.motor_joints[0]
    where = {joint: [POSITIONS[1, 0], POSITIONS[3, 0]]}
    chosen = limits(forbidden=[where], groups={"some": {"where": where, "most": 2}})
    assert list(chosen.forbidden) == [1, 2, 3]
    assert list(chosen.groups["some"].members) == [1, 2, 3]
    with pytest.raises(InvalidInput, match=r"forbidden\[0\]: no candidate lies in these ranges"):
        limits(forbidden=[{joint: [2.0, 3.0]}])


@pytest.mark.parametrize("turns", [-1, 1])
def test_whole_turns_of_ranges_and_mandatory_positions_do_not_count(turns):
    joint = ROBOT.motor_joints[0]
    aside = 2 * np.pi * turns
    where = {joint: [POSITIONS[1, 0] + aside, POSITIONS[3, 0] + aside]}
    assert list(limits(forbidden=[where]).forbidden) == [1, 2, 3]
    position = POSITIONS[4] + aside * np.eye(6)[0]
    assert limits(mandatory=[position.tolist()]).mandatory == {4: 1.0}


def test_samples_of_theta_spread_by_name_or_kind_about_the_robot_files_values():
    choice = RobustChoice(std={"stiffness": 0.2}, samples=64)
    samples = parameter_samples(choice, ROBOT, POSITIONS, np.random.default_rng(0))
    logs = np.log(samples / ROBOT.parameters.values)
    springs = np.array([name.endswith("stiffness") for name in ROBOT.parameters.names])
    assert not logs[0].any()
    assert not logs[:, ~springs].any()
    # 63 normal draws: a chi square law of 63 degrees beyond these ends is one in a thousand.
    assert ((logs[1:, springs].std(axis=0) > 0.14) & (logs[1:, springs].std(axis=0) < 0.27)).all()
    unknown = RobustChoice(std={"stifness": 0.2})
    with pytest.raises(InvalidInput, match="std: 'stifness' is no free parameter"):
        parameter_samples(unknown, ROBOT, POSITIONS, np.random.default_rng(0))


def told(**entries):
    return ElasticRobot(ROBOT.file.model_copy(update=entries), ROBOT.folder)


def test_samples_spread_as_the_robot_file_says_of_guesses_and_fits():
    names = ROBOT.parameters.names
    fitted = Fitted(relative_std={names[0]: 0.1, names[1]: 0.2}, correlation=[[], [0.9]])
    robot = told(guessed={names[1]: 3.0, names[2]: 0.5}, fitted=fitted)
    choice = RobustChoice(samples=64)
    draws = [
        parameter_samples(choice, robot, POSITIONS, np.random.default_rng(seed))[1:]
        for seed in range(20)
    ]
    logs = np.log(np.concatenate(draws) / ROBOT.parameters.values)
    covariance = logs[:, :3].T @ logs[:, :3] / len(logs)
    expected = np.array([[0.01, 0.018, 0.0], [0.018, 0.04, 0.0], [0.0, 0.0, 0.25]])
    scale = np.sqrt(np.diag(expected))
    # 1260 draws: a correlation's standard error is 0.028.
    assert np.abs((covariance - expected) / np.outer(scale, scale)).max() < 0.17
    assert not logs[:, 3:].any()
    with pytest.raises(InvalidInput, match=r"prior: .* neither in fitted.* nor in guessed"):
        parameter_samples(choice, ROBOT, POSITIONS, np.random.default_rng(0))


def test_samples_hold_the_robot_up():
    choice = RobustChoice(std={"stiffness": 5.0}, samples=64)
    samples = parameter_samples(choice, ROBOT, POSITIONS, np.random.default_rng(0))
    for theta in samples:
        ROBOT.equilibrium(POSITIONS, theta)
    softest = ROBOT.parameters.values * np.exp(-4 * 5.0)
    with pytest.raises(NoEquilibrium):
        ROBOT.equilibrium(POSITIONS, softest)


def test_a_robot_that_hardly_stands_is_told(monkeypatch):
    def weak(*_):
        raise NoEquilibrium("spring 'd1' gives way")

    monkeypatch.setattr(ElasticRobot, "equilibrium", weak)
    with pytest.raises(InvalidInput, match=r"60 draws gave 0 samples .*'d1' gives way; a smaller"):
        parameter_samples(
            RobustChoice(std=0.5, samples=2), ROBOT, POSITIONS, np.random.default_rng(0)
        )
