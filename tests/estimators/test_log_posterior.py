"""The sampled function where parameters are more than springs, and outputs more than motors."""

import numpy as np
import pytest

from estimators import covariance, fit, sample_posterior, simulate_frf
from estimators.sampling.convergence import StoppingCriterion
from estimators.sampling.likelihood import Noise
from estimators.sampling.log_posterior import log_posterior
from robotmodels import CoupledChains, ElasticRobot, RelativeNoise, load_robot
from robotmodels.description.robot_file import RobotFile

OMEGA = 2 * np.pi * np.geomspace(0.5, 12, 40)
CHAINS = CoupledChains(
    masses=[[1.0, 2.0]], springs=[[3000.0]], couplings=[[0.0]], dampers=[[4.0]], extra=("m1", "m2")
)


@pytest.fixture(scope="module")
def chains_fit():
    estimate = simulate_frf(
        CHAINS, np.zeros((1, 0)), OMEGA, RelativeNoise(0.02, 0.002), np.random.default_rng(3)
    )
    return fit(CHAINS, estimate, residual="nls", weights="optimal")


def test_free_masses_widen_the_posterior_as_theorem_1_says(chains_fit):
    posterior = sample_posterior(
        chains_fit,
        rng=np.random.default_rng(0),
        ensembles=2,
        walkers=10,
        thin=2,
        target=StoppingCriterion(ess=400),
    )
    ratio = covariance(chains_fit).std / posterior.uncertainty().std
    assert chains_fit.parameters.names == ("K1", "c1", "m1", "m2")
    np.testing.assert_allclose(ratio, 1, atol=0.2)


def test_moving_a_mass_costs_what_the_fit_says(chains_fit):
    target = log_posterior(chains_fit, Noise())
    moved = chains_fit.parameters.values * np.array([1, 1, 1.05, 1])
    refit = fit(
        CHAINS, chains_fit.estimate, "nls", "optimal", start=moved, max_evaluations=1
    )  # one evaluation: the cost at its start
    values = target.costs(np.array([chains_fit.parameters.values, moved]))
    assert values[0] == pytest.approx(chains_fit.cost, rel=1e-9)
    assert values[1] > values[0] + 1
    assert refit.cost <= values[1] * (1 + 1e-9)


@pytest.mark.parametrize(("residual", "weights"), [("nls", "optimal"), ("lls_magnitude", "user")])
def test_accelerometers_inertias_and_delay_are_part_of_the_cost(residual, weights):
    content = load_robot("ur10").file.model_dump(by_alias=True)
    content["accelerometers"] = [
        {"name": "elbow", "link": "forearm_link", "at": (0, 0, 0.2), "direction": (1, 0, 0)}
    ]
    content["delay"] = 1e-4
    content["parameters"]["extra"] = ["m2.inertia", "payload.mass"]
    robot = ElasticRobot(RobotFile.model_validate(content))
    positions = np.array([[0.3, -1.0, 0.8, -0.4, 0.9, 0.2]])
    omega = 2 * np.pi * np.geomspace(2, 80, 12)
    estimate = simulate_frf(
        robot, positions, omega, RelativeNoise(0.03, 0.01), np.random.default_rng(0)
    )
    start = fit(robot, estimate, residual, weights, max_evaluations=1)
    target = log_posterior(start, Noise())  # refuses if its cost is not the fit's own
    heavier = start.parameters.values.copy()
    heavier[start.parameters.index("payload.mass")] *= 1.2
    assert target.costs(heavier[None])[0] > 1.01 * target.costs(start.parameters.values[None])[0]


def test_a_skeleton_that_cannot_be_costs_infinitely_much(chains_fit):
    target = log_posterior(chains_fit, Noise())
    assert target(np.log(target.network.parameters.values)[None] + 30)[0] == -np.inf
