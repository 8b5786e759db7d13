"""Noise that plans of further visits reckon with."""

from dataclasses import replace

import numpy as np
import pytest
from noisy_runs import SMALL

from estimators.fitting.least_squares import fit
from estimators.fitting.run_fit import RunFit
from oed.campaign.estimate import noise_of_period


@pytest.mark.parametrize("slope", [0.0, 0.2])
def test_noise_is_parted_into_disturbances_and_sensors(slope: float) -> None:
    """Errors of all positions by one law over other periods; if coloured, their mean size."""
    rng = np.random.default_rng(3)
    q, f, m, n = SMALL.response.shape
    disturbances, sensors = rng.uniform(1, 4, n), rng.uniform(1, 4, m)
    # a sensor's noise after two derivatives, of the size of what disturbances lead to
    growth = (SMALL.omega / SMALL.omega.mean()) ** 4
    variances = [growth[:, None] * sensors, np.tile(disturbances, (f, 1))]
    law = 1e-4 * np.concatenate(variances, 1)[:, :, None] * np.eye(m + n)
    colour = np.linspace(1, 1 + slope, f)[:, None, None]
    periods = np.arange(1.0, q + 1)
    runs = replace(
        SMALL.runs(rng, 3, 0.01, 0.01), covariance=colour * law / periods[:, None, None, None]
    )
    result = fit(SMALL.model, runs)
    assert isinstance(result, RunFit)
    noise = noise_of_period(result, periods)
    if not slope:
        assert noise == pytest.approx(law, rel=1e-2)
    X = np.concatenate([np.broadcast_to(np.eye(m), (q, f, m, m)), -SMALL.response], axis=3)
    errors, right = (X @ C @ np.conj(X.swapaxes(2, 3)) for C in (noise, colour * law))
    ratio = np.einsum("qfii->qf", np.linalg.solve(errors, right)).real / m
    assert ratio == pytest.approx(np.ones((q, f)), rel=0.02 + slope)
    assert np.average(ratio, axis=0, weights=periods) == pytest.approx(np.ones(f), rel=0.02)
