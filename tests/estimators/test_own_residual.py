"""A residual of somebody else: the difference of dynamic stiffnesses, 1/measured - 1/G."""

from dataclasses import dataclass

import numpy as np
import pytest
from derivatives import by_logarithms
from mass_springs import OMEGA, POSITIONS, MassSprings
from scipy.optimize import least_squares

from estimators import covariance, fit, optimal_weights, read_fits, simulate_frf, write_fits
from estimators.fitting.residuals import find_residual
from robotmodels import InvalidInput, RelativeNoise, frequency_response, kernel, sensitivity

MODEL = MassSprings()
TRUTH = MODEL.parameters.values


@dataclass(frozen=True)
class DynamicStiffness:
    name: str = "dynamic_stiffness"
    relative: bool = True
    real: bool = False

    def difference(self, measured, modelled):
        return 1 / measured - 1 / modelled

    def slope(self, modelled):
        return -1 / modelled**2


@pytest.fixture(scope="module")
def estimate():
    noise = RelativeNoise(0.03, 0.01)
    return simulate_frf(MODEL, POSITIONS, OMEGA, noise, np.random.default_rng(3))


def test_derivative_against_central_differences(estimate):
    kind = find_residual(DynamicStiffness())
    slopes = kind.jacobian(*sensitivity(MODEL, POSITIONS, OMEGA))
    differences = by_logarithms(
        lambda at: kind.error(estimate.response, frequency_response(MODEL, POSITIONS, OMEGA, at)),
        TRUTH,
    )
    size = np.abs(differences).max(axis=(0, 1, 2, 3))
    assert np.abs((slopes - differences) / size).max() < 1e-7


def test_a_fit_against_another_search(estimate):
    one = fit(MODEL, estimate, DynamicStiffness(), "optimal", start=TRUTH * 1.2)
    assert one.converged
    assert one.residual == "dynamic_stiffness"
    root = np.sqrt(one.weights)

    def residuals(x):
        G = frequency_response(MODEL, POSITIONS, OMEGA, np.exp(x))
        error = (root * (1 / estimate.response - 1 / G)).ravel()
        return np.concatenate([error.real, error.imag])

    other = least_squares(residuals, np.log(TRUTH), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    np.testing.assert_allclose(np.log(one.parameters.values), other.x, atol=1e-6)
    assert one.cost == pytest.approx(2 * other.cost, rel=1e-8)
    assert len(one.intervals()) == 6


def test_weighted_by_the_noise_the_information_is_that_of_any_other_residual(estimate):
    """Psi^T Lambda^-1 Psi does not depend on the function that both pass through."""
    G = frequency_response(MODEL, POSITIONS, OMEGA)
    std = []
    for residual in ("nls", DynamicStiffness()):
        weights = optimal_weights(estimate, residual, G)
        at = fit(MODEL, estimate, residual, weights, bounds=(1 - 1e-9, 1 + 1e-9))
        std.append(np.sqrt(np.diag(covariance(at).covariance)))
    np.testing.assert_allclose(*std, rtol=1e-6)


def test_the_kernel_evaluates_it_without_compiled_code():
    network = MODEL.network(POSITIONS)
    measured = 1.1 * network.frequency_response(OMEGA)
    weights, h = np.abs(measured) ** 2, 1e-6
    cost = kernel.CostKernel(network, OMEGA, measured, weights, DynamicStiffness())
    expected = np.sum(weights * np.abs((1 / 1.1 - 1) * 1.1 / measured) ** 2)
    assert cost(TRUTH)[0] == pytest.approx(expected)
    steps = np.exp(h * np.eye(6))
    slope = (cost(TRUTH * steps) - cost(TRUTH / steps)) / (2 * h)
    np.testing.assert_allclose(cost.normal_equations(TRUTH).gradient, slope, rtol=1e-5)


def test_what_is_no_residual_and_what_a_file_cannot_name(estimate, tmp_path):
    with pytest.raises(InvalidInput, match="residual 3 is neither a name nor a `ResidualForm`"):
        fit(MODEL, estimate, 3)
    write_fits(tmp_path / "fits.h5", [fit(MODEL, estimate, DynamicStiffness())])
    with pytest.raises(InvalidInput, match="residual 'dynamic_stiffness' is unknown"):
        read_fits(tmp_path / "fits.h5", MODEL, estimate)
