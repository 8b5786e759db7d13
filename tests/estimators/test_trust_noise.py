"""Variances from neighbouring lines and correlation along lines, against laws and draws."""

import numpy as np
import pytest
from derivatives import circular
from scipy.special import polygamma

from estimators.frf.pooled_noise import pooled_noise
from estimators.trust.line_correlation import (
    _corrections,
    _unbiased,
    autoregressive,
    correlation_of_deviations,
    correlation_of_residuals,
    element_correlation,
)
from estimators.trust.linearised_fit import LinearisedFit

SEEDS = range(3)


def autoregressive_errors(rng, shape, rho):
    """Return errors (Q, R, F, k) of unit variance, correlated along the lines."""
    errors = circular(rng, *shape)
    for f in range(1, shape[2]):
        errors[:, :, f] = rho * errors[:, :, f - 1] + np.sqrt(1 - rho**2) * errors[:, :, f]
    return errors


def linear_fit(residuals, jacobian, variance, deviations=None, nu=np.inf):
    if deviations is not None:
        variance = (np.abs(deviations) ** 2).sum(axis=1)
    p = jacobian.shape[-1]
    return LinearisedFit(
        names=tuple(f"p{i}" for i in range(p)),
        residuals=residuals,
        jacobian=jacobian,
        weights=np.ones(residuals.shape),
        noise_weights=np.ones(residuals.shape),
        covariance=variance,
        deviations=deviations,
        degrees_of_freedom=np.full(len(residuals), nu),
        line_correlation=np.empty(0),
        prior=np.zeros((p, p)),
    )


@pytest.mark.parametrize("nu", [1, 2, 5, 19])
@pytest.mark.parametrize("seed", SEEDS)
def test_logarithms_of_pooled_variances_have_the_right_mean(nu, seed):
    rng = np.random.default_rng(seed)
    true = np.geomspace(1e-3, 1e3, 40)  # a trend that the geometric mean of neighbours keeps
    s2 = true[:, None] * rng.gamma(nu, 1 / nu, (200, 40, 2))
    pooled = pooled_noise(s2, np.full(200, float(nu))).variance
    error = np.log(pooled / true[:, None])[:, 4:-4]
    assert abs(error.mean()) < 5 * np.sqrt(polygamma(1, nu) / 6 / 200 / 6)


def test_the_pooled_variance_is_independent_of_the_line_itself():
    rng = np.random.default_rng(0)
    s2 = rng.gamma(3, 1 / 3, (2, 30, 4))
    other = s2.copy()
    other[0, 10] *= 1.5
    first, second = (pooled_noise(v, np.array([3.0, 3.0])).variance for v in (s2, other))
    np.testing.assert_array_equal(first[0, 10], second[0, 10])
    np.testing.assert_array_equal(first[1], second[1])
    assert (first[0, 9] != second[0, 9]).all()


def test_declared_variances_stay_beside_estimated_ones():
    s2 = np.random.default_rng(0).gamma(3, 1 / 3, (2, 30, 4))
    noise = pooled_noise(s2, np.array([3.0, np.inf]))
    np.testing.assert_array_equal(noise.variance[1], s2[1])
    np.testing.assert_array_equal(noise.mixed[1], s2[1])
    assert (noise.line_share[1] == 0).all()
    assert (noise.variance[0] != s2[0]).any()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_line_has_a_share_of_its_own_where_neighbours_differ(seed):
    rng = np.random.default_rng(seed)
    nu, lines = 19, 60
    smooth, rough = np.ones(lines), np.exp(rng.standard_normal(lines))
    draws = circular(rng, 1, nu, lines, 2) / np.sqrt(nu)
    draws = draws * np.sqrt(np.stack([smooth, rough], axis=-1))
    noise = pooled_noise((np.abs(draws) ** 2).sum(axis=1), np.array([float(nu)]), draws)
    assert noise.line_share[0, 0, 0] < 0.3
    assert noise.line_share[0, 0, 1] > 0.8


@pytest.mark.parametrize("seed", SEEDS)
def test_variances_follow_resonances_of_one_line_by_their_gains(seed):
    rng = np.random.default_rng(seed)
    nu, lines = 12, 120
    gains = np.exp(0.1 * rng.standard_normal((1, lines, 2, 2)))
    gains[:, 15::20] *= rng.uniform(10, 50, (1, 6, 1, 1))
    # Feedback lets noise into a column's torque as its motor answers.
    true = np.broadcast_to(1e-6 * (gains**2).sum(axis=-2, keepdims=True), gains.shape)
    s2 = true * rng.gamma(nu, 1 / nu, true.shape)
    noise = pooled_noise(s2, np.array([float(nu)]), response=gains * (1 + 0j))
    assert np.abs(np.log(noise.variance / true)).max() < 2.0
    # Negative control: neighbours alone miss the peaks by their height.
    alone = pooled_noise(s2, np.array([float(nu)])).variance
    assert np.abs(np.log(alone / true)).max() > 4.0
    # Were errors larger than the gains, they would not weight themselves.
    noisy = 30 * np.sqrt(s2) * circular(rng, *s2.shape)
    buried = pooled_noise(s2 / s2, np.array([float(nu)]), response=noisy)
    np.testing.assert_allclose(buried.variance, buried.variance.mean(), rtol=1e-6)


def test_the_power_of_the_gains_is_independent_of_the_line_itself():
    rng = np.random.default_rng(0)
    gains = np.ones((1, 60, 1, 1), dtype=complex)
    gains[:, [20, 40]] = 30.0
    s2 = 1e-6 * np.abs(gains) ** 2 * rng.gamma(12, 1 / 12, gains.shape)
    other = s2.copy()
    other[0, 20] *= 3.0
    nu = np.array([12.0])
    first, second = (pooled_noise(v, nu, response=gains).variance[0, 20] for v in (s2, other))
    np.testing.assert_allclose(first, second, rtol=1e-3)


@pytest.mark.parametrize(("nu", "share"), [(3, 0.5), (3, 0.75), (19, 1.0), (1, 0.25)])
def test_the_scatter_of_lines_that_weight_themselves_is_enlarged_exactly(nu, share):
    """E[g^-2q] = nu/(nu - 2 q) E[g^(1 - 2 q)], by draws; without the factor it fails."""
    g = np.random.default_rng(1).gamma(nu, 1 / nu, 400_000)
    true, naive = (g ** (-2 * share)).mean(), (g ** (1 - 2 * share)).mean()
    error = (g ** (-2 * share)).std() / np.sqrt(len(g)) / true
    assert abs(naive * nu / (nu - 2 * share) / true - 1) < 6 * error + 0.01
    assert naive < 0.92 * true


@pytest.mark.parametrize("draws", [2, 4, 10, 38])
@pytest.mark.parametrize("rho", [-0.5, 0.3, 0.9])
def test_sample_correlations_are_corrected_for_their_bias(draws, rho):
    rng = np.random.default_rng(2)
    x, y = rng.standard_normal((2, 200_000, draws))
    y = rho * x + np.sqrt(1 - rho**2) * y
    r = (x * y).sum(axis=1) / np.sqrt((x**2).sum(axis=1) * (y**2).sum(axis=1))
    assert _unbiased(np.array([r.mean()]), draws)[0] == pytest.approx(rho, abs=0.006)
    if draws == 2:
        assert abs(r.mean()) < 0.97 * abs(rho)  # negative control: there is a bias


@pytest.mark.parametrize("nu", [1, 3, 19])
@pytest.mark.parametrize("rho", [0.6, 0.9])
def test_the_correlation_of_deviations_is_that_of_the_errors(nu, rho):
    """Also where the variance changes a hundredfold from line to line."""
    estimates = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        scale = np.exp(rng.standard_normal(60))[:, None] * 2
        draws = autoregressive_errors(rng, (2, nu, 60, 3), rho) * scale / np.sqrt(nu)
        fit = linear_fit(np.zeros((2, 60, 3), complex), np.ones((2, 60, 3, 1)), None, draws, nu)
        correlation = correlation_of_deviations(fit)
        assert not correlation.white
        estimates.append(correlation.coefficients[1])
    assert np.mean(estimates) == pytest.approx(rho, abs=0.04)


def test_white_deviations_are_called_white():
    alarms = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        draws = circular(rng, 1, 3, 40, 2)
        fit = linear_fit(np.zeros((1, 40, 2), complex), np.ones((1, 40, 2, 1)), None, draws, 3)
        alarms += not correlation_of_deviations(fit).white
    assert alarms <= 4


def test_autocovariances_are_corrected_as_brute_force_matrices_do():
    rng = np.random.default_rng(4)
    Q, F, k, p, lags = 2, 12, 2, 3, 4
    J = circular(rng, Q, F, k, p)
    fit = linear_fit(circular(rng, Q, F, k), J, np.ones((Q, F, k)))
    B = _corrections(fit, J, fit.rows, np.ones((Q, F, k)), lags)
    # Real numbers: errors (Re e, Im e); the fit takes J Re(A e) away.
    stacked = np.concatenate([J.reshape(-1, p).real, J.reshape(-1, p).imag])
    A = fit.rows.reshape(p, -1)
    P = stacked @ np.concatenate([A.real, -A.imag], axis=1)
    shift = np.eye(Q * F * k).reshape(Q, F, k, Q, F, k)
    S = []
    for lag in range(lags + 1):
        one = np.zeros_like(shift)
        for f in range(F):
            for g in (f - lag, f + lag) if lag else (f,):
                if 0 <= g < F:
                    one[:, f, :, :, g] = shift[:, f, :, :, f]
        S.append(np.kron(np.eye(2), one.reshape(Q * F * k, -1)))
    R = np.eye(len(P)) - P
    brute = np.array([[np.trace(Si @ R @ Sj @ R.T) for Sj in S] for Si in S])
    np.testing.assert_allclose(B, brute, atol=1e-9)


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_residuals_show_the_correlation_of_the_errors_behind_them(rho):
    """A fit of many parameters makes residuals less correlated than errors are."""
    estimates, naive = [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        J = np.cos(np.arange(90)[:, None] * np.arange(25) / 40).reshape(1, 90, 1, 25) + 0j
        e = autoregressive_errors(rng, (1, 1, 90, 1), rho)[:, 0]
        fit = linear_fit(e, J, np.ones((1, 90, 1)))
        r = e - J @ fit.estimates(fit.rows, e)
        fit = linear_fit(r, J, np.ones((1, 90, 1)))
        estimates.append(correlation_of_residuals(fit).coefficients[1])
        naive.append((np.conj(r[:, :-1]) * r[:, 1:]).real.sum() / (np.abs(r) ** 2).sum())
    assert np.mean(estimates) == pytest.approx(rho, abs=0.1)
    if rho:
        assert np.mean(naive) < rho - 0.1  # negative control


def test_the_order_and_the_correlations_of_an_autoregressive_process():
    lags = np.arange(7)
    first = autoregressive(0.7 ** lags[1:], 1000, 20)
    np.testing.assert_allclose(first, 0.7 ** np.arange(20), atol=1e-9)
    second = [1.0, 0.5 / 0.7]  # x_f = .5 x_(f-1) + .3 x_(f-2) + e: rho_1 = .5/(1 - .3)
    for _ in range(20):
        second.append(0.5 * second[-1] + 0.3 * second[-2])
    np.testing.assert_allclose(autoregressive(np.array(second[1:7]), 1e4, 20), second[:20])
    np.testing.assert_array_equal(autoregressive(np.full(6, 0.01), 1000, 5), [1, 0, 0, 0, 0])


def test_correlated_elements_count_as_fewer():
    rng = np.random.default_rng(0)
    common = circular(rng, 1, 19, 60, 1)
    draws = np.repeat(common, 4, axis=-1)
    same = linear_fit(np.zeros((1, 60, 4), complex), np.ones((1, 60, 4, 1)), None, draws, 19)
    assert element_correlation(same) == pytest.approx(4, rel=0.02)
    draws = circular(rng, 1, 19, 60, 4)
    other = linear_fit(np.zeros((1, 60, 4), complex), np.ones((1, 60, 4, 1)), None, draws, 19)
    assert element_correlation(other) == pytest.approx(1, abs=0.2)
