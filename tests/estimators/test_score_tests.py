"""Score tests of absent springs and wrong numbers: what they name, their level, their sizes."""

from dataclasses import replace

import numpy as np
import pytest
from noisy_runs import NoisySystem
from scipy.stats import norm

import robotmodels
from estimators import choose_structure, fit, score_tests, simulate_frf, structure_power
from estimators.frf.frf_estimate import exact_frf
from estimators.structure.score_table import twins
from estimators.structure.score_tests import effective_number
from robotmodels import CoupledChains, InvalidInput, RelativeNoise, SolverFailed
from robotmodels.elastic.possible_springs import possible_springs, with_springs

OMEGA = 2 * np.pi * np.linspace(4, 60, 25)
NOISE = RelativeNoise(0.03, 0.01)
ROBOT = robotmodels.load_robot("manutec_r3")
LOW, HIGH = np.clip(ROBOT.position_limits, -1.5, 1.5).T
POSITIONS = np.random.default_rng(7).uniform(LOW, HIGH, (3, len(LOW)))
SPRINGS = possible_springs(ROBOT)
TORSION = next(spring for spring in SPRINGS if spring.name == "joint2 z")
SOFT = TORSION.model_copy(update={"stiffness": 2e7, "damping": 2e4})


def _fit(truth, rng):
    return fit(ROBOT, simulate_frf(truth, POSITIONS, OMEGA, NOISE, rng), "nls", "optimal")


@pytest.fixture(name="table", scope="module")
def _table():
    truth = with_springs(ROBOT, [SOFT], free=False)
    return score_tests(_fit(truth, np.random.default_rng(2)), SPRINGS)


def test_the_spring_that_is_missing_has_the_strongest_evidence(table):
    first = table.springs[0]
    assert "joint2 z" in (first.name, *first.twins)
    assert table[0].fall <= 1.5 * first.fall
    score = next(score for score in table.springs if score.name == "joint2 z")
    assert score.probability < 1e-6
    assert score.estimate == pytest.approx(1 / 2e7, abs=4 * score.std + 0.1 / 2e7)
    assert score.spring.stiffness == pytest.approx(1 / score.estimate)
    assert str(table).startswith(f"{len(table)} score tests")
    assert "stiffness" in str(score)


def test_a_robot_that_lacks_nothing_raises_no_alarm():
    table = score_tests(_fit(ROBOT, np.random.default_rng(3)), SPRINGS)
    assert not table.significant(1e-3)
    assert len(table.springs) <= len(SPRINGS)
    names = {score.name for score in table}
    assert {"delay", "gain of m1", "friction behind the gear of joint2"} <= names
    assert "hardening of g2" in names


def test_without_noise_the_size_is_that_of_a_stiff_spring():
    rng = np.random.default_rng(4)
    truth = robotmodels.frequency_response(ROBOT, POSITIONS, OMEGA)
    weak = TORSION.model_copy(update={"stiffness": 2e8, "damping": 2e5})
    bent = robotmodels.frequency_response(with_springs(ROBOT, [weak], free=False), POSITIONS, OMEGA)
    scores = []
    for response in (truth, bent):
        estimate = replace(
            exact_frf(truth, POSITIONS, OMEGA, NOISE).with_errors(rng), response=response
        )
        single = fit(ROBOT, estimate, "nls", "optimal")
        scores.append(score_tests(single, [TORSION], damping_times=[1e-3], numbers=False)[0])
    exact, shifted = scores
    assert abs(exact.ratio) < 1e-3
    assert shifted.estimate == pytest.approx(1 / 2e8, rel=0.05)
    assert shifted.fall == pytest.approx(shifted.ratio**2 / 2, rel=1e-3)


def test_a_payload_on_the_axis_that_turns_it_is_no_test():
    """A mass there changes FRFs by rounding only."""
    robot = robotmodels.load_robot("moberg_axis1")
    spring = next(s for s in possible_springs(robot) if s.name == "arm1 67 % z")
    spring = spring.model_copy(update={"stiffness": 1e6, "damping": 1e3})
    truth = with_springs(robot, [spring], free=False)
    rng = np.random.default_rng(1)
    for positions in ([[0.2], [0.8]], [[0.2 + 1e-13], [0.8 - 1e-13]]):
        data = simulate_frf(truth, np.array(positions), OMEGA, NOISE, rng)
        names = {score.name for score in score_tests(fit(robot, data, "nls", "optimal"))}
        assert "gain of m1" in names
        assert not any(name.startswith("payload") for name in names)


def test_the_law_of_the_largest_z_over_a_curve():
    # Three unit vectors in a plane, 20 degrees apart: the largest projection of normal numbers.
    angles = np.deg2rad([0.0, 20.0, 40.0])
    z = np.random.default_rng(5).standard_normal((200_000, 2))
    fine = np.linspace(angles[0], angles[-1], 40)
    largest = (z @ np.stack([np.cos(fine), np.sin(fine)])).max(axis=1)
    for level in (1.5, 2.0, 2.6):
        law = norm.sf(level) + (angles[-1] - angles[0]) / (2 * np.pi) * np.exp(-(level**2) / 2)
        assert (largest > level).mean() == pytest.approx(law, rel=0.03)
        few = (z @ np.stack([np.cos(angles), np.sin(angles)])).max(axis=1)
        assert (few > level).mean() < law


def test_tests_that_hang_together_count_as_fewer():
    one_sided = np.zeros(8, dtype=bool)
    assert effective_number(np.eye(8), one_sided) == pytest.approx(8, abs=0.6)
    assert effective_number(np.ones((8, 8)), one_sided) == pytest.approx(1, abs=0.4)
    half = np.kron(np.eye(4), np.ones((2, 2)))
    assert effective_number(half, ~one_sided) == pytest.approx(4, abs=0.5)


def test_twins_are_those_that_leave_less_than_noise_decides():
    correlation = np.array([[1.0, 0.95, 0.2], [0.95, 1.0, 0.1], [0.2, 0.1, 1.0]])
    assert twins(correlation, np.array([10.0, 9.5, 0.5]), ["a", "b", "c"]) == [("b",), ("a",), ()]
    assert twins(correlation, np.array([100.0, 95.0, 0.5]), ["a", "b", "c"])[0] == ()


def test_runs_have_score_tests_too():
    stiff = TORSION.model_copy(update={"stiffness": 1e8, "damping": 1e5})
    truth = with_springs(ROBOT, [stiff], free=False)
    system = NoisySystem(truth, POSITIONS, OMEGA)
    data = system.runs(np.random.default_rng(6), 6, 0.02, 0.02)
    table = score_tests(fit(ROBOT, data), SPRINGS[:6], numbers=False)
    score = next(score for score in table if score.name == "joint2 z")
    assert score.probability < 1e-6
    assert score.estimate == pytest.approx(1e-8, abs=4 * score.std + 0.1e-8)
    assert "joint2 z" in (table[0].name, *table[0].twins)


def test_what_is_no_robot_or_no_time_is_refused():
    masses, springs = np.ones((1, 2)), np.full((1, 1), 1e3)
    chains = CoupledChains(masses, springs, np.zeros((1, 1)), np.ones((1, 1)))
    omega = np.linspace(5.0, 80.0, 30)
    estimate = simulate_frf(chains, np.zeros((1, 1)), omega, NOISE, np.random.default_rng(0))
    single = fit(chains, estimate, "nls", "optimal")
    with pytest.raises(InvalidInput, match="a robot of a robot file is needed"):
        score_tests(single)
    with pytest.raises(SolverFailed, match="no score tests without a fit"):
        score_tests(replace(single, cost=np.inf))
    for function in (score_tests, choose_structure, lambda fit: structure_power(fit, [SOFT])):
        with pytest.raises(InvalidInput, match="fit: a ElasticRobot; what"):
            function(ROBOT)
    with pytest.raises(InvalidInput, match="damping_times"):
        score_tests(single, damping_times=[-1.0])


@pytest.mark.slow
def test_the_level_holds_over_400_right_models():
    rng, alarms = np.random.default_rng(8), []
    response = robotmodels.frequency_response(ROBOT, POSITIONS, OMEGA)
    for _ in range(400):
        estimate = exact_frf(response, POSITIONS, OMEGA, NOISE).with_errors(rng)
        table = score_tests(fit(ROBOT, estimate, "nls", "optimal"), SPRINGS)
        alarms.append(bool(table.significant(0.05)))
    assert 0.03 <= np.mean(alarms) <= 0.07
