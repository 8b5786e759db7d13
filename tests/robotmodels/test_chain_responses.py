"""FRFs of chains under position controllers, damping mode by mode, the sampled linear plant."""

import numpy as np
import pytest

from robotmodels.common.errors import InvalidInput, SolverFailed
from robotmodels.linear.chain_responses import (
    chain_response,
    constrained_response,
    modally_damped,
    position_controlled,
)
from robotmodels.linear.coupled_chains import CoupledChains
from robotmodels.linear.modes import damped_modes
from robotmodels.simulation.controller import Controller
from robotmodels.simulation.discrete_loop import sampled_loop
from robotmodels.simulation.linear_simulation import simulate_linear
from robotmodels.simulation.loop_noise import hold_response

COUPLINGS = np.array([[0.0, 0.5, -0.4], [0.5, 0, 0.3], [-0.4, 0.3, 0]])
CHAINS = CoupledChains(
    np.array([[1.0, 2, 2], [2, 1, 2], [1, 1, 3]]),
    np.array([[1000.0, 2000], [3000, 1500], [2500, 1800]]),
    COUPLINGS,
)
OMEGA = np.array([0.5, 9.0, 31.0, 77.0])


def test_position_controllers_are_springs_to_the_ground():
    gains = np.array([0.0, 700.0, 50.0])
    model = position_controlled(CHAINS.linear_model(), gains)
    added = model.stiffness - CHAINS.linear_model().stiffness
    assert np.array_equal(np.diag(added)[[0, 3, 6]], gains)
    assert np.count_nonzero(added) == 2


def test_constrained_responses_follow_from_the_unconstrained():
    gains = np.array([0.0, 700.0, 50.0])
    expected = position_controlled(CHAINS.linear_model(), gains).frequency_response(OMEGA)
    found = constrained_response(chain_response(CHAINS, OMEGA), OMEGA, gains)
    assert found == pytest.approx(expected, rel=1e-9)


def test_held_chains_leave_the_sum_of_masses():
    low = chain_response(CHAINS, np.array([1e-3]), controlled=[1, 2])[0, 0, 0]
    assert 1 / low.real == pytest.approx(CHAINS.masses[0].sum(), rel=1e-6)
    strong = chain_response(CHAINS, np.array([1e-3]), controlled=[1, 2], gain=1e8)[0, 0, 0]
    assert 1 / strong.real == pytest.approx(CHAINS.masses[0].sum(), rel=1e-6)


def test_damping_mode_by_mode():
    model = modally_damped(CHAINS.linear_model(), 0.02)
    assert damped_modes(model).damping_ratios == pytest.approx(np.full(6, 0.02))
    rigid = np.repeat(np.eye(3), 3, axis=0)
    assert np.abs(model.damping @ rigid).max() < 1e-9 * np.abs(model.damping).max()


@pytest.fixture
def controller():
    return Controller(np.full(3, 40.0), np.full(3, 1.0), np.full(3, 2.0), 0.002)


def test_the_sampled_plant_has_the_linear_loops_spectra(controller):
    model = modally_damped(CHAINS.linear_model(), 0.02)
    samples, lines = 2000, np.array([3, 9, 17, 31])
    rng = np.random.default_rng(1)
    spectrum = np.zeros((1, 3, samples // 2 + 1, 3), dtype=complex)
    spectrum[:, :, lines] = rng.standard_normal((1, 3, len(lines), 3)) * samples
    signals = np.fft.irfft(spectrum, samples, axis=2)
    found = simulate_linear(
        model, signals, controller, lines=lines, rng=rng, periods=2, transient=6
    )
    assert found.missing.sum() == 0
    two = found.torque[0, 0, :, 0] - found.torque[0, 0, :, 1]
    assert np.abs(two).max() < 1e-5 * np.abs(found.torque).max()
    U, Y = (np.fft.rfft(s[0, 0, :, 1], axis=1)[:, lines] for s in (found.torque, found.angle))
    hold = hold_response(found.omega, 0.002)
    G = model.frequency_response(found.omega) / -(found.omega[:, None, None] ** 2)
    expected = np.einsum("f,fij,efj->efi", hold, G, U)
    # What the hold's images add is left out of the expectation.
    assert np.abs(Y - expected).max() < 1e-4 * np.abs(Y).max()


def test_noise_is_on_the_angle_and_the_seed_decides(controller):
    model = modally_damped(CHAINS.linear_model(), 0.02)
    lines = np.array([3])

    def run(seed):
        return simulate_linear(
            model,
            np.zeros((1, 1, 400, 3)),
            controller,
            lines=lines,
            angle_noise=[1e-3, 0, 0],
            rng=np.random.default_rng(seed),
            periods=1,
            transient=0,
        )

    one, again, other = run(1), run(1), run(2)
    assert np.array_equal(one.angle, again.angle)
    assert not np.array_equal(one.angle, other.angle)
    white = np.diff(one.angle[0, 0, 0, 0, :, 0])
    assert np.std(white) == pytest.approx(1e-3 * np.sqrt(2), rel=0.2)
    assert np.std(one.angle[..., 2]) < 1e-4


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: chain_response(CHAINS, OMEGA, [3]),
            "controlled: chain 3; there are chains 0 to 2",
        ),
        (lambda: position_controlled(CHAINS.linear_model(), [1, 2]), "3 finite numbers >= 0"),
        (
            lambda: modally_damped(CHAINS.linear_model(), -1.0),
            "damping ratio: -1.0 is not a number >= 0",
        ),
        (
            lambda: constrained_response(np.ones((4, 3, 2)), OMEGA, np.ones(3)),
            r"response: shape \(4, 3, 2\)",
        ),
    ],
)
def test_bad_input(call, message):
    with pytest.raises(InvalidInput, match=message):
        call()


def test_the_plant_refuses_what_it_cannot_simulate(controller):
    model, rng = CHAINS.linear_model(), np.random.default_rng(0)
    lines = np.array([3])
    with pytest.raises(InvalidInput, match=r"signals: shape \(3, 100\)"):
        simulate_linear(model, np.zeros((3, 100)), controller, lines=lines, rng=rng)
    with pytest.raises(InvalidInput, match="periods: 0 measured"):
        simulate_linear(
            model, np.zeros((1, 1, 100, 3)), controller, lines=lines, rng=rng, periods=0
        )
    wild = Controller(np.full(3, 4e3), np.full(3, 1.0), np.full(3, 2.0), 0.002)
    assert sampled_loop(model, wild).largest_pole > 1
    with pytest.raises(SolverFailed, match="closed loop is unstable"):
        simulate_linear(model, np.zeros((1, 1, 100, 3)), wild, lines=lines, rng=rng)
    one = Controller(np.ones(1), np.ones(1), np.ones(1), 0.002)
    with pytest.raises(InvalidInput, match="controller: 1 motors, the model has 3"):
        sampled_loop(model, one)
    many = CHAINS.network(np.zeros((2, 3))).linear_model()
    with pytest.raises(InvalidInput, match="one position at a time"):
        sampled_loop(many, controller)
