"""FRFs of runs, and what they say of units and signs of records."""

from dataclasses import replace

import numpy as np
import pytest
from noisy_runs import MODEL, RESPONSE, noisy_runs

from estimators.input_output.run_frf import check_rigid_runs, frf_of_runs
from robotmodels import IdentificationWarning


def test_without_noise_it_is_the_frf_of_the_model() -> None:
    for runs in (2, 5):
        data = noisy_runs(np.random.default_rng(1), runs, 1e-9, 1e-9)
        np.testing.assert_allclose(frf_of_runs(data).response, RESPONSE, rtol=1e-4, atol=1e-7)
    assert frf_of_runs(noisy_runs(np.random.default_rng(1), 1)) is None
    alike = np.repeat(data.inputs[:, :1], 5, axis=1)
    assert frf_of_runs(replace(data, inputs=alike)) is None


@pytest.mark.parametrize("freedom", [np.inf, 12])
def test_variances_are_those_of_the_scatter(freedom: float) -> None:
    """Errors in units of their standard deviations, over 60 sets of five runs."""
    squares = []
    for seed in range(60):
        data = noisy_runs(np.random.default_rng(seed), 5, 0.05, 0.05, freedom)
        estimate = frf_of_runs(data)
        squares.append(np.abs(estimate.response - RESPONSE) ** 2 / estimate.variance)
    factor = 1.0 if np.isinf(freedom) else freedom / (freedom - 1)
    mean = np.mean(squares, axis=(0, 1, 2)) / factor
    np.testing.assert_allclose(mean, 1.0, atol=0.12)


def test_wrong_units_are_told(recwarn: pytest.WarningsRecorder) -> None:
    data = noisy_runs(np.random.default_rng(1), 4, 0.01, 0.01)
    check_rigid_runs(data, MODEL)
    assert not recwarn.list
    with pytest.warns(IdentificationWarning):
        check_rigid_runs(replace(data, outputs=57.3 * data.outputs), MODEL)
    check_rigid_runs(noisy_runs(np.random.default_rng(1), 1), MODEL)  # one run shows no FRF
    assert not recwarn.list
