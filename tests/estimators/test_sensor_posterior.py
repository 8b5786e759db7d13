"""Posterior and profiles of a six-motor robot with encoders behind gears and torque sensors."""

from pathlib import Path

import numpy as np
import pytest
from noisy_runs import NoisySystem

import robotmodels
from estimators import covariance, fit, profile_likelihood, sample_posterior
from estimators.sampling.convergence import StoppingCriterion
from estimators.sampling.log_posterior import posterior_density
from robotmodels import ElasticRobot
from robotmodels.description.robot_file import RobotFile, read_robot_file

LIBRARY = Path(robotmodels.__file__).parent / "library"
OUTPUTS = [
    *({"motor": f"m{i}", "quantity": "angle"} for i in range(1, 7)),
    *({"joint": f"joint{i}", "quantity": "angle"} for i in range(1, 4)),
    *({"spring": f"g{i}", "quantity": "torque"} for i in range(1, 4)),
]


@pytest.fixture(scope="module")
def fitted():
    """A fit to one run in each of two positions, twelve outputs of six motors."""
    content = read_robot_file(LIBRARY / "manutec_r3.yaml").model_dump(
        by_alias=True, exclude_unset=True
    )
    robot = ElasticRobot(RobotFile.model_validate(content | {"outputs": OUTPUTS}), LIBRARY)
    rng = np.random.default_rng(1)
    omega = 2 * np.pi * np.linspace(4.0, 60.0, 40)
    system = NoisySystem(robot, rng.uniform(-0.6, 0.6, (2, 6)), omega)
    return fit(robot, system.runs(rng, 1, 0.2), weights="joint")


def test_the_density_is_compiled_and_that_of_numpy(fitted):
    density = posterior_density(fitted)
    assert density.kernel is not None
    steps = 0.02 * np.cos(np.arange(12)).reshape(2, 6)
    values = fitted.parameters.values * np.exp(steps)
    by_numpy = -density.line_log_likelihood(values).sum(axis=(1, 2))
    np.testing.assert_allclose(density.noise.scale * density.costs(values), by_numpy, rtol=1e-9)


@pytest.mark.slow
def test_posterior_and_profiles_agree_with_the_covariance(fitted):
    theorem1 = covariance(fitted)
    target = StoppingCriterion(r_hat=1.05, ess=600)
    posterior = sample_posterior(fitted, rng=np.random.default_rng(2), walkers=24, target=target)
    profiled = [one.std for one in profile_likelihood(fitted)]
    np.testing.assert_allclose(profiled, theorem1.std, rtol=0.15)
    ratios = np.log(posterior.uncertainty().std / theorem1.std)
    assert np.exp(ratios.mean()) == pytest.approx(1.0, abs=0.15)
