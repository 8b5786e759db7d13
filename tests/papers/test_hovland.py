"""[HBH] section 4: every printed number, from exact eigenvalues and from sampled FRFs."""

import numpy as np
import pytest

from estimators.chains.identification import identify_chains
from estimators.chains.inverse_eigenvalue import (
    coupled_inertia,
    lanczos_chain,
    lanczos_step,
    without_first_mass,
)
from estimators.chains.pole_zero_spectra import first_components, zeros_between
from estimators.chains.stepwise import stepwise_chain
from robotmodels.linear.chain_responses import chain_response
from robotmodels.linear.coupled_chains import CoupledChains
from robotmodels.linear.modes import anti_resonances, resonances

MASSES = np.array([[0.7, 2, 3], [4, 5, 6], [7, 8, 9]])
SPRINGS = np.array([[1000.0, 2000], [3000, 4000], [5000, 6000]])
COUPLINGS = np.array([[0.0, 1, 2], [1, 0, 3], [2, 3, 0]])
CHAINS = CoupledChains(MASSES, SPRINGS, COUPLINGS)

LAMBDA = [0, 24.63, 29.59, 34.16, 44.92, 48.60, 51.28]
LAMBDA_0 = [
    [13.11, 25.29, 29.75, 43.62, 46.88, 49.33],
    [14.93, 27.05, 34.15, 43.13, 47.94, 51.27],
    [15.63, 27.55, 33.55, 43.38, 48.12, 51.17],
]
U1 = [
    [0.3569, 0.1808, 0.1292, 0.7077, 0.2070, 0.2104, 0.4850],
    [0.5248, 0.5016, 0.5723, 0.0368, 0.3019, 0.2289, 0.0218],
    [0.5538, 0.5238, 0.4761, 0.2561, 0.2881, 0.1890, 0.0894],
]
B11, B12, B22 = [1428.6, 750.0, 714.29], [845.15, 670.82, 668.15], [1500, 1400, 1375]
D2 = [
    [509.89, 148.67, 71.43, 185.14, -122.06, -196.46, -582.52],
    [393.60, 71.97, -71.83, -15.36, -382.91, -369.07, -40.90],
    [395.56, 56.45, -76.76, -115.94, -375.61, -311.47, -171.31],
]
U2 = [
    [0.6033, 0.1759, 0.0845, 0.2191, -0.1444, -0.2325, -0.6892],
    [0.5867, 0.1073, -0.1071, -0.0229, -0.5708, -0.5502, -0.0610],
    [0.5920, 0.0845, -0.1149, -0.1735, -0.5622, -0.4662, -0.2564],
]
PAIRS = [(0, 1), (0, 2), (1, 2)]


def digits(found, printed, decimals):
    """Say whether numbers are the printed ones at their precision."""
    assert np.asarray(found) == pytest.approx(np.asarray(printed), abs=0.5000001 * 10.0**-decimals)


def exact(chain):
    """Squared resonances and anti-resonances of the case study, by eigenvalues."""
    model = CHAINS.linear_model()
    return (
        np.concatenate([[0.0], resonances(model).squares]),
        anti_resonances(model, chain) ** 2,
    )


@pytest.fixture(scope="module")
def sampled():
    """The identification from unconstrained FRFs at 240 frequencies, nothing else given."""
    omega = np.linspace(1.5, 60.0, 240)
    return identify_chains(omega, chain_response(CHAINS, omega))


@pytest.fixture(scope="module", params=["eigenvalues", "FRFs"])
def spectrum(request):
    """Squared poles and zeros of a chain, from either source."""
    if request.param == "eigenvalues":
        return exact
    modes = request.getfixturevalue("sampled").modes
    poles = np.concatenate([[0.0], modes.omega**2])
    return lambda chain: (poles, modes.zeros[chain] ** 2)


@pytest.mark.parametrize("chain", range(3))
def test_5_and_6_lambda_and_lambda_0(spectrum, chain):
    poles, zeros = spectrum(chain)
    digits(np.sqrt(poles), LAMBDA, 2)
    digits(np.sqrt(zeros), LAMBDA_0[chain], 2)


@pytest.mark.parametrize("chain", range(3))
def test_13_to_16_first_lanczos_step(spectrum, chain):
    poles, zeros = spectrum(chain)
    first = first_components(poles, zeros)
    digits(first, U1[chain], 4)
    step = lanczos_step(poles, first)
    digits(step.b11, B11[chain], 1 if chain < 2 else 2)
    digits(step.b12, B12[chain], 2)
    digits(step.b22, B22[chain], 0)
    # The first is 509.88496, printed 509.89.
    assert step.d2 == pytest.approx(np.array(D2[chain]), abs=0.0051)
    digits(step.u2, U2[chain], 4)


@pytest.mark.parametrize("chain", range(3))
@pytest.mark.parametrize("per_step", [1, 2])
def test_17_to_22_masses_and_springs(spectrum, chain, per_step):
    poles, zeros = spectrum(chain)
    total = MASSES[chain].sum()  # (2)
    steps = stepwise_chain(poles, zeros, MASSES[chain, 0], 3, total, per_step=per_step)
    assert steps.masses == pytest.approx(MASSES[chain], rel=1e-10)  # m9 = 9.0, printed 8.9
    assert steps.springs == pytest.approx(SPRINGS[chain], rel=1e-10)
    squares = first_components(poles, zeros) ** 2
    masses, springs = lanczos_chain(poles, squares, MASSES[chain, 0], 3, total)
    assert masses == pytest.approx(MASSES[chain], rel=1e-10)
    assert springs == pytest.approx(SPRINGS[chain], rel=1e-10)


def test_22_m9_is_8_point_9_only_for_the_printed_gain():
    rounded = 1 / round(1 / MASSES[2].sum(), 3)
    # Printed with one decimal; 1/0.042 - 15 = 8.81, so A_3L had a digit more than was printed.
    assert rounded - 15 == pytest.approx(8.81, abs=0.005)
    poles, zeros = exact(2)
    assert stepwise_chain(poles, zeros, 7.0, 3, MASSES[2].sum()).masses[2] == pytest.approx(
        9.0, abs=1e-9
    )


def low_frequency(held, i, j):
    """The gain of motor i per motor j well below all resonances, [1/kg]."""
    return chain_response(CHAINS, np.array([1e-3]), held)[0, i, j]


def test_2_low_frequency_gains_with_the_other_chains_held():
    found = [low_frequency([j for j in range(3) if j != i], i, i).real for i in range(3)]
    digits(found, [0.175, 0.067, 0.042], 3)
    digits(20 * np.log10(found[0]), -15.1, 1)
    assert found == pytest.approx(1 / MASSES.sum(axis=1), rel=1e-6)


def test_2_does_not_hold_unconstrained():
    assert low_frequency([], 0, 0).real != pytest.approx(1 / MASSES[0].sum(), rel=1e-2)


def test_3_high_frequency_gains():
    found = np.diag(chain_response(CHAINS, np.array([1e5]))[0].real)
    digits(found[1:], [0.250, 0.143], 3)
    # Printed as 1.431 and 1.430; read from a figure, as its 3.1 dB is.
    digits(20 * np.log10(found[0]), 3.1, 1)
    assert found[0] == pytest.approx(1.431, abs=3e-3)


def test_7_and_8_couplings_from_cross_gains_with_the_third_chain_held():
    low = 1 / MASSES.sum(axis=1)
    gains = [low_frequency([3 - i - j], i, j) for i, j in PAIRS]
    digits(np.abs(gains), [0.012, 0.015, 0.009], 3)
    couplings = [
        coupled_inertia(gain, low[i], low[j]) for gain, (i, j) in zip(gains, PAIRS, strict=True)
    ]
    assert couplings == pytest.approx([1.0, 2.0, 3.0], rel=1e-6)


def test_8_negative_couplings_keep_their_sign():
    signs = np.array([[0, -1, 1], [-1, 0, -1], [1, -1, 0]])
    chains = CoupledChains(MASSES, SPRINGS, COUPLINGS * signs)
    low = 1 / MASSES.sum(axis=1)
    for i, j in PAIRS:
        gain = chain_response(chains, np.array([1e-3]), [3 - i - j])[0, i, j]
        assert coupled_inertia(gain, low[i], low[j]) == pytest.approx(
            COUPLINGS[i, j] * signs[i, j], rel=1e-6
        )


def test_4_and_9_are_not_needed_with_all_unconstrained_responses(sampled):
    """(-omega^2 G)^-1 goes to the rigid inertia matrix: sums of masses and couplings."""
    assert sampled.modes.inertia == pytest.approx(np.diag(MASSES.sum(axis=1)) + COUPLINGS, rel=1e-9)
    digits(sampled.modes.low_gains, [0.175, 0.067, 0.042], 3)
    digits([abs(sampled.modes.cross_gain(i, j)) for i, j in PAIRS], [0.012, 0.015, 0.009], 3)


def test_all_18_parameters_from_frfs_alone(sampled):
    assert sampled.n_masses == 3  # proposed, not given
    assert sampled.masses == pytest.approx(MASSES, rel=1e-9)
    assert sampled.springs == pytest.approx(SPRINGS, rel=1e-9)
    assert sampled.couplings == pytest.approx(COUPLINGS, rel=1e-8)


def test_3_4_erratum_theta_2_follows_from_tau_2():
    """The paper prints theta_2 = theta_1 - tau_1/K_1; the force in the spring is tau_2."""
    omega = np.array([7.0, 20.0, 33.0])
    K, M = CHAINS.linear_model().stiffness, CHAINS.linear_model().mass
    motion = np.linalg.solve(
        K - omega[:, None, None] ** 2 * M, np.broadcast_to(np.eye(9)[:, :1], (3, 9, 1))
    )[..., 0]
    theta_1, theta_2 = motion[:, 0], motion[:, 1]
    tau_1, m1, k1 = 1.0, 0.7, 1000.0
    tau_2 = tau_1 + m1 * omega**2 * theta_1
    assert theta_1 - tau_2 / k1 == pytest.approx(theta_2, rel=1e-12)
    assert not np.allclose(theta_1 - tau_1 / k1, theta_2, rtol=1e-2)


def test_3_4_remaining_spectra_are_those_of_the_chains_without_first_mass():
    poles, zeros = exact(0)
    first = first_components(poles, zeros)
    left, weights = without_first_mass(poles, first**2, MASSES[0, 0])
    keep = np.arange(1, 9)
    model = CHAINS.linear_model()
    K = model.stiffness[np.ix_(keep, keep)].copy()
    K[0, 0] -= SPRINGS[0, 0]
    M = model.mass[np.ix_(keep, keep)]
    expected = np.sort(np.linalg.eigvals(np.linalg.solve(M, K)).real)[3:]
    assert left[1:] == pytest.approx(expected, rel=1e-9)
    inner = np.arange(1, 8)
    locked = np.linalg.eigvals(np.linalg.solve(M[np.ix_(inner, inner)], K[np.ix_(inner, inner)]))
    assert zeros_between(left, weights)[0] == pytest.approx(np.sort(locked.real)[2:], rel=1e-9)
