"""A linear model fitted to a robot whose gears harden: the verdict must notice."""

import numpy as np
import pytest

from estimators import FrfExperiment, cross_check, fit, importance_sample, monte_carlo
from robotmodels import RelativeNoise, load_robot

POSITIONS = np.array(
    [
        [0.0, 0.2, -0.6, 0.0, 0.5, 0.0],
        [0.6, 0.9, 0.3, 0.8, -0.7, 0.4],
        [-0.8, -0.3, 0.9, -0.5, 0.9, -0.6],
        [0.3, 1.2, -1.1, 1.1, 0.2, 0.9],
    ]
)
OMEGA = 2 * np.pi * np.geomspace(3, 80, 24)
NOISE = RelativeNoise(0.01, 0.003)


@pytest.fixture(scope="module")
def linear():
    return load_robot("manutec_r3_26")


def judged(robot, linear, seed=0):
    data = FrfExperiment(robot, POSITIONS, OMEGA, NOISE)(np.random.default_rng(seed))
    found = fit(linear, data, "nls", "optimal")
    return cross_check(
        found,
        importance=importance_sample(found, rng=np.random.default_rng(1), draws=4000),
    )


def test_hardening_gears_are_flagged_and_linear_ones_are_not(linear):
    wrong = judged(load_robot("manutec_r3_hardening"), linear)
    assert set(wrong.verdicts) == {"model error"}
    assert set(judged(linear, linear).verdicts) == {"trustworthy"}


@pytest.mark.slow
def test_which_method_still_covers_under_hardening(linear):
    """A gear of one stiffness stands for springs between low and high: intervals should hold it."""
    experiment = FrfExperiment(load_robot("manutec_r3_hardening"), POSITIONS, OMEGA, NOISE)
    truth = np.full(len(linear.parameters), np.nan)
    outer = [i for i, name in enumerate(linear.parameters.names) if name.startswith("b")]
    truth[outer] = linear.parameters.values[outer]  # torsions are the same in both
    found = monte_carlo(
        experiment,
        linear,
        rng=np.random.default_rng(0),
        runs=50,
        truth=truth,
        methods=("theorem1", "scaled", "empirical"),
    )
    assert found.overall("theorem1") < 0.9
    assert found.overall("empirical") > found.overall("theorem1")
