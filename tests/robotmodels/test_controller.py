from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import robotmodels
from robotmodels import Controller, ElasticRobot, InvalidInput, default_controller
from robotmodels.linear.chain_responses import modally_damped
from robotmodels.linear.coupled_chains import CoupledChains
from robotmodels.simulation.discrete_loop import sampled_loop

T = 5e-4


def of_two_motors(filter_time: float = 0.0) -> Controller:
    return Controller(
        np.array([0.5, 0.02]),
        np.array([0.05, np.inf]),
        np.array([5.0, 0.0]),
        T,
        np.full(2, filter_time),
    )


def commanded(c: Controller, reference: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """The law of the docstring, sample by sample."""
    a = np.where(c.filter_time > 0, np.exp(-T / np.maximum(c.filter_time, 1e-9)), 0.0)
    w, i, last = np.zeros(2), np.zeros(2), angle[0]
    torque = []
    for r, y in zip(reference, angle, strict=True):
        w = a * w + (1 - a) * (y - last) / T
        e = r - c.position_gain * y - w
        i = i + T * e / c.integral_time
        torque.append(c.speed_gain * (e + i))
        last = y
    return np.array(torque)


@pytest.mark.parametrize("filter_time", [0.0, 2e-3])
@pytest.mark.parametrize("signal", ["reference", "angle"])
def test_frequency_responses_are_those_of_the_sampled_law(filter_time: float, signal: str) -> None:
    c = of_two_motors(filter_time)
    samples, line = 400, 12
    wave = np.cos(2 * np.pi * line * np.arange(3 * samples) / samples + 0.7)[:, None] * np.ones(2)
    silence = np.zeros_like(wave)
    u = commanded(c, *((wave, silence) if signal == "reference" else (silence, wave)))
    ratio = (np.fft.fft(u[-samples:], axis=0) / np.fft.fft(wave[-samples:], axis=0))[line]
    omega = np.array([2 * np.pi * line / (samples * T)])
    expected = c.prefilter(omega)[0] if signal == "reference" else -c.feedback(omega)[0]
    np.testing.assert_allclose(ratio, expected, rtol=1e-9)


def largest_pole(robot: ElasticRobot, position: np.ndarray, c: Controller) -> float:
    """Return the spectral radius of the sampled loop around the linear model."""
    model = robotmodels.linearize(robot, position)
    M, D, K, S = model.mass, model.damping, model.stiffness, model.selector
    d, n = S.shape
    A = np.zeros((2 * d + n, 2 * d + n))
    A[:d, d : 2 * d] = np.eye(d)
    A[d : 2 * d] = np.linalg.solve(M, np.hstack([-K, -D, S]))
    step = expm(A * c.sample_time)  # torques held
    F, H = step[: 2 * d, : 2 * d], step[: 2 * d, 2 * d :]
    # States: x, last angle, integral. u = ks (e + i), e = -kp y - (y - last)/T, i += T e/Ti.
    C = np.hstack([S.T, np.zeros((n, d))])
    ks, kp = np.diag(c.speed_gain), np.diag(c.position_gain)
    rate = np.diag(c.sample_time / c.integral_time)
    e = np.hstack([-(kp + np.eye(n) / c.sample_time) @ C, np.eye(n) / c.sample_time, 0 * kp])
    i = rate @ e + np.hstack([0 * C, 0 * kp, np.eye(n)])
    x = np.hstack([F, np.zeros((2 * d, 2 * n))]) + H @ ks @ (e + i)
    last = np.hstack([C, 0 * kp, 0 * kp])
    return float(np.abs(np.linalg.eigvals(np.vstack([x, last, i]))).max())


def spread(robot: ElasticRobot, count: int) -> np.ndarray:
    low, high = robot.position_limits.T
    draws = np.random.default_rng(0).uniform(-0.6, 0.6, (count, len(low)))
    return (low + high) / 2 + draws * np.minimum(high - low, 5.0) / 2


@pytest.mark.parametrize("name", robotmodels.builtin_robots())
def test_default_gains_are_stable(name: str) -> None:
    robot = robotmodels.load_robot(name)
    for sample_time in (T, 1e-3):
        c = default_controller(robot, sample_time)
        assert max(largest_pole(robot, p, c) for p in spread(robot, 8)) < 1 - 1e-4
    wild = replace(c, speed_gain=30 * c.speed_gain)
    assert largest_pole(robot, spread(robot, 1)[0], wild) > 1  # a negative control


def test_published_gains() -> None:
    c = default_controller(robotmodels.load_robot("manutec_r3"), 1e-4)
    np.testing.assert_array_equal(c.integral_time, 0.05)
    np.testing.assert_array_equal(c.position_gain, 5.0)
    np.testing.assert_array_equal(c.speed_gain[:5], 0.5)
    assert 0.2 < c.speed_gain[5] < 0.5  # the last wrist's inertia allows no more when sampled


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"speed_gain": np.array([0.5, 0.0])}, "speed_gain of motor 1 is 0"),
        ({"integral_time": np.array([-1.0, 1.0])}, "integral_time of motor 0 is -1"),
        ({"position_gain": np.array([1.0, np.nan])}, "position_gain of motor 1 is nan"),
        ({"filter_time": np.array([np.inf, 0.0])}, "filter_time of motor 0 is inf"),
        ({"position_gain": np.ones(3)}, r"position_gain has shape \(3,\)"),
        ({"sample_time": 0.0}, "sample_time: 0.0"),
    ],
)
def test_gains_out_of_range(change: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        replace(of_two_motors(), **change)


def test_a_sample_time_is_needed() -> None:
    with pytest.raises(InvalidInput, match="sample_time: -1"):
        default_controller(robotmodels.load_robot("ur5"), -1.0)


def test_without_an_integral_part_a_loop_is_stable_and_has_no_pole_at_one():
    chains = CoupledChains(np.array([[1.0, 2.0]]), np.array([[900.0]]), np.zeros((1, 1)))
    damped = modally_damped(chains.linear_model(), 0.01)
    loops = [
        sampled_loop(damped, Controller([40.0], [integral_time], [5.0], 1e-3))
        for integral_time in (np.inf, 1e9)
    ]
    endless, long = loops
    assert endless.largest_pole < 1 - 1e-4
    assert long.largest_pole > 1 - 1e-9  # an integrator that hardly integrates
    references = np.random.default_rng(1).standard_normal((1, 200, 1))
    assert endless.swing(references) == pytest.approx(long.swing(references), rel=1e-6)
