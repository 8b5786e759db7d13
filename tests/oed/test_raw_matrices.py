"""Every function that takes candidates says what is needed where it gets bare matrices."""

import inspect

import numpy as np
import pytest
from random_candidates import information_set, random_set

import oed
from robotmodels import InvalidInput

RAW = random_set(0, 10, 3, 2).matrices
POINTS, OMEGA, RNG = np.zeros((2, 1)), np.ones(2), np.random.default_rng(0)
CALLS = {
    "optimal_design": lambda: oed.optimal_design(RAW),
    "fastest_design": lambda: oed.fastest_design(RAW, 1.0, 0.1),
    "exact_design": lambda: oed.exact_design(RAW, 4),
    "best_plans": lambda: oed.best_plans(RAW, 4),
    "score": lambda: oed.score(RAW, [0, 1, 2]),
    "next_experiments": lambda: oed.next_experiments(RAW, 3),
    "experiment_curve": lambda: oed.experiment_curve(RAW, [3, 4]),
    "experiments_needed": lambda: oed.experiments_needed(RAW, 0.1),
    "measured_information": lambda: oed.measured_information(RAW, np.ones(10)),
    "refined_design": lambda: oed.refined_over(RAW, None, POINTS),
    "compare_plans": lambda: oed.compare_plans(None, RAW, POINTS, {}, OMEGA, None, rng=RNG),
}


@pytest.mark.parametrize("name", CALLS)
def test_bare_matrices(name):
    said = r"info: an array of shape \(10, 3, 3\); an InformationSet is needed.*names\)"
    with pytest.raises(InvalidInput, match=said):
        CALLS[name]()


def test_every_public_function_of_candidates_is_called_here():
    takes = {
        name
        for name in oed.__all__
        if inspect.isfunction(getattr(oed, name))
        and "info" in inspect.signature(getattr(oed, name)).parameters
    }
    assert takes - {"refined_over"} <= set(CALLS)


def test_plans_of_visits_take_visits():
    for plan in (oed.visit_plan, oed.fastest_visit_plan):
        with pytest.raises(InvalidInput, match=f"{plan.__name__}: candidates: InformationSet"):
            plan(information_set(RAW), 10.0)


@pytest.mark.parametrize("raw", [None, [[1.0]], "design.h5", {}])
def test_what_is_no_array_either(raw):
    with pytest.raises(InvalidInput, match=f"info: {type(raw).__name__}; an InformationSet"):
        oed.optimal_design(raw)


def test_sets_of_samples_and_of_sensors():
    with pytest.raises(InvalidInput, match=r"samples: set 0: an array of shape \(10, 3, 3\)"):
        oed.robust_design([RAW, RAW])
    sensor = oed.Sensor(RAW, 1.0)
    with pytest.raises(InvalidInput, match="base: an array of shape"):
        oed.optimal_sensors(RAW, {"a": sensor}, 1.0)
    with pytest.raises(InvalidInput, match="sensors: a: information: an array of shape"):
        oed.optimal_sensors(information_set(RAW), {"a": sensor}, 1.0)
