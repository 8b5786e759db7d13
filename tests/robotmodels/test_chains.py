from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from derivatives import by_logarithms

import estimators
import robotmodels
from robotmodels import InvalidInput, RelativeNoise
from robotmodels.linear.coupled_chains import CoupledChains
from robotmodels.linear.modes import anti_resonances, clamped, resonances, rigid_modes

MASSES = np.array([[0.7, 2, 3], [4, 5, 6], [7, 8, 9]])
SPRINGS = np.array([[1000.0, 2000], [3000, 4000], [5000, 6000]])
COUPLINGS = np.array([[0.0, 1, 2], [1, 0, 3], [2, 3, 0]])
NEGATIVE = np.array([[0.0, -1, 2], [-1, 0, 3], [2, 3, 0]])
DAMPERS = np.array([[1.0, 2], [2, 3], [3, 1]])
NOWHERE = np.zeros((1, 0))
OMEGA = np.linspace(3.0, 60.0, 40)


@pytest.fixture
def case_study() -> CoupledChains:
    """[HBH] section 4."""
    return CoupledChains(MASSES, SPRINGS, COUPLINGS)


def with_dampers(*extra: str, couplings: np.ndarray = COUPLINGS) -> CoupledChains:
    return CoupledChains(MASSES, SPRINGS, couplings, DAMPERS, extra)


def test_hbh_section_4_resonances(case_study: CoupledChains) -> None:
    found = resonances(case_study.linear_model()).frequencies
    printed = [24.63, 29.59, 34.16, 44.92, 48.60, 51.28]
    assert found == pytest.approx(printed, abs=0.005)


@pytest.mark.parametrize(
    ("chain", "printed"),
    [
        (0, [13.11, 25.29, 29.75, 43.62, 46.88, 49.33]),
        (1, [14.93, 27.05, 34.15, 43.13, 47.94, 51.27]),
        (2, [15.63, 27.55, 33.55, 43.38, 48.12, 51.17]),
    ],
)
def test_hbh_section_4_anti_resonances(
    case_study: CoupledChains, chain: int, printed: list[float]
) -> None:
    found = anti_resonances(case_study.linear_model(), chain)
    assert found == pytest.approx(printed, abs=0.0051)


def test_hbh_2_and_3_gains_at_low_and_high_frequency(case_study: CoupledChains) -> None:
    model = case_study.linear_model()
    low = model.frequency_response(np.array([1e-2]))[0]
    # The rigid inertia matrix: sums of masses, and couplings with their signs.
    assert np.linalg.inv(low).real == pytest.approx(
        np.diag([5.7, 15.0, 24.0]) + COUPLINGS, rel=1e-5
    )
    high = model.frequency_response(np.array([1e6]))[0]
    assert np.diag(high).real == pytest.approx(1 / MASSES[:, 0], rel=1e-6)
    # Printed 1.431 (from 3.1 dB), 0.250, 0.143.
    assert 1 / MASSES[:, 0] == pytest.approx([1.431, 0.250, 0.143], abs=3e-3)


def test_hbh_10_is_the_printed_mass_and_spring_matrix(case_study: CoupledChains) -> None:
    model = case_study.linear_model()
    mass = np.diag([0.7, 2, 3, 4, 5, 6, 7, 8, 9])
    mass[2, 5] = mass[5, 2] = 1
    mass[2, 8] = mass[8, 2] = 2
    mass[5, 8] = mass[8, 5] = 3
    assert np.array_equal(model.mass, mass)
    block = np.array([[3000.0, -3000, 0], [-3000, 7000, -4000], [0, -4000, 4000]])
    assert model.stiffness[3:6, 3:6] == pytest.approx(block)
    assert not model.stiffness[3:6, [0, 1, 2, 6, 7, 8]].any()
    assert not model.damping.any()
    assert np.array_equal(np.argwhere(model.selector), [[0, 0], [3, 1], [6, 2]])


@pytest.mark.parametrize(("count", "length"), [(1, 2), (2, 3), (3, 4), (4, 2)])
def test_counts_of_poles_and_zeros(count: int, length: int) -> None:
    rng = np.random.default_rng(count)
    couplings = rng.uniform(-1, 1, (count, count)) / count
    couplings = couplings + couplings.T
    np.fill_diagonal(couplings, 0.0)
    chains = CoupledChains(
        rng.uniform(2, 4, (count, length)), rng.uniform(500, 2000, (count, length - 1)), couplings
    )
    model = chains.linear_model()
    assert np.abs(rigid_modes(model).squares).max() < 1e-8
    assert len(rigid_modes(model).squares) == count
    assert (resonances(model).squares > 1.0).all()
    assert len(resonances(model).squares) == count * (length - 1)
    for chain in range(count):
        zeros = clamped(model, chain)
        assert len(anti_resonances(model, chain)) == count * (length - 1)
        # The count - 1 zeros at zero cancel as many of the rigid poles.
        assert np.abs(rigid_modes(zeros).squares).max(initial=0.0) < 1e-8


def test_dampers_are_parallel_to_springs() -> None:
    model = with_dampers().linear_model()
    laplacian = CoupledChains(MASSES, DAMPERS, COUPLINGS).linear_model().stiffness
    assert np.array_equal(model.damping, laplacian)


def test_parameters_are_named_in_order_of_coordinates() -> None:
    parameters = with_dampers("m1", "m3_6").parameters
    assert parameters.names[:8] == ("K1", "K2", "K3", "K4", "K5", "K6", "c1", "c2")
    assert parameters.names[12:] == ("m1", "m3_6")
    expected = [*SPRINGS.ravel(), *DAMPERS.ravel(), 0.7, 1.0]
    assert parameters.values == pytest.approx(expected)
    assert parameters.units[0] == "N/m"
    assert parameters.units[6] == "N s/m"
    assert parameters.units[-1] == "kg"
    assert len(CoupledChains(MASSES, SPRINGS, COUPLINGS).parameters) == 6


def test_at_changes_what_is_free_and_nothing_else() -> None:
    chains = with_dampers("m1", "m3_6")
    theta = chains.parameters.values * np.linspace(0.9, 1.1, 14)
    moved = chains.at(theta)
    assert moved.parameters.values == pytest.approx(theta)
    assert moved.mass_matrix[0, 0] == pytest.approx(0.7 * theta[12] / 0.7)
    assert moved.couplings[0, 1] == moved.couplings[1, 0] == pytest.approx(theta[13])
    assert np.array_equal(moved.masses.ravel()[1:], MASSES.ravel()[1:])
    assert moved.couplings[0, 2] == 2.0
    assert chains.at() is chains


def test_undamped_chains_elsewhere(case_study: CoupledChains) -> None:
    twice = case_study.at(2 * case_study.parameters.values)
    assert twice.dampers is None
    expected = np.sqrt(2) * resonances(case_study.linear_model()).frequencies
    assert resonances(twice.linear_model()).frequencies == pytest.approx(expected)


def test_a_negative_coupling_keeps_its_sign() -> None:
    chains = with_dampers(
        "m3_6", couplings=COUPLINGS * np.array([[0, -1, 1], [-1, 0, 1], [1, 1, 0]])
    )
    assert chains.parameters.values[-1] == 1.0
    theta = chains.parameters.values.copy()
    theta[-1] = 1.5
    assert chains.at(theta).couplings[0, 1] == -1.5


def test_every_position_is_alike() -> None:
    chains = with_dampers()
    G = robotmodels.frequency_response(chains, np.zeros((3, 7)), OMEGA)
    assert G.shape == (3, len(OMEGA), 3, 3)
    assert np.array_equal(G[0], G[2])
    assert G[0] == pytest.approx(chains.linear_model().frequency_response(OMEGA))


@pytest.mark.parametrize("extra", [(), ("m1", "m2", "m6", "m9", "m3_6", "m6_9")])
@pytest.mark.parametrize("equilibrium_shift", [True, False])
def test_sensitivities_against_central_differences(
    extra: tuple[str, ...], equilibrium_shift: bool
) -> None:
    chains = with_dampers(*extra, couplings=NEGATIVE)
    theta = chains.parameters.values * 1.2
    J = robotmodels.sensitivity(chains, NOWHERE, OMEGA, theta, equilibrium_shift=equilibrium_shift)[
        1
    ]
    changes = by_logarithms(
        lambda at: robotmodels.frequency_response(chains, NOWHERE, OMEGA, at), theta
    )
    assert np.abs(J - changes).max() < 1e-6 * np.abs(J).max()


def test_sensitivities_without_dampers(case_study: CoupledChains) -> None:
    J = robotmodels.sensitivity(case_study, NOWHERE, OMEGA)[1]
    damped = CoupledChains(MASSES, SPRINGS, COUPLINGS, np.full((3, 2), 1e-9))
    expected = robotmodels.sensitivity(damped, NOWHERE, OMEGA)[1][..., :6]
    assert np.abs(J - expected).max() < 1e-5 * np.abs(J).max()


def test_a_fit_finds_springs_dampers_and_inertias_again() -> None:
    chains = with_dampers("m2", "m3_6")
    rng = np.random.default_rng(5)
    noise = RelativeNoise(1e-3, 1e-4)
    estimate = estimators.simulate_frf(chains, NOWHERE, OMEGA, noise, rng)
    start = chains.parameters.values * rng.uniform(0.9, 1.1, len(chains.parameters))
    fit = estimators.fit(chains, estimate, residual="nls", weights="optimal", start=start)
    assert fit.converged
    error = np.log(fit.parameters.values / chains.parameters.values)
    std = estimators.covariance(fit).std
    assert (np.abs(error) < 5 * std).all()
    assert np.abs(error).max() < 0.05
    assert np.abs(np.log(start / chains.parameters.values)).max() > 0.05  # it did move


def test_frozen_with_its_arrays(case_study: CoupledChains) -> None:
    with pytest.raises(FrozenInstanceError):
        case_study.masses = MASSES  # type: ignore[misc]
    for array in (case_study.masses, case_study.couplings, case_study.mass_matrix):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1.0


def changed(array: np.ndarray, at: tuple[int, int], value: float) -> np.ndarray:
    array = np.array(array, dtype=float)
    array[at] = value
    return array


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"masses": MASSES[0]}, r"masses: shape \(3,\) given; \(M, N\) is needed"),
        ({"masses": MASSES[:, :1]}, "at least two masses"),
        ({"springs": [[1.0, 2.0], [3.0]]}, r"springs: an array of real numbers is needed, found"),
        ({"springs": MASSES}, r"springs: shape \(3, 3\) given; \(3, 2\) is needed for 3 chains"),
        ({"couplings": np.zeros((2, 2))}, r"couplings: shape \(2, 2\) given; \(3, 3\) is needed"),
        ({"dampers": MASSES}, r"dampers: shape \(3, 3\) given; \(3, 2\)"),
        ({"masses": changed(MASSES, (1, 2), 0)}, r"masses\[1, 2\]: 0 is not a positive"),
        ({"springs": changed(SPRINGS, (2, 0), -5)}, r"springs\[2, 0\]: -5 is not a positive"),
        ({"dampers": changed(DAMPERS, (0, 1), np.nan)}, r"dampers\[0, 1\]: nan"),
        ({"couplings": changed(COUPLINGS, (0, 1), 4)}, r"couplings\[0, 1\]: 4, and \[1, 0\]: 1"),
        ({"couplings": changed(COUPLINGS, (1, 1), 4)}, r"couplings\[1, 1\]: 4.*zero diagonal"),
        ({"couplings": changed(COUPLINGS, (1, 1), np.nan)}, r"couplings\[1, 1\]: nan"),
        (
            {"couplings": np.array([[0.0, 1, 2], [1, 0, 7.5], [2, 7.5, 0]])},
            r"couplings\[1, 2\]: 7.5 kg is too large for the last masses 6 and 9 kg",
        ),
        ({"extra": ("m10",)}, r"extra: 'm10' is not a mass or a non-zero coupling .*'m1'"),
        ({"extra": ("m2", "m2")}, "extra: 'm2' is named twice"),
    ],
)
def test_bad_input(change: dict[str, object], message: str) -> None:
    good: dict[str, object] = {"masses": MASSES, "springs": SPRINGS, "couplings": COUPLINGS}
    with pytest.raises(InvalidInput, match=message):
        CoupledChains(**(good | change))  # type: ignore[arg-type]


def test_parameters_that_make_the_mass_matrix_indefinite() -> None:
    chains = with_dampers("m3_6")
    theta = chains.parameters.values.copy()
    theta[-1] = 10.0
    with pytest.raises(InvalidInput, match="not positive definite"):
        chains.network(NOWHERE, theta)
