"""Published remarks on excitations: one run for n, spectral matrices, limits of amplitudes."""

import numpy as np
import pytest

import oed
from oed.experiment.draw_plan import reduced_crest
from robotmodels import (
    ExcitationNoise,
    InputOutputNoise,
    frequency_response,
    load_robot,
)

ROBOT = load_robot("manutec_r3")
TORQUE = np.array([9.0, 9.0, 9.0, 1.9, 2.0, 0.65])
POSITIONS = np.random.default_rng(2).uniform(-1, 1, (2, 6))
NAMES = ROBOT.parameters.names


def noise(lines):
    return InputOutputNoise.of_levels(TORQUE, lines, 0.05, speed=2e-2)


def best(matrices):
    """Return the D-efficiency scale, exp(log det / p), of the best shares of the positions."""
    info = oed.InformationSet(POSITIONS, matrices, NAMES)
    return np.exp(oed.optimal_design(info, "D", solver="newton").value / len(NAMES))


@pytest.mark.parametrize("seed", range(3))
def test_wernholt_moberg_orthogonal_multisines_are_optimal_given_output_amplitudes(seed):
    """[WM] section 4: largest information on an FRF, n^2 log det of Y Y^H, of bounded |Y_ij|.

    With U = G^-1 Y the information (U U^H)^T kron Sigma^-1 has a determinant that depends on the
    runs by |det Y|^(2n) alone, and Hadamard's bound n^(n/2) on it is attained by T.
    """
    n, rng = 6, np.random.default_rng(seed)
    G, L = (rng.standard_normal((n, n)) + 1j * rng.standard_normal((n, n)) for _ in range(2))

    def log_information(outputs):
        U = np.linalg.solve(G, outputs)
        return np.linalg.slogdet(
            np.kron((U @ U.conj().T).T, np.linalg.inv(L @ L.conj().T))
        ).logabsdet

    T = np.exp(2j * np.pi / n * np.outer(np.arange(n), np.arange(n)))
    optimal = log_information(T)
    for _ in range(100):
        sizes = rng.uniform(0, 1, (n, n)) ** rng.choice([0.0, 0.1, 1.0])
        Y = sizes * np.exp(2j * np.pi * rng.uniform(size=(n, n)))
        assert log_information(Y) <= optimal + 1e-9
    diagonal = log_information(np.eye(n))  # one output at a time has n^(-n/2) of the determinant
    assert optimal - diagonal == pytest.approx(n * n * np.log(n))


@pytest.mark.slow
def test_wernholt_moberg_orthogonal_speeds_are_not_optimal_for_springs_and_dampers():
    """The best spectra within the same speeds, torques and largest line tell more of them."""
    lines = 6
    omega = 2 * np.pi * np.linspace(4.0, 60.0, lines)
    G = frequency_response(ROBOT, POSITIONS, omega)
    inverse = np.linalg.inv(G / (1j * omega[:, None, None]))
    Phi = inverse @ np.conj(np.swapaxes(inverse, -1, -2)) / lines
    tracked = best(
        oed.information(ROBOT, POSITIONS, omega, ExcitationNoise(Phi, noise(lines))).matrices
    )
    torque = np.sqrt(np.einsum("qfii->qi", Phi).real.max(axis=0))
    cap = np.einsum("qfii,i->qf", Phi, 1 / torque**2).real.max() * lines / 6
    design = oed.optimal_spectra(
        ROBOT,
        POSITIONS,
        omega,
        noise(lines),
        torque,
        full=True,
        line_cap=cap,
        speed=1.0,
        tolerance=0.1,
    )
    assert tracked < 0.5 * np.exp(design.value / 6)


def test_zimmermann_moberg_one_run_measures_as_much_a_second_as_n():
    """arXiv 2312.06276: n times less data in one run, and n times less information with it."""
    lines = 390
    table = oed.experiment_candidates(
        ROBOT,
        POSITIONS,
        ["orthogonal", "zippered", "random_phase"],
        2 * np.pi * (2 + 0.2 * np.arange(lines)),
        noise(lines),
        torque=TORQUE,
        periods=1,
    )
    orthogonal, zippered, random = np.split(table.information.matrices, 3)
    assert best(6 * zippered) / best(orthogonal) == pytest.approx(1.0, abs=0.05)
    assert best(6 * random) / best(orthogonal) == pytest.approx(1.0, abs=0.1)
    assert best(zippered) / best(orthogonal) == pytest.approx(1 / 6, rel=0.05)


def test_dirkx_directions_matter_and_most_of_it_is_which_motor_on_which_line():
    """Dirkx, van de Wijdeven and Oomen 2020, for parameters: full over diagonal over flat."""
    lines = 12
    omega = 2 * np.pi * np.linspace(4.0, 60.0, lines)
    arguments = (ROBOT, POSITIONS, omega, noise(lines), TORQUE)
    diagonal = oed.optimal_spectra(*arguments, line_cap=2.0, tolerance=1e-3)
    full = oed.optimal_spectra(*arguments, line_cap=2.0, tolerance=1e-3, full=True)
    assert 1 / diagonal.flat_efficiency > 3
    assert 1.0 < np.exp((full.value - diagonal.value) / 6) < 2.0
    assert full.run_efficiency > 0.95  # the relaxation is tight: one run attains it


def test_tantau_lower_crests_allow_larger_torques():
    """Largest root mean square within limits of peaks: clipping finds 1.8 to 2.2 times as much."""
    sine = oed.band_multisine(1000, 0.002, (4 * np.pi, 120 * np.pi), inputs=6)
    phases = oed.random_phases(sine, 8, rng=np.random.default_rng(1))
    lowered = reduced_crest(sine, phases, 100)
    before, after = (oed.crest_factor(sine.reference(p)[:, 0], axis=1) for p in (phases, lowered))
    assert 1.5 < np.median(before / after) < 2.3
