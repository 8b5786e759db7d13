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
    data = (1 if residual == "lls_magnitude" else 2) * 3 * 23 * 4
    assert found[0].dof == data - 6
    assert np.isclose(found[0].position_dof.sum(), found[0].dof)
    assert np.isclose(found[0].element_dof.sum(), found[0].dof)
    assert np.isclose(found[0].position_chi2.sum(), found[0].chi2)
    assert np.isclose(found[0].element_chi2.sum(), found[0].chi2)
    within = 4 * np.sqrt(2 / found[0].dof / len(found))
    assert np.isclose(np.mean([one.reduced_cost for one in found]), 1, atol=within)


def test_chi_square_is_twice_the_cost_of_optimal_weights():
    found = fit(MODEL, noisy(), "nls", "optimal")
    analysis = residual_analysis(found)
    assert np.isclose(analysis.chi2, 2 * found.cost)
    assert np.isclose(analysis.p_value, chi2.sf(2 * found.cost, analysis.dof))
    assert "chi^2" in str(analysis)
    assert "outlying positions (counted from 0): none" in str(analysis)


def test_full_weights_whiten_the_elements_together():
    covariance = 1e-4 * full_covariance((3, 23, 2, 2))
    rng = np.random.default_rng(3)
    root = np.linalg.cholesky(covariance)
    z = rng.standard_normal((2, 3, 23, 4, 1))
    errors = (root @ (z[0] + 1j * z[1]))[..., 0] / np.sqrt(2)
    response = frequency_response(MODEL, POSITIONS, OMEGA)
    estimate = of(response + np.swapaxes(errors.reshape(3, 23, 2, 2), -1, -2), covariance)
    found = fit(MODEL, estimate, "nls", "optimal")
    analysis = residual_analysis(found)
    assert np.isclose(analysis.chi2, 2 * found.cost)
    assert analysis.p_value > 1e-3
    alone = residual_analysis(fit(MODEL, estimate, "nls", "optimal_diagonal"))
    assert np.isclose(alone.element_chi2.sum(), alone.chi2)


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
    assert wrong.reduced_cost > 1.5


def test_elements_without_weight_are_left_out():
    weights = np.ones((3, 23, 2, 2))
    weights[:, :, 0, 1] = 0
    weights[:, :5] = 0
    analysis = residual_analysis(fit(MODEL, noisy(), "lls", weights))
    assert np.isnan(analysis.element_chi2[0, 1])
    assert np.isnan(analysis.element_dof[0, 1])
    assert analysis.dof == 2 * 3 * 18 * 3 - 6
    robust = residual_analysis(fit(MODEL, noisy(), "lls", weights, loss="huber"))
    assert np.isnan(robust.reduced_cost)


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
