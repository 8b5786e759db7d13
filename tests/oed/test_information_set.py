from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import h5py
import numpy as np
import pytest
from derivatives import apart, frf_derivatives, information_of
from hypothesis import given, strategies as st
from random_candidates import information_set, random_set

from oed import InformationSet, candidate_positions, information, sobol_positions
from oed.information_sets.null_space import open_combinations, unidentifiable, weak_directions
from robotmodels import (
    InvalidInput,
    Parameters,
    RelativeNoise,
    SpringNetwork,
    frequency_response,
    load_robot,
    sensitivity,
)

OMEGA = 2 * np.pi * np.linspace(1.0, 8.0, 10)
NAMES = ("k", "c")


@dataclass(frozen=True, eq=False)
class TwoMasses:
    """A motor and a load, whose inertia is the position, on a spring and a damper."""

    parameters = Parameters(NAMES, np.array([300.0, 2.0]), ("N m/rad", "N m s/rad"))

    def network(self, positions, parameters=None):
        k, c = self.parameters.check(parameters)
        q = len(positions)
        mass = np.zeros((q, 2, 2))
        mass[:, 0, 0] = 0.4
        mass[:, 1, 1] = positions[:, 0]
        return SpringNetwork(
            mass=mass,
            damping=np.zeros((q, 2, 2)),
            stiffness=np.zeros((q, 2, 2)),
            selector=np.array([[1.0], [0.0]]),
            nodes=np.array([[0, 1]]),
            spring_stiffness=np.full((q, 1), k),
            spring_damping=np.full((q, 1), c),
            exponents=np.tile(np.eye(2), (q, 1, 1)),
            parameters=self.parameters,
        )


POSITIONS = np.linspace(0.5, 2.0, 7)[:, None]
NOISE = RelativeNoise(0.03, 0.01)


def reference_information():
    """2 sum_F Re(conj(Psi) Psi^T)/var, spelled out."""
    G, J = TwoMasses().network(POSITIONS).sensitivity(OMEGA)
    weight = 1 / NOISE.variance(G)
    return 2 * np.einsum("qfmna,qfmn,qfmnb->qab", J.conj(), weight, J).real


def test_information_is_chunk_by_chunk_that_of_the_reference():
    seen = []
    info = information(
        TwoMasses(), POSITIONS, OMEGA, NOISE, chunk=3, progress=lambda *done: seen.append(done)
    )
    # k and c are a quarter period apart: what is left beside the diagonal is rounding.
    np.testing.assert_allclose(info.matrices, reference_information(), rtol=1e-9, atol=1e-6)
    np.testing.assert_array_equal(info.positions, POSITIONS)
    assert info.names == NAMES
    assert seen == [(3, 7), (6, 7), (7, 7)]


def test_an_executor_serves_alike():
    here = information(TwoMasses(), POSITIONS, OMEGA, NOISE)
    with ThreadPoolExecutor(2) as executor:
        there = information(TwoMasses(), POSITIONS, OMEGA, NOISE, chunk=2, executor=executor)
    np.testing.assert_allclose(there.matrices, here.matrices, rtol=1e-13)


def test_parameters_that_are_no_springs_inform_too():
    """Motor inertias of a robot, by central differences; they do not move the equilibrium."""
    robot = load_robot("manutec_r3_26")
    inertias = [i for i, name in enumerate(robot.parameters.names) if name.endswith(".inertia")]
    positions = candidate_positions(robot, 1) + np.array([[0.1], [0.3]])
    matrices = information(robot, positions, OMEGA, NOISE).matrices
    changes = frf_derivatives(robot, positions, OMEGA)
    variance = NOISE.variance(frequency_response(robot, positions, OMEGA))
    expected = information_of(changes, variance)[:, inertias, inertias]
    assert expected.size
    np.testing.assert_allclose(matrices[:, inertias, inertias], expected, rtol=1e-4)


@pytest.mark.parametrize("count", [2, 70])
def test_information_with_equilibria_that_shift_is_that_of_exact_sensitivities(count):
    robot = load_robot("panda")
    positions = 0.5 * sobol_positions(robot, count) + 0.5 * robot.position_limits.mean(axis=1)
    G, J = sensitivity(robot, positions, OMEGA[:2])
    expected = information_of(J, NOISE.variance(G))
    exact = information(robot, positions, OMEGA[:2], NOISE, equilibrium_shift=True).matrices
    held = information(robot, positions, OMEGA[:2], NOISE).matrices
    assert apart(exact, expected) < 1e-12
    assert apart(held, expected) > 1e-6


def test_information_refuses_empty_work():
    with pytest.raises(InvalidInput, match="positions: none given"):
        information(TwoMasses(), np.empty((0, 1)), OMEGA, NOISE)
    with pytest.raises(InvalidInput, match="chunk: 0 positions"):
        information(TwoMasses(), POSITIONS, OMEGA, NOISE, chunk=0)
    with pytest.raises(InvalidInput, match=r"information .a `store` keeps .* GB are needed"):
        information(TwoMasses(), np.broadcast_to(POSITIONS[:1], (10**12, 1)), OMEGA, NOISE)


class NoNumbers:
    """A noise law that fails in the third position."""

    def weights(self, network, omega):
        bad = np.ones((len(network.mass), len(omega), 1, 1), dtype=complex)
        bad[2] = np.nan
        return bad


def test_computed_matrices_are_symmetric_and_finite():
    matrices = information(TwoMasses(), POSITIONS, OMEGA, NOISE).matrices
    np.testing.assert_array_equal(matrices, np.swapaxes(matrices, 1, 2))
    with pytest.raises(InvalidInput, match=r"candidate 2 has a matrix that is not finite \(1 of 7"):
        information(TwoMasses(), POSITIONS, OMEGA, NoNumbers())


def test_arrays_are_copies_that_nobody_can_change():
    matrices = np.tile(np.eye(2), (3, 1, 1))
    info = information_set(matrices)
    matrices[0] = 0.0
    np.testing.assert_array_equal(info.matrices[0], np.eye(2))
    with pytest.raises(ValueError, match="read-only"):
        info.matrices[0, 0, 0] = 2.0
    assert len(info) == 3


def test_save_and_load(tmp_path):
    info = random_set(0, 5, 3, 2)
    info.save(tmp_path / "information.h5")
    again = InformationSet.load(tmp_path / "information.h5")
    np.testing.assert_array_equal(again.matrices, info.matrices)
    np.testing.assert_array_equal(again.positions, info.positions)
    assert again.names == info.names
    assert [file.name for file in tmp_path.iterdir()] == ["information.h5"]


def test_load_names_the_file_and_what_is_wrong(tmp_path):
    with pytest.raises(InvalidInput, match=r"nowhere\.h5: no such file"):
        InformationSet.load(tmp_path / "nowhere.h5")
    (tmp_path / "text.h5").write_text("no")
    with pytest.raises(InvalidInput, match=r"text\.h5: not an HDF5 file"):
        InformationSet.load(tmp_path / "text.h5")
    with h5py.File(tmp_path / "part.h5", "w") as file:
        file["positions"] = np.zeros((1, 1))
    with pytest.raises(InvalidInput, match=r"part\.h5: 'matrices', 'names' are missing"):
        InformationSet.load(tmp_path / "part.h5")
    information_set(np.ones((1, 1, 1))).save(tmp_path / "negative.h5")
    with h5py.File(tmp_path / "negative.h5", "r+") as file:
        file["matrices"][:] = -1.0
    with pytest.raises(InvalidInput, match=r"negative\.h5: candidate 0 has a matrix"):
        InformationSet.load(tmp_path / "negative.h5")


def one_wrong(entry):
    matrices = np.tile(np.diag([1.0, 1e6]), (4, 1, 1))
    matrices[2] = entry
    return matrices


@pytest.mark.parametrize(
    ("matrices", "message"),
    [
        (one_wrong([[1, np.nan], [0, 1]]), r"candidate 2 has a matrix that is not finite \(1 of 4"),
        (
            one_wrong([[1e-300, 1e300], [1e300, 1e-300]]),
            "candidate 2 has a matrix that is not positive semidefinite",
        ),
        (one_wrong([[1, 0.1], [0.2, 1]]), "candidate 2 has a matrix that is not symmetric"),
        (one_wrong([[1, 2], [2, 1]]), "candidate 2 has a matrix that is not positive semi"),
        (one_wrong([[1, 0], [0, -1]]), "candidate 2 has a matrix that is not positive semi"),
        (one_wrong([[0, 1], [1, 0]]), "candidate 2 has a matrix that is not positive semi"),
        (one_wrong([[0, 1], [1, 1]]), "candidate 2 has a matrix that is not positive semi"),
        # Small in its parameter's unit, not small for that parameter.
        (one_wrong([[1e-9, 2], [2, 1e9]]), "candidate 2 has a matrix that is not positive semi"),
        (np.ones((4, 2, 3)), r"matrices: shape \(4, 2, 3\) does not fit 2 names"),
        (np.ones((0, 2, 2)), "matrices: none given"),
    ],
)
def test_errors_name_the_candidate(matrices, message):
    with pytest.raises(InvalidInput, match=message):
        InformationSet(np.zeros((len(matrices), 1)), matrices, ("a", "b"))


def test_a_wrong_matrix_is_found_far_behind():
    matrices = np.tile(np.eye(2), (500, 1, 1))
    matrices[[300, 400]] = [[1, 2], [2, 1]]
    with pytest.raises(InvalidInput, match=r"candidate 300 has .* semidefinite \(2 of 500 do\)"):
        InformationSet(np.zeros((500, 1)), matrices, ("a", "b"))


def test_errors_of_positions_and_names():
    eye = np.tile(np.eye(2), (4, 1, 1))
    with pytest.raises(InvalidInput, match=r"positions: shape \(3, 1\) does not fit 4 matrices"):
        InformationSet(np.zeros((3, 1)), eye, ("a", "b"))
    with pytest.raises(InvalidInput, match="candidate 1 has a position that is not finite"):
        InformationSet(np.array([[0.0], [np.inf], [0], [0]]), eye, ("a", "b"))
    with pytest.raises(InvalidInput, match="names"):
        InformationSet(np.zeros((4, 1)), eye, ("a", "a"))


def test_rounding_is_no_indefiniteness():
    noise = 1e-17 * np.array([[0, 1.0], [1.3, 1e-20]])
    assert information_set([1e40 * (np.diag([1.0, 0]) + noise)]).rank == 1
    J = np.random.default_rng(3).standard_normal((50, 8, 2)) * np.logspace(-6, 6, 8)[:, None]
    assert information_set(J @ np.swapaxes(J, 1, 2)).rank == 8


@given(seed=st.integers(0, 10**6), spread=st.floats(0, 6))
def test_open_directions_are_found_whatever_the_units(seed, spread):
    """Only the sum of k0 and k2 shows, and k3 not at all."""
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((5, 20))
    J[2] = J[0]
    J[3] = 0.0
    scale = 10.0 ** rng.uniform(-spread, spread, 5)
    matrix = scale[:, None] * (J @ J.T) * scale
    assert unidentifiable(matrix, "abcde") == ("a", "c", "d")
    assert weak_directions(matrix).shape == (5, 2)


def test_rank_of_a_set():
    info = information_set([np.diag([1.0, 0, 0]), np.diag([0, 0, 2.0])])
    assert info.rank == 2
    assert info.unidentifiable() == ("k1",)
    assert info.unidentifiable(info.matrices[0]) == ("k1", "k2")


def test_open_combinations_in_words():
    J = np.array([[1.0, -1.0, 0, 0, 0], [0, 0, 1.0, 2.0, 0]])
    names = ("a", "b", "c", "d", "e")
    assert open_combinations(J.T @ J, names) == ("a + b", "c - 0.5 d", "e")
    assert open_combinations(np.eye(5), names) == ()
    assert open_combinations(np.zeros((5, 5)), names) == names
    info = InformationSet(np.zeros((1, 1)), [J.T @ J], names)
    assert info.open_combinations() == ("a + b", "c - 0.5 d", "e")
    # Each is told by no experiment, whatever the units.
    scale = np.exp(np.random.default_rng(0).standard_normal(5))
    scaled = J * scale
    assert open_combinations(scaled.T @ scaled, names)[2] == "e"


@dataclass(frozen=True, eq=False)
class Counted:
    """A robot that counts for how many positions it is asked."""

    robot: object
    asked: list

    @property
    def parameters(self):
        return self.robot.parameters

    def network(self, positions, parameters=None):
        self.asked.append(len(positions))
        return self.robot.network(positions, parameters)


class Independent:
    """Independent errors, told as the general way wants them."""

    def weights(self, network, omega):
        variance = RelativeNoise().variance(network.frequency_response(omega))
        flat = np.swapaxes(variance, -1, -2).reshape(*variance.shape[:2], -1)
        return (np.eye(flat.shape[-1]) / flat[..., None]).astype(complex)


def test_the_general_way_finds_equilibria_once():
    robot = load_robot("ur5")
    positions = 0.2 * sobol_positions(robot, 70)
    for count in (10, 70):
        counted = Counted(robot, [])
        found = information(counted, positions[:count], OMEGA[:3], Independent())
        assert sum(counted.asked) <= count + 4
        same = information(robot, positions[:count], OMEGA[:3], RelativeNoise())
        largest = np.abs(same.matrices).max()
        np.testing.assert_allclose(found.matrices, same.matrices, atol=1e-12 * largest)


def test_no_information_at_all_leaves_every_parameter_open():
    assert information_set(np.zeros((2, 2, 2))).unidentifiable() == ("k0", "k1")


@pytest.mark.parametrize("seed", range(10))
def test_open_combinations_are_the_same_words_at_any_rounding(seed):
    rng = np.random.default_rng(seed)
    # a and b are seen by their sum only, and so are c and d; e is not seen at all.
    J = np.repeat(rng.normal(size=(20, 3)), [2, 2, 1], axis=1) * [1, 1, 1, 1, 0]
    matrix = J.T @ J * (1 + 1e-14 * rng.normal(size=(5, 5)))
    assert open_combinations((matrix + matrix.T) / 2, tuple("abcde")) == ("a - b", "c - d", "e")
