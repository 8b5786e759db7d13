"""The choice of springs from data: the right ones, none too many, twins as groups."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import robotmodels
from estimators import choose_structure, covariance, fit, score_tests, simulate_frf, structure_power
from estimators.frf.frf_estimate import exact_frf
from estimators.structure import refits
from robotmodels import InvalidInput, RelativeNoise
from robotmodels.elastic.possible_springs import possible_springs, with_springs

OMEGA = 2 * np.pi * np.linspace(4, 60, 12)
NOISE = RelativeNoise(0.03, 0.01)
ROBOT = robotmodels.load_robot("manutec_r3")
LOW, HIGH = np.clip(ROBOT.position_limits, -1.5, 1.5).T
POSITIONS = np.random.default_rng(7).uniform(LOW, HIGH, (2, len(LOW)))
SPRINGS = [s for s in possible_springs(ROBOT) if s.joint in ("joint1", "joint2", "joint3")]


def _spring(name, stiffness, time=1e-3):
    spring = next(spring for spring in SPRINGS if spring.name == name)
    return spring.model_copy(update={"stiffness": stiffness, "damping": time * stiffness})


HIDDEN = [_spring("joint2 z", 2e6), _spring("joint1 x", 3e6, 4e-3)]


@pytest.fixture(name="base", scope="module")
def _base():
    truth = with_springs(ROBOT, HIDDEN, free=True)
    estimate = simulate_frf(truth, POSITIONS, OMEGA, NOISE, np.random.default_rng(1))
    return fit(ROBOT, estimate, "nls", "optimal")


@pytest.fixture(name="choice", scope="module")
def _choice(base):
    return choose_structure(base, SPRINGS)


def test_hidden_springs_are_chosen_with_their_values(choice, base):
    assert {spring.name for spring in choice.springs} == {spring.name for spring in HIDDEN}
    std = dict(zip(choice.fit.parameters.names, covariance(choice.fit).std, strict=True))
    for hidden, entry in product(HIDDEN, ("stiffness", "damping")):
        chosen = next(spring for spring in choice.springs if spring.name == hidden.name)
        error = np.log(getattr(chosen, entry) / getattr(hidden, entry))
        assert abs(error) < 5 * std[f"{hidden.name}.{entry}"] < 2
    assert choice.fit.cost == pytest.approx(base.estimate.response.size, rel=0.1)
    assert choice.bic[1] < choice.bic[0]
    assert "2 springs added" in str(choice)
    assert choice.contradicted == ()
    # Each step lowered the cost about as much as its score test said.
    for step in choice.steps:
        assert step.fall >= 0.5 * step.expected
    assert choice.fit.robot().file.springs[-1].name in {spring.name for spring in HIDDEN}


def test_nothing_is_added_to_a_right_model():
    estimate = simulate_frf(ROBOT, POSITIONS, OMEGA, NOISE, np.random.default_rng(5))
    choice = choose_structure(fit(ROBOT, estimate, "nls", "optimal"), SPRINGS, level=1e-3)
    assert choice.springs == ()
    assert choice.steps == ()
    assert choice.stopped.startswith("no score test")
    assert choice.contradicted == ()
    assert choice.caution == ""


def test_a_wrong_payload_is_named_beside_springs_that_stand_in_for_it():
    heavy = ROBOT.file.payload.model_copy(update={"mass": 1.3 * ROBOT.file.payload.mass})
    truth = type(ROBOT)(ROBOT.file.model_copy(update={"payload": heavy}), ROBOT.folder)
    estimate = simulate_frf(truth, POSITIONS, OMEGA, NOISE, np.random.default_rng(2))
    choice = choose_structure(fit(ROBOT, estimate, "nls", "optimal"), SPRINGS, most=1)
    assert choice.contradicted[0] == "payload.mass"
    assert choice.caution.startswith("the data contradict payload.mass")
    assert choice.caution in str(choice)


def test_a_refit_that_ends_far_from_what_is_expected_is_not_accepted(base, monkeypatch):
    worse = refits._search

    def stuck(single, robot, new):
        end = worse(single, robot, new)
        return end if new is None else _costlier(end, single.cost)

    monkeypatch.setattr(refits, "_search", stuck)
    choice = choose_structure(base, HIDDEN, damping_times=[1e-3])
    assert choice.springs == ()
    assert "no refit lowers the cost" in choice.stopped


def _costlier(end, cost):
    return replace(end, cost=cost + 9575.0)


def test_a_spring_that_stands_in_for_others_is_exchanged_or_dropped(base):
    # The first choice is a wrong one on purpose: a spring that only stands in for the hidden ones.
    from estimators.structure.choose_structure import _Choice

    decoy = next(s for s in score_tests(base, SPRINGS, numbers=False) if s.name == "joint3 y")
    runs = refits.Refits(ROBOT, (*HIDDEN, decoy.spring), (1e-3,))
    single = runs.refit(base, [], decoy)
    work = _Choice(runs, 0.01, single, [decoy.spring])
    for _ in range(3):
        if work.add():
            break
        work.improve()
    assert {spring.name for spring in work.added} == {spring.name for spring in HIDDEN}
    assert {step.action for step in work.steps} & {"exchange", "drop"}


def test_power_says_what_is_seen_and_what_is_not(base):
    strong, weak = _spring("joint2 z", 2e6), _spring("joint3 y", 1e12)
    power = structure_power(base, [strong], SPRINGS)[0]
    assert power.right_place > 0.99
    assert power.detection >= power.right_place
    assert "shows with probability" in str(power)
    assert structure_power(base, [weak], SPRINGS)[0].detection < 0.05


@pytest.mark.slow
def test_predicted_detection_is_that_of_simulated_fits():
    spring = _spring("joint2 z", 6e6)
    truth = with_springs(ROBOT, [spring], free=True)
    response = robotmodels.frequency_response(truth, POSITIONS, OMEGA)
    rng, level, hits = np.random.default_rng(3), 0.01, []
    for _ in range(100):
        single = fit(
            ROBOT, exact_frf(response, POSITIONS, OMEGA, NOISE).with_errors(rng), "nls", "optimal"
        )
        table = score_tests(single, SPRINGS, numbers=False)
        hits.append("joint2 z" in {s.name for s in table.significant(level)})
    power = structure_power(single, [spring], SPRINGS, level=level)[0]
    assert 0.1 < power.detection < 0.95
    assert np.mean(hits) == pytest.approx(power.detection, abs=0.17)


def test_a_level_that_is_none_is_refused(base):
    with pytest.raises(InvalidInput, match="level 2"):
        choose_structure(base, SPRINGS, level=2.0)
    with pytest.raises(InvalidInput, match="most"):
        choose_structure(base, SPRINGS, most=-1)
