"""Predictions in innovation form: the exact likelihood, and parameters of records."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov
from scipy.stats import chi2, multivariate_normal

from oed.replication import time_domain_comparison
from oed.replication.prediction_error_fit import (
    Innovations,
    fit_prediction_errors,
    innovations,
    whitened_errors,
)
from robotmodels import frequency_response

POSITION = np.array([0.3, 0.4, 0.5, 0.2, 0.6, 0.1])


@pytest.fixture(scope="module")
def case():
    robot, records = time_domain_comparison.case()
    return robot, time_domain_comparison.rollouts_of(robot, records)


def predictor(case, ratio=1e-3):
    robot, rollouts = case
    size = ratio * rollouts.torque.std(axis=(0, 1))
    return innovations(robot, POSITION, robot.parameters.values, size, rollouts)


def test_the_sampled_model_has_the_frfs_of_the_robot(case):
    """A held torque's image in the angle: below a tenth of the sampling frequency, the FRF's."""
    robot, rollouts = case
    one, T = predictor(case), rollouts.sample_time
    omega = 2 * np.pi * np.array([3.0, 11.0, 30.0])
    G = frequency_response(robot, POSITION[None], omega)[0]
    for w, expected in zip(omega, G, strict=True):
        z = np.exp(1j * w * T)
        sampled = one.output @ np.linalg.solve(
            z * np.eye(len(one.transition)) - one.transition, one.input
        )
        held = np.sinc(w * T / (2 * np.pi)) * np.exp(-0.5j * w * T)
        angle = -expected * held / w**2 / rollouts.angle_noise
        assert np.abs(sampled - angle).max() < 2e-3 * np.abs(angle).max()


@pytest.mark.parametrize("seed", range(3))
def test_the_sum_of_squares_is_the_gaussian_likelihood(seed):
    """Of a stationary process, its dense covariance judges; the filter must begin where it is."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((3, 3))
    A *= 0.8 / np.abs(np.linalg.eigvals(A)).max()
    C, Q = rng.standard_normal((2, 3)), np.diag([0.5, 1.0, 2.0])
    from scipy.linalg import solve_discrete_are

    P = solve_discrete_are(A.T, C.T, Q, np.eye(2))
    S = C @ P @ C.T + np.eye(2)
    gain = A @ P @ C.T @ np.linalg.inv(S)
    one = Innovations(A, np.zeros((3, 1)), C, gain, S)
    # Outputs of the innovation form itself from rest: y = e + C sum A^(k-1-j) K e(j).
    count, root = 30, np.linalg.cholesky(S)
    e = rng.standard_normal((count, 2)) @ root.T
    lower = np.eye(2 * count)
    power = gain
    for lag in range(1, count):
        for k in range(lag, count):
            lower[2 * k : 2 * k + 2, 2 * (k - lag) : 2 * (k - lag) + 2] = C @ power
        power = A @ power
    y = (lower @ e.ravel()).reshape(1, count, 2)
    np.testing.assert_allclose(one.errors(np.zeros((1, count, 1)), y)[0], e, atol=1e-10)
    dense = lower @ np.kron(np.eye(count), S) @ lower.T
    m, squares = 2, np.sum(whitened_errors(one, np.zeros((1, count, 1)), y) ** 2)
    size = squares / np.linalg.det(S) ** (1 / m)  # e^T S^-1 e
    log_likelihood = -0.5 * (size + count * np.log(np.linalg.det(2 * np.pi * S)))
    exact = multivariate_normal(np.zeros(2 * count), dense).logpdf(y.ravel())
    assert log_likelihood == pytest.approx(exact, rel=1e-9)
    # Steady state: dense covariances of outputs far from the start are those of state and noise.
    stationary = solve_discrete_lyapunov(A, Q)
    np.testing.assert_allclose(
        C @ stationary @ C.T + np.eye(2),
        C @ solve_discrete_lyapunov(A, gain @ S @ gain.T) @ C.T + S,
        rtol=1e-9,
    )


@pytest.mark.parametrize("seed", range(3))
def test_errors_are_white_and_of_their_covariance_for_the_right_noise_alone(case, seed):
    one, (_, rollouts) = predictor(case), case
    rng = np.random.default_rng(seed)
    torque = rollouts.torque[:, :400]
    noise = 1e-3 * rollouts.torque.std(axis=(0, 1))
    state, angle = np.zeros((len(torque), len(one.transition))), np.empty(torque.shape)
    for k in range(torque.shape[1]):
        angle[:, k] = state @ one.output.T + rng.standard_normal(angle[:, k].shape)
        total = torque[:, k] + noise * rng.standard_normal(torque[:, k].shape)
        state = state @ one.transition.T + total @ one.input.T

    def normal(predicted):
        e = np.linalg.solve(
            np.linalg.cholesky(predicted.covariance), predicted.errors(torque, angle)[..., None]
        )[:, 100:]
        n = e.size
        p = chi2.cdf(np.sum(e**2), n)
        lag = np.sum(e[:, 1:] * e[:, :-1]) / np.sqrt(n)
        return 1e-4 < p < 1 - 1e-4 and abs(lag) < 4

    assert normal(one)
    assert not normal(predictor(case, 1e-2))
    assert not normal(predictor(case, 1e-4))


def test_springs_and_dampers_of_records_are_found(case):
    robot, rollouts = case
    short = replace(rollouts, torque=rollouts.torque[:2, :300], angle=rollouts.angle[:2, :300])
    truth = robot.parameters.values
    end = fit_prediction_errors(robot, POSITION, short, 1.1 * truth, 1.5, 400)
    error = np.abs(np.log(end.values / truth))
    springs = np.array([name.endswith("stiffness") for name in robot.parameters.names])
    assert end.ended
    assert error[springs].max() < 5e-3
    assert error[~springs].max() < 5e-2
    stopped = fit_prediction_errors(robot, POSITION, short, 1.1 * truth, 1.5, 1)
    assert not stopped.ended
