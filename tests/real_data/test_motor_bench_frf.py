"""A real two-inertia motor bench: what published fits of it say must come out of the records.

The current was measured, not commanded, so no hold is to be corrected.
"""

import numpy as np
import pytest
from motor_bench import DETECTION, RATE, SAMPLES, bench_data, bench_records
from scipy.optimize import least_squares

from estimators import distortion, estimate_frf, local_frf, settling
from estimators.frf.spectra import spectra
from robotmodels import IdentificationWarning


@pytest.fixture(scope="module")
def bench():
    data = bench_data()
    return bench_records(data, data["theta_mx"])


@pytest.fixture(scope="module")
def estimate(bench):
    return estimate_frf(bench, covariance="noise", hold=False, transient=1)


def two_inertias(theta, omega):
    """Acceleration of the first of two inertias with spring, damper, friction and a delay."""
    (jm, jl, k, c, dm, dl), delay = np.exp(theta[:6]), theta[6]
    s = 1j * omega
    spring = k + c * s
    load = jl * s**2 + dl * s + spring
    motor = jm * s**2 + dm * s + spring
    return s**2 * load / (motor * load - spring**2) * np.exp(-s * delay)


def fitted(estimate):
    G, omega = estimate.response[0, :, 0, 0], estimate.omega

    def residual(theta):
        error = np.log(G / two_inertias(theta, omega))
        return np.concatenate([error.real, error.imag])

    start = np.array([*np.log([5e-3, 5e-3, 500.0, 1e-2, 1e-2, 1e-2]), 1e-4])
    return least_squares(residual, start, x_scale=[1, 1, 1, 1, 1, 1, 1e-4]).x


def test_resonance_and_anti_resonance(estimate):
    jm, jl, k = np.exp(fitted(estimate)[:3])
    assert np.sqrt(k / jl) / (2 * np.pi) == pytest.approx(53.98, rel=0.005)
    assert np.sqrt(k * (1 / jl + 1 / jm)) / (2 * np.pi) == pytest.approx(76.36, rel=0.005)


def test_stiffness_and_inertias_in_units_of_the_torque_constant(estimate):
    jm, jl, k = np.exp(fitted(estimate)[:3])
    assert k == pytest.approx(552.5, rel=0.02)
    assert jm == pytest.approx(0.004796, rel=0.02)
    assert jl == pytest.approx(0.004804, rel=0.02)


def test_detection_lines_lie_42_to_44_db_below(bench, estimate):
    found = distortion(bench, hold=False, transient=1)
    excited = np.sqrt(np.mean(found.output**2))
    for raw, omega in ((found.odd_raw, found.odd_omega), (found.even_raw, found.even_omega)):
        lines = np.rint(omega * SAMPLES / RATE / (2 * np.pi)).astype(int)
        periods = spectra(bench, 0, lines, hold=False, first=1).output[0, :, :, 0, 0]
        scatter = np.var(periods, axis=0, ddof=1) / len(periods)  # the published figure's noise
        level = np.sqrt(np.mean(raw**2))
        assert 41.5 < 20 * np.log10(excited / level) < 44.5
        assert 3 < level / np.sqrt(np.mean(scatter)) < 4.5
    # One block shows no scatter over phases.
    assert np.isnan(found.total).all()
    # The torque is not zero there; taken off by interpolation or by the fitted model, alike.
    omega = found.odd_omega
    between = spectra(bench, 0, DETECTION, hold=False, first=1)
    Y, U = (a.mean(axis=1)[0, :, 0, 0] for a in (between.output, between.input))
    rest = Y - two_inertias(fitted(estimate), omega) * U
    assert (found.odd**2).sum() == pytest.approx(np.sum(np.abs(rest) ** 2), rel=0.1)
    assert (found.odd**2).sum() > 5 * (found.odd_noise**2).sum()


def test_the_first_period_is_a_transient(bench):
    judged = settling(spectra(bench))
    assert judged.first == 1
    assert judged.p_values[0] < 1e-12
    with pytest.warns(IdentificationWarning, match="the first 1 of 20 periods dropped"):
        automatic = estimate_frf(bench, covariance="noise", hold=False)
    given = estimate_frf(bench, covariance="noise", hold=False, transient=1)
    assert (automatic.response == given.response).all()


def test_noise_is_what_means_of_many_periods_scatter_by(bench, estimate):
    """Single periods scatter more than their mean's noise would have it: what drifts from one into
    the next is counted against both. Means of six periods agree with the estimate.
    """
    found = spectra(bench, hold=False, first=1)
    error = (found.output - estimate.response[0] @ found.input)[0, :18, :, 0, 0]
    error = error / found.input.mean(axis=1)[0, :, 0, 0]

    def ratio(length):
        means = error.reshape(18 // length, length, -1).mean(axis=1)
        scatter = np.var(means, axis=0, ddof=1) / len(means) * 18 / 19
        return np.mean(scatter / estimate.variance[0, :, 0, 0])

    assert 0.6 < ratio(6) < 1.7
    assert ratio(1) > 2


def test_a_local_model_agrees_where_the_response_is_smooth(bench, estimate):
    local = local_frf(bench, order=2, denominator=2, hold=False, transient=1)
    smooth = np.abs(estimate.omega / (2 * np.pi) - 65) > 20
    ratio = local.response[0, smooth, 0, 0] / estimate.response[0, smooth, 0, 0]
    assert np.median(np.abs(ratio - 1)) < 0.03
