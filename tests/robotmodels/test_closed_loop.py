from dataclasses import replace

import numpy as np
import pytest
from robots import PENDULUM, SENSED, built, changed
from simulated import frf, multisines, odd_lines

import oed
import robotmodels
from robotmodels import (
    ClosedLoopNoise,
    Controller,
    InvalidInput,
    NotIdentifiable,
    RelativeNoise,
    default_controller,
    simulate,
)
from robotmodels.simulation.discrete_loop import sampled_loop
from robotmodels.simulation.imperfections import IDEAL
from robotmodels.simulation.loop_noise import angle_response, closed_loop
from robotmodels.simulation.window_noise import window_noise

T, N = 5e-4, 2000
POSITIONS = np.array([[0.3, -1.0, 1.0, 0.5, 0.7, 0.2], [-0.6, -0.4, 0.5, -0.5, 1.1, 0.2]])
ROBOT = robotmodels.load_robot("ur10")
LINES = odd_lines(N)[::6]
OMEGA = 2 * np.pi * LINES / (N * T)


def law(**changes: object) -> ClosedLoopNoise:
    R = np.fft.fft(multisines(6, N, LINES, 0.1)[0], axis=1)[:, LINES].transpose(1, 2, 0)
    noise = ClosedLoopNoise(
        default_controller(ROBOT, T), OMEGA, R, N, np.linspace(1, 2, 6) * 1e-5, averages=5
    )
    return replace(noise, **changes)


def test_the_plant_shows_the_spectra_that_are_predicted() -> None:
    signals = multisines(6, N, LINES, 1e-3)
    controller = default_controller(ROBOT, T)
    options = {"lines": LINES, "rng": np.random.default_rng(0), "transient": 3, "periods": 1}
    (records,) = simulate(ROBOT, POSITIONS[:1], signals[:, :2], controller, **options)
    loop = closed_loop(ROBOT.network(POSITIONS), OMEGA, controller)
    R = np.fft.fft(signals[0, :2], axis=1)[:, LINES]  # (E, F, n)
    for signal, response in ((records.torque, loop.torque), (records.angle, loop.angle)):
        found = np.fft.fft(signal[0, 0, :, 0], axis=1)[:, LINES]
        expected = np.einsum("fij,efj->efi", response[0], R)
        assert np.abs(found - expected).max() < 1e-3 * np.abs(expected).max()


def test_angles_are_what_accelerations_come_from() -> None:
    G = robotmodels.frequency_response(ROBOT, POSITIONS, OMEGA)
    half = OMEGA * T / 2
    hold = np.sin(half) / half * np.exp(-1j * half)
    found = angle_response(ROBOT.network(POSITIONS), OMEGA, T)
    np.testing.assert_allclose(found, G * (-hold / OMEGA**2)[:, None, None], rtol=1e-9)


def test_many_angles_are_computed_by_compiled_code_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    network = ROBOT.network(POSITIONS)
    expected = angle_response(network, OMEGA, T)
    monkeypatch.setattr("robotmodels.simulation.loop_noise._WORTHWHILE", 0)
    found = angle_response(network, OMEGA, T)
    assert np.max(np.abs(found - expected)) < 1e-10 * np.abs(expected).max()


def test_covariance_is_that_of_noisy_quotients() -> None:
    """(G U0 + V) U0^-1 with many draws of V; those of V's own law are in `test_window_noise`."""
    noise = law()
    network = ROBOT.network(POSITIONS[:1])
    covariance = noise.covariance(network, OMEGA)[0]
    weights = noise.weights(network, OMEGA)[0]
    rng, draws = np.random.default_rng(4), 20000
    half = OMEGA * T / 2
    hold = np.sinc(half / np.pi) * np.exp(-1j * half)
    loop = closed_loop(network, OMEGA, noise.controller).torque[0]
    outputs = window_noise(
        sampled_loop(network.linear_model().at(0), noise.controller),
        np.exp(1j * OMEGA * T),
        N,
        noise.angle_noise,
    )
    for f in (0, len(OMEGA) - 1):
        normal = rng.normal(size=(draws, 6, 6, 2)) @ np.array([1, 1j]) / np.sqrt(2)
        V = np.linalg.cholesky(outputs[f] / noise.averages) @ normal
        error = -(OMEGA[f] ** 2) / hold[f] * V @ np.linalg.inv(loop[f] @ noise.reference[f])
        vectors = np.swapaxes(error, 1, 2).reshape(draws, 36)
        sample = vectors.T @ vectors.conj() / draws
        assert np.linalg.norm(sample - covariance[f]) < 0.03 * np.linalg.norm(covariance[f])
        swapped = covariance[f].reshape(6, 6, 6, 6).transpose(1, 0, 3, 2).reshape(36, 36)
        assert np.linalg.norm(sample - swapped) > 0.2 * np.linalg.norm(sample)  # vec stacks columns
        np.testing.assert_allclose(weights[f] @ covariance[f], np.eye(36), atol=1e-7)


def test_scatter_of_simulated_frfs() -> None:
    """200 periods on the plant, one motor, noise inside the loop."""
    robot = built(PENDULUM)
    samples, count = 1000, 200
    lines = np.array([9, 15, 29])
    controller = default_controller(robot, T)
    (records,) = simulate(
        robot,
        np.zeros((1, 1)),
        multisines(1, samples, lines, 0.5),
        controller,
        lines=lines,
        imperfections=replace(IDEAL, angle_noise=1e-5),
        rng=np.random.default_rng(2),
        transient=4,
        periods=count,
    )
    periods = [
        replace(
            records,
            torque=records.torque[..., p : p + 1, :, :],
            angle=records.angle[..., p : p + 1, :, :],
            saturated=records.saturated[..., p : p + 1, :],
        )
        for p in range(count)
    ]
    found = np.array([frf(p)[:, 0, 0] for p in periods])
    R = np.fft.fft(records.reference[0, 0, :, 0], axis=1)[:, lines].transpose(1, 2, 0)
    noise = ClosedLoopNoise(controller, records.omega, R, samples, np.array([1e-5]))
    expected = noise.covariance(robot.network(np.zeros((1, 1))), records.omega)[0, :, 0, 0].real
    # A mean of squares of circular noise has a relative standard deviation of 1 / sqrt(count).
    ratio = found.var(axis=0) / expected
    np.testing.assert_allclose(ratio, 1.0, atol=4 / np.sqrt(count))


def test_designs_know_the_excitation() -> None:
    noise = law()
    info = oed.information(ROBOT, POSITIONS, OMEGA, noise)
    _, J = robotmodels.sensitivity(ROBOT, POSITIONS, OMEGA, equilibrium_shift=False)
    psi = np.swapaxes(J, 2, 3).reshape(2, len(OMEGA), 36, -1)
    inverse = np.linalg.inv(noise.covariance(ROBOT.network(POSITIONS), OMEGA))
    expected = 2 * np.einsum("qfip,qfij,qfjr->qpr", psi.conj(), inverse, psi).real
    scale = np.sqrt(np.einsum("qpp->qp", expected))
    difference = (info.matrices - expected) / scale[:, :, None] / scale[:, None, :]
    assert np.abs(difference).max() < 1e-6
    louder = oed.information(ROBOT, POSITIONS, OMEGA, law(reference=3 * noise.reference))
    difference = (louder.matrices / 9 - info.matrices) / scale[:, :, None] / scale[:, None, :]
    assert np.abs(difference).max() < 1e-9
    plain = oed.information(ROBOT, POSITIONS, OMEGA, RelativeNoise())
    ratio = info.matrices[0].diagonal() / plain.matrices[0].diagonal()
    assert ratio.max() > 2 * ratio.min()  # it is another law, not another scale


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"reference": np.zeros((3, 6, 6))}, "reference: shape"),
        ({"reference": np.zeros((len(OMEGA), 6, 0))}, "no run in a block"),
        ({"samples": 0}, "samples 0"),
        ({"angle_noise": np.array(0.0)}, "angle_noise: 0.0 must be 6 positive numbers"),
        ({"angle_noise": np.ones(5)}, "angle_noise: .* must be 6 positive numbers"),
        ({"omega": -OMEGA}, "omega"),
    ],
)
def test_laws_that_make_no_sense(change: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        law(**change)


def test_laws_that_do_not_fit_the_question() -> None:
    network = ROBOT.network(POSITIONS)
    with pytest.raises(InvalidInput, match="omega differs"):
        law().weights(network, OMEGA[:-1])
    one = law()
    with pytest.raises(InvalidInput, match="references for 3 positions, 2 are asked for"):
        replace(one, reference=np.stack([one.reference] * 3)).weights(network, OMEGA)
    sensed = built(SENSED)
    with pytest.raises(InvalidInput, match="motor accelerations"):
        one.weights(sensed.network(POSITIONS), OMEGA)
    slow = Controller(np.ones(1), np.ones(1), np.ones(1), 1.0)
    pendulum = built(changed(PENDULUM)).network(np.zeros((1, 1)))
    with pytest.raises(InvalidInput, match="Nyquist"):
        closed_loop(pendulum, OMEGA, slow)
    with pytest.raises(InvalidInput, match="controller: 6 motors, the robot has 1"):
        closed_loop(pendulum, OMEGA, one.controller)


def test_a_motor_without_a_signal_of_its_own_is_named() -> None:
    R = law().reference.copy()
    R[2, 3] = R[2, 2]
    R[2, :, :] *= np.array([1, 1, 1, 1, 1, 0])
    hertz = f"{OMEGA[2] / (2 * np.pi):.4g} Hz in position 0"
    with pytest.raises(NotIdentifiable, match=hertz):
        law(reference=R).covariance(ROBOT.network(POSITIONS), OMEGA)


def test_information_adds_up_over_runs() -> None:
    """FRFs need as many runs as motors, information of the runs themselves does not."""
    R = law().reference
    whole = oed.information(ROBOT, POSITIONS, OMEGA, law()).matrices
    single = [
        oed.information(ROBOT, POSITIONS, OMEGA, law(reference=R[:, :, [e]])).matrices
        for e in range(6)
    ]
    scale = np.abs(whole).max()
    np.testing.assert_allclose(sum(single), whole, atol=1e-11 * scale)
