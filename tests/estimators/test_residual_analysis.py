import numpy as np
import pytest
from mass_springs import OMEGA, POSITIONS, MassSprings
from scipy.stats import chi2, kstest
from test_frf_estimate import full_covariance
from test_least_squares import MODEL, exact, noisy

from estimators import FrfEstimate, fit, multistart, residual_analysis, simulate_frf
from robotmodels import InvalidInput, RelativeNoise, SolverFailed, frequency_response


def of(response, covariance):
    return FrfEstimate(POSITIONS, OMEGA, response, covariance, np.ones(3, dtype=int))


@pytest.mark.parametrize("residual", ["nls", "lls", "lls_magnitude"])
def test_where_all_is_noise_the_tests_are_passed_as_often_as_they_say(residual):
    rng = np.random.default_rng(0)
    found = [
        residual_analysis(
            fit(
                MODEL,
                simulate_frf(MODEL, POSITIONS, OMEGA, RelativeNoise(0.02, 0.005), rng),
                residual,
                "optimal",
                tolerance=1e-7,
            )
        )
        for _ in range(30)
    ]
    assert kstest([one.p_value for one in found], "uniform").pvalue > 1e-3
    assert kstest([one.whiteness_p_value for one in found], "uniform").pvalue > 1e-3
    assert sum(one.outlying.size > 0 for one in found) <= 2
    within = 4 * np.sqrt(2 / found[0].dof[0] / len(found))
    assert np.isclose(np.mean([one.ratio for one in found]), 1, atol=within)
    data = (1 if residual == "lls_magnitude" else 2) * 3 * 23 * 4
    assert found[0].dof == (pytest.approx(data - 6, rel=1e-3), np.inf)


def test_the_ratio_is_that_of_twice_the_cost_for_optimal_weights():
    found = fit(MODEL, noisy(), "nls", "optimal")
    analysis = residual_analysis(found)
    data = 2 * 3 * 23 * 4
    assert np.isclose(analysis.ratio, 2 * found.cost / (data - 6))
    assert np.isclose(analysis.p_value, chi2.sf(2 * found.cost, data - 6), rtol=2e-3)
    assert "times what noise explains" in str(analysis)
    assert "outlying positions (counted from 0): none" in str(analysis)


def test_correlated_elements_count_as_fewer():
    covariance = 1e-4 * full_covariance((3, 23, 2, 2))
    rng = np.random.default_rng(3)
    root = np.linalg.cholesky(covariance)
    z = rng.standard_normal((2, 3, 23, 4, 1))
    errors = (root @ (z[0] + 1j * z[1]))[..., 0] / np.sqrt(2)
    response = frequency_response(MODEL, POSITIONS, OMEGA)
    estimate = of(response + np.swapaxes(errors.reshape(3, 23, 2, 2), -1, -2), covariance)
    for weights in ("optimal", "optimal_diagonal"):
        analysis = residual_analysis(fit(MODEL, estimate, "nls", weights))
        # Correlated elements are fewer independent data.
        assert analysis.dof[0] < 0.9 * 2 * 3 * 23 * 4
        assert analysis.p_value > 1e-3


def test_an_outlying_position_is_named():
    estimate = noisy()
    covariance = np.array(estimate.covariance)
    covariance[1] /= 9  # stated three times too sure of itself
    analysis = residual_analysis(fit(MODEL, of(estimate.response, covariance), "nls", "user"))
    assert analysis.outlying.tolist() == [1]
    assert "counted from 0): 1" in str(analysis)
    assert analysis.p_value < 1e-6


def test_a_wrong_model_leaves_residuals_that_are_not_white():
    class Heavier(MassSprings):
        def network(self, positions, parameters=None):
            from robotmodels import SpringNetwork

            network = super().network(positions, parameters)
            mass = network.mass.copy()
            mass[:, 2, 2] *= 1.1
            return SpringNetwork(**vars(network) | {"mass": mass})

    estimate = noisy()
    right, wrong = (
        residual_analysis(fit(model, estimate, "lls", "optimal")) for model in (MODEL, Heavier())
    )
    assert right.whiteness_p_value > 1e-3
    assert wrong.whiteness_p_value < 1e-6
    assert wrong.autocorrelation[0] > 0.3
    assert (wrong.position_autocorrelation > 0.1).all()
    assert wrong.ratio > 1.5


def test_elements_without_weight_are_left_out():
    weights = np.ones((3, 23, 2, 2))
    weights[:, :, 0, 1] = 0
    weights[:, :5] = 0
    analysis = residual_analysis(fit(MODEL, noisy(), "lls", weights))
    assert np.isnan(analysis.by_element[0, 1])
    # Weights that are not the noise's leave the sum of squares more scatter.
    assert 0.8 * (2 * 3 * 18 * 3) < analysis.dof[0] < 2 * 3 * 18 * 3


def test_what_cannot_be_analysed_is_refused():
    found = fit(MODEL, noisy())
    for lags in (0, 23):
        with pytest.raises(InvalidInput, match=f"lags: {lags} for 23 frequencies"):
            residual_analysis(found, lags)
    weights = np.zeros((3, 23, 2, 2))
    weights[0, :3, 0, 0] = 1
    exactly = fit(MODEL, exact(), "lls", weights)
    with pytest.raises(InvalidInput, match="6 data for 6 parameters leave none"):
        residual_analysis(exactly)
    (failed,) = multistart(MassSprings(weakest=1e3), exact(), [MODEL.parameters.values])
    with pytest.raises(SolverFailed, match="no residuals without a fit"):
        residual_analysis(failed)
