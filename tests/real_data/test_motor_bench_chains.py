"""A real two-inertia motor bench as one chain of two masses, from motor current and angle alone.

Everything is in units of the torque constant; the load's angle serves as judge only.
"""

import numpy as np
import pytest
from motor_bench import bench_data, bench_records

from estimators import chains_from_frf, estimate_frf, fit_dampers, identify_chains
from estimators.chain_dampers.damper_fit import recommended_estimate
from estimators.chains.identified_chains import predict_masses

MOTOR, LOAD, STIFFNESS = 0.004796, 0.004804, 552.5


@pytest.fixture(scope="module")
def bench():
    return bench_data()


def estimated(data, angle):
    return estimate_frf(bench_records(data, angle), covariance="noise", hold=False, transient=1)


@pytest.fixture(scope="module", params=["with the noise's covariance", "noise unknown"])
def found(bench, request):
    """Without N: the bench must be seen to be two masses."""
    estimate = estimated(bench, bench["theta_mx"])
    known = estimate.covariance[0] if "covariance" in request.param else None
    return identify_chains(estimate.omega, estimate.response[0], covariance=known)


def test_the_bench_is_seen_to_be_two_masses(found):
    assert found.n_masses == 2


def test_stiffness_and_inertia_ratio_within_one_percent(found):
    motor, load = found.masses[0]
    assert found.springs[0, 0] == pytest.approx(STIFFNESS, rel=0.01)
    assert load / motor == pytest.approx(LOAD / MOTOR, rel=0.01)
    assert motor == pytest.approx(MOTOR, rel=0.01)
    assert load == pytest.approx(LOAD, rel=0.01)


def test_resonance_and_anti_resonance_within_one_percent(found):
    assert found.modes.omega / (2 * np.pi) == pytest.approx([76.36], rel=0.01)
    assert found.modes.zeros[0] / (2 * np.pi) == pytest.approx([53.98], rel=0.01)


def test_uncertainty_is_that_of_distortion_not_of_noise(found):
    """One block shows no distortion; the misfit does, and standard deviations follow it."""
    assert found.structured.relative_std.min() > 1e-3
    assert found.structured.relative_std.max() < 0.02
    pulls = (found.structured.values - [MOTOR, LOAD, STIFFNESS]) / found.structured.std
    assert (np.abs(pulls) < 3).all()


def test_no_interval_is_given_beside_friction(bench):
    """Noise does not explain the residuals by far: a verdict in place of numbers."""
    found = chains_from_frf(estimated(bench, bench["theta_mx"]), 2)
    best = recommended_estimate(found, fit_dampers(found))
    assert best.verdict == "model error"
    assert all(i.low is None and i.high is None for i in best.intervals)


def test_the_loads_frf_is_predicted(bench, found):
    measured = estimated(bench, -np.asarray(bench["theta_my"]))
    predicted = predict_masses(found, measured.omega)[:, 1, 0]
    ratio = measured.response[0, :, 0, 0] / predicted
    assert np.median(np.abs(np.abs(ratio) - 1)) < 0.025
    assert np.abs(np.angle(ratio, deg=True)).max() < 12
    assert np.median(np.abs(ratio - 1)) < 0.1
    # The motor's own FRF is no prediction of the load's: past the anti-resonance they part.
    motor = estimated(bench, bench["theta_mx"]).response[0, :, 0, 0]
    wrong = measured.response[0, :, 0, 0] / motor
    assert np.median(np.abs(wrong - 1)) > 0.5
