"""The narrow waist: its shapes, and its answers against two masses on a spring."""

import numpy as np
import pytest
from derivatives import frf_derivatives

from robotmodels import InvalidInput, LinearModel, sensitivity
from robotmodels.description.parameters import Parameters
from robotmodels.linear.linear_model import Channels, Measurement
from robotmodels.linear.spring_network import SpringNetwork

MASS, SPRING, DAMPER, RATIO = (2.0, 3.0), 500.0, 0.4, 10.0
OMEGA = np.array([1.0, 15.0, 20.4, 90.0])


def two_masses(measurement: Measurement | None = None) -> LinearModel:
    between = np.array([[1.0, -1.0], [-1.0, 1.0]])
    selector = np.array([[0.0], [RATIO]])
    return LinearModel(np.diag(MASS), DAMPER * between, SPRING * between, selector, measurement)


def expected() -> np.ndarray:
    """Return motor torque to motor acceleration; the first mass hangs on the second."""
    s = 1j * OMEGA
    link = DAMPER * s + SPRING
    hanging = MASS[0] * s**2 * link / (MASS[0] * s**2 + link)
    return RATIO**2 * s**2 / (MASS[1] * s**2 + hanging)


def test_two_masses_on_a_spring() -> None:
    G = two_masses().frequency_response(OMEGA)
    assert G.shape == (4, 1, 1)
    np.testing.assert_allclose(G[:, 0, 0], expected(), rtol=1e-12)


def test_receptances_are_both_halves_of_the_response() -> None:
    rows = np.array([[[0.0, 1.0]], [[0.5, 0.0]], [[2.0, 0.1]]])
    model = two_masses(Measurement(*rows, torque=Channels.plain(np.array([1.3])), delay=1e-3))
    X, Z = model.receptances(OMEGA)
    outputs = model.measured.outputs(OMEGA)
    G = model.frequency_response(OMEGA)
    np.testing.assert_allclose(outputs @ X, G, rtol=1e-12)
    torques = model.selector * model.measured.torque.gain
    np.testing.assert_allclose(np.swapaxes(Z, -1, -2) @ torques, G, rtol=1e-12)


def test_one_of_many() -> None:
    one, rows = two_masses(), np.array([[[[0.0, 1.0]], [[0.5, 0.0]]]] * 3)
    many = LinearModel(
        np.stack([one.mass, 2 * one.mass]),
        one.damping,
        np.stack([one.stiffness, 3 * one.stiffness]),
        one.selector,
        Measurement(*rows, torque=Channels.plain(np.array([1.3]))),
    )
    G = many.frequency_response(OMEGA)
    for index in (0, 1):
        np.testing.assert_allclose(many.at(index).frequency_response(OMEGA), G[index], rtol=1e-14)


@pytest.mark.parametrize("name", ["mass", "damping", "stiffness"])
def test_sizes_must_fit_the_selector(name: str) -> None:
    arrays = {key: np.eye(2) for key in ("mass", "damping", "stiffness")} | {name: np.eye(3)}
    with pytest.raises(InvalidInput) as error:
        LinearModel(**arrays, selector=np.ones((2, 1)))
    assert str(error.value) == (
        f"{name}: shape (3, 3) does not fit the 2 coordinates of the selector"
    )


def test_its_arrays_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        two_masses().mass[0, 0] = 1.0


class Springs:
    """The least that sensitivities need: no equilibrium, hence no shift of it."""

    parameters = Parameters(("k", "c"), np.array([SPRING, DAMPER]), ("N/m", "N s/m"))

    def network(self, positions: np.ndarray, parameters: np.ndarray | None = None) -> SpringNetwork:
        theta, q = self.parameters.check(parameters), len(positions)
        return SpringNetwork(
            mass=np.tile(np.diag(MASS), (q, 1, 1)),
            damping=np.zeros((2, 2)),
            stiffness=np.zeros((q, 2, 2)),
            selector=np.array([[0.0], [RATIO]]),
            nodes=np.array([[0, 1]]),
            spring_stiffness=np.full((q, 1), theta[0]),
            spring_damping=np.full((q, 1), theta[1]),
            exponents=np.tile(np.eye(2), (q, 1, 1)),
            parameters=Parameters(("k", "c"), theta, self.parameters.units),
        )


def test_a_system_of_springs_alone_has_sensitivities_too() -> None:
    system, positions = Springs(), np.zeros((2, 1))
    G, J = sensitivity(system, positions, OMEGA)
    np.testing.assert_allclose(G[1, :, 0, 0], expected(), rtol=1e-12)
    changes = frf_derivatives(system, positions, OMEGA)
    scale = np.abs(J).max(axis=(0, 1, 2, 3))
    np.testing.assert_allclose(J / scale, changes / scale, rtol=0, atol=1e-6)
