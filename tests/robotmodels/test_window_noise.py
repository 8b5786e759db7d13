"""Noise in a loop and the spectra of a window: the law against loops simulated sample by sample."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from robotmodels import ClosedLoopNoise, Controller, CoupledChains, InvalidInput, SolverFailed
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.simulation.discrete_loop import sampled_loop
from robotmodels.simulation.window_noise import window_noise

T, N = 0.01, 1000  # a period of 10 s
CHAINS = CoupledChains(
    masses=np.array([[1.0, 2.0], [2.0, 1.5]]),
    springs=np.array([[900.0], [2500.0]]),
    couplings=np.array([[0, 0.5], [0.5, 0]]),
    dampers=np.array([[1.0], [2.0]]),
)
MODEL = CHAINS.linear_model()
CONTROLLER = Controller(np.array([20.0, 30.0]), np.ones(2), np.ones(2), T, np.array([0.03, 0.0]))
STD = np.array([1e-3, 2e-3])
LINES = np.array([1, 2, 3, 5, 9, 30])
Z = np.exp(2j * np.pi * LINES / N)
OMEGA = 2 * np.pi * LINES / (N * T)


def plant() -> tuple[Array, Array]:
    """Coordinates and speeds of one sample later, from them and from torques."""
    d = len(MODEL.mass)
    inverse = np.linalg.inv(MODEL.mass)
    rows = [np.zeros((d, d)), np.eye(d), np.zeros((d, 2))]
    forces = [-inverse @ MODEL.stiffness, -inverse @ MODEL.damping, inverse @ MODEL.selector]
    held = expm(T * np.vstack([np.hstack(rows), np.hstack(forces), np.zeros((2, 2 * d + 2))]))
    return held[: 2 * d, : 2 * d], held[: 2 * d, 2 * d :]


def simulated(runs: int, periods: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Torques and measured angles, (periods, N, 2, runs), of the loop in its noise alone."""
    A, B = plant()
    d = len(MODEL.mass)
    state = np.zeros((2 * d, runs))
    speed, integral, last = np.zeros((3, 2, runs))
    a = np.array([np.exp(-T / 0.03), 0.0])[:, None]
    torques, angles = np.empty((2, periods * N, 2, runs))
    for k in range(-4 * N, periods * N):
        seen = MODEL.selector.T @ state[:d] + STD[:, None] * rng.standard_normal((2, runs))
        speed = a * speed + (1 - a) * (seen - last) / T
        error = -CONTROLLER.position_gain[:, None] * seen - speed
        integral = integral + T * error
        torque = CONTROLLER.speed_gain[:, None] * (error + integral)
        last, state = seen, A @ state + B @ torque
        if k >= 0:
            torques[k], angles[k] = torque, seen
    shape = (periods, N, 2, runs)
    return torques.reshape(shape), angles.reshape(shape)


def sampled_response() -> ComplexArray:
    A, B = plant()
    C = np.hstack([MODEL.selector.T, np.zeros((2, len(MODEL.mass)))])
    return np.asarray(C @ np.linalg.solve(Z[:, None, None] * np.eye(len(A)) - A, B))


def scatter(torques: Array, angles: Array) -> ComplexArray:
    """Covariance (F, 2, 2) of Y - G U over runs, from (N, 2, runs)."""
    U, Y = (np.fft.fft(x, axis=0)[LINES] for x in (torques, angles))
    errors = Y - sampled_response() @ U
    return np.asarray(errors @ np.conj(np.swapaxes(errors, 1, 2)) / torques.shape[-1])


@pytest.mark.parametrize("runs", [300, pytest.param(4000, marks=pytest.mark.slow)])
def test_the_transient_is_in_the_law(runs: int) -> None:
    loop = sampled_loop(MODEL, CONTROLLER)
    assert 0.5 < -T / np.log(loop.largest_pole) < 2  # time constant, in s
    torques, angles = simulated(runs, 3, np.random.default_rng(1))
    tolerance = 4.5 / np.sqrt(runs)
    for window, seen in (
        (1, scatter(torques[0], angles[0])),
        (3, scatter(torques.mean(axis=0), angles.mean(axis=0))),
    ):
        law = window_noise(loop, Z, window * N, STD) / window**2
        size = np.sqrt(np.einsum("fii->fi", law).real)
        error = np.abs(seen - law) / (size[:, :, None] * size[:, None, :])
        assert error.max() < tolerance
        white = N / window * STD**2
        assert (np.einsum("fii->fi", seen).real / white)[0].min() > 20 / window  # noise alone
    # Periods that follow one another are not independent.
    assert np.einsum("fii->fi", seen).real[0].max() < 0.6 * (size[0] ** 2 * 3).max()


def test_the_law_of_an_frf_has_it() -> None:
    R = np.broadcast_to(np.eye(2) + 0j, (len(LINES), 2, 2))
    network = CHAINS.network(np.zeros((1, 0)))
    one = ClosedLoopNoise(CONTROLLER, OMEGA, R, N, STD)
    _, output = one.factors(network, OMEGA)
    loop = sampled_loop(MODEL, CONTROLLER)
    expected = OMEGA[:, None, None] ** 4 * window_noise(loop, Z, N, STD)
    np.testing.assert_allclose(output[0], expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())
    _, blocks = replace(one, averages=6).factors(network, OMEGA)
    np.testing.assert_allclose(blocks, output / 6, rtol=1e-12)
    _, periods = replace(one, averages=6, periods=3).factors(network, OMEGA)
    assert periods[0, 0, 0, 0].real < 0.6 * blocks[0, 0, 0, 0].real
    with pytest.raises(InvalidInput, match="averages: 6 is not 4 periods times"):
        replace(one, averages=6, periods=4)


def test_a_long_period_leaves_white_noise_and_a_short_one_does_not() -> None:
    loop = sampled_loop(MODEL, CONTROLLER)
    ratios = [
        window_noise(loop, np.exp(1j * OMEGA[-1:] * T), count, STD)[0, 0, 0].real
        / (count * STD[0] ** 2)
        for count in (N, 100 * N)
    ]
    assert abs(ratios[1] - 1) < 0.02 * abs(ratios[0] - 1) + 1e-9


def test_loops_that_wander_and_loops_that_burst() -> None:
    """Speed loops alone let angles wander; the change over a window has a finite variance."""
    wandering = sampled_loop(MODEL, replace(CONTROLLER, position_gain=np.zeros(2)))
    assert wandering.largest_pole == pytest.approx(1, abs=1e-9)
    covariance = window_noise(wandering, Z, N, STD)
    assert np.isfinite(covariance).all()
    assert np.linalg.eigvalsh(covariance).min() > 0
    unstable = replace(CONTROLLER, speed_gain=np.array([300.0, 30.0]))
    R = np.broadcast_to(np.eye(2) + 0j, (len(LINES), 2, 2))
    noise = ClosedLoopNoise(unstable, OMEGA, R, N, STD)
    with pytest.raises(SolverFailed, match="position 0: noise: the closed loop is unstable"):
        noise.weights(CHAINS.network(np.zeros((1, 0))), OMEGA)
