"""Robots and chains with their FRFs, sensitivities and directions, and models that are wrong.

The plants of the simulated studies: nothing here is estimated.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

import estimators
import robotmodels
from estimators.fitting.fit_trust import model_directions
from estimators.fitting.linearise import residual_changes
from estimators.fitting.residuals import find_residual
from estimators.frf.frf_estimate import FrfEstimate, vec
from estimators.trust.directed_tests import Directions
from robotmodels.elastic.robot import ElasticRobot

NOISE = robotmodels.RelativeNoise(0.03, 0.01)
"""Of the mean over the blocks of one visit."""

OUTLIER = 10.0
"""Size of an outlier in standard deviations."""

FRICTION = {"moberg": (0.02, 20.0), "manutec": (0.4, 400.0)}
"""Coulomb friction of the first motor [N m], and its speed at the lowest line [rad/s]."""


@dataclass(frozen=True, eq=False)
class System:
    """A model at its true values, as far as studies look at it.

    Attributes
    ----------
    model : Elastic
    positions : (Q, n) [rad]
    omega : (F,) [rad/s]
    elements : (outputs and inputs)
        How many of the first outputs and inputs are measured.
    """

    name: str
    model: object
    positions: np.ndarray
    omega: np.ndarray
    elements: int

    def measured(self, per_element: np.ndarray) -> np.ndarray:
        """Return the measured block of (Q, F, m, n, ...)."""
        return per_element[:, :, : self.elements, : self.elements]

    def response(self) -> np.ndarray:
        return robotmodels.frequency_response(self.model, self.positions, self.omega)


@dataclass(frozen=True, eq=False)
class Linearisation:
    """A model about the values that its fit to noise-free FRFs ends at.

    Attributes
    ----------
    response, jacobian : (Q, F, m, n) and (Q, F, m, n, p)
    truth : (Q, F, m, n)
        The plant's FRF; the same as `response` where the model is right.
    shift : (p,)
        ln of the values over the true ones.
    directions : Directions
    """

    response: np.ndarray
    jacobian: np.ndarray
    truth: np.ndarray
    shift: np.ndarray
    directions: Directions


def _chain(masses: int = 3, last: float = 40.0) -> robotmodels.CoupledChains:
    shape = np.array([[5.0, 12.0, 9.0], [4.0, 10.0, 8.0]])
    springs = np.array([[2e5, 9e4], [1.5e5, 1.1e5]])
    return robotmodels.CoupledChains(shape, springs, np.array([[0, 1.5], [1.5, 0]]), springs / 2e3)


def _split_chain(stiffness: float) -> robotmodels.CoupledChains:
    """Return the chain with its last masses halved and joined by springs: a missing spring."""
    whole = _chain()
    masses = np.concatenate([whole.masses[:, :2], *[whole.masses[:, 2:] / 2] * 2], axis=1)
    springs = np.concatenate([whole.springs, np.full((2, 1), stiffness)], axis=1)
    return robotmodels.CoupledChains(masses, springs, whole.couplings, springs / 2e3)


@lru_cache
def system(name: str) -> System:
    """Return "moberg" (one element), "manutec" (3 x 3 of 6 x 6), "manutec6" or "chain" (2 x 2)."""
    if name == "moberg":
        return _moberg(60)
    if name.startswith("manutec"):
        positions = np.array([[-1.0, 0.3, 1.5, 0, -1.9, 0], [0.3, 0.8, 1.0, 0, 0.5, 0]])
        lines, elements = (30, 3) if name == "manutec" else (20, 6)
        omega = 2 * np.pi * np.linspace(4, 60, lines)
        return System(name, robotmodels.load_robot("manutec_r3"), positions, omega, elements)
    omega = 2 * np.pi * np.linspace(4, 60, 40)
    return System(name, _chain(), np.zeros((1, 1)), omega, 2)


def _moberg(lines: int) -> System:
    omega = 2 * np.pi * np.linspace(2, 70, lines)
    robot = robotmodels.load_robot("moberg_axis1")
    return System(f"moberg{lines}", robot, np.zeros((1, 1)), omega, 1)


@lru_cache(maxsize=64)
def linearisation(name: str, residual: str, wrong: str) -> Linearisation:
    """Return a system about the values to which a fit with the noise's weights tends."""
    plant, kind = system(name), find_residual(residual)
    model = plant.model
    truth, values = plant.response(), model.parameters.values
    if wrong:
        truth = WRONG[wrong].plant(plant)
        values = _limit(plant, residual, truth)
    at = robotmodels.sensitivity(model, plant.positions, plant.omega, values)
    used = np.ones(at[0].shape, dtype=bool)
    changes = residual_changes(kind, at[0], used)
    directions = model_directions(model, plant.positions, plant.omega, values, at, changes)
    return Linearisation(
        plant.measured(at[0]),
        plant.measured(at[1]),
        plant.measured(truth),
        np.log(values / model.parameters.values),
        _measured_directions(plant, directions, at[0].shape),
    )


def _limit(plant: System, residual: str, truth: np.ndarray) -> np.ndarray:
    """Return the values of a fit to noise-free FRFs; far from them where dampers vanish."""
    weights = np.zeros(truth.shape)
    variance = NOISE.variance(truth)
    relative = np.abs(truth) ** 2 if residual == "lls" else 1.0
    weights[:, :, : plant.elements, : plant.elements] = plant.measured(relative / variance)
    if residual == "lls":
        weights[np.abs(truth) ** 2 < 10 * variance] = 0
    count = np.ones(len(plant.positions), dtype=int)
    estimate = FrfEstimate(plant.positions, plant.omega, truth, variance, count)
    fit = estimators.fit(plant.model, estimate, residual, weights, max_evaluations=200)
    return fit.parameters.values


def _measured_directions(
    plant: System, directions: Directions, shape: tuple[int, ...]
) -> Directions:
    """Return the directions of the measured elements, without those that do not change them."""
    mask = np.zeros(shape[2:], dtype=bool)
    mask[: plant.elements, : plant.elements] = True
    columns = directions.columns[:, :, vec(mask)]
    seen = (columns != 0).any(axis=(0, 1, 2))
    single = columns.shape[-1]
    names = [directions.names[i] for i in np.flatnonzero(seen)]
    units = [directions.units[i] for i in np.flatnonzero(seen)]
    return replace(
        directions,
        names=(*names, *directions.names[single:]),
        units=(*units, *directions.units[single:]),
        columns=np.ascontiguousarray(columns[..., seen]),
        jacobian=np.ascontiguousarray(directions.jacobian[:, :, vec(mask)]),
    )


@dataclass(frozen=True)
class WrongModel:
    """A plant that differs from the model.

    Attributes
    ----------
    plant : function
        From the system to the plant's FRF.
    direction : str
        The tested direction that is the error's own, or none.
    size : float
        Its coefficient.
    """

    plant: Callable[[System], np.ndarray]
    direction: str = ""
    size: float = 0.0


def _delay(time: float) -> Callable[[System], np.ndarray]:
    def plant(s: System) -> np.ndarray:
        return s.response() * np.exp(-1j * s.omega * time)[:, None, None]

    return plant


def _changed(change: Callable[[object], object]) -> Callable[[System], np.ndarray]:
    """Return a plant with a changed robot file."""

    def plant(s: System) -> np.ndarray:
        robot = ElasticRobot(change(s.model.file), s.model.folder)
        values = dict(zip(s.model.parameters.names, s.model.parameters.values, strict=True))
        own = robot.parameters
        theta = [values.get(n, v) for n, v in zip(own.names, own.values, strict=True)]
        return robotmodels.frequency_response(robot, s.positions, s.omega, np.array(theta))

    return plant


def _payload(file: object) -> object:
    payload = file.payload
    return file.model_copy(
        update={"payload": payload.model_copy(update={"mass": 1.05 * payload.mass})}
    )


def _gear_ratio(file: object) -> object:
    first = file.motors[0]
    ratio = first.model_copy(update={"gear_ratio": 1.01 * first.gear_ratio})
    return file.model_copy(update={"motors": [ratio, *file.motors[1:]]})


def _with_spring(stiffness: float) -> Callable[[object], object]:
    """Return a change of the file: the last joint's link bends as well."""

    def change(file: object) -> object:
        last = file.springs[-1]
        more = last.model_copy(
            update={
                "name": "missing",
                "axis": "x" if file.payload is None else "y",
                "stiffness": stiffness,
                "damping": stiffness / 1e3,
            }
        )
        return file.model_copy(update={"springs": [*file.springs, more]})

    return change


def _hardening(file: object) -> object:
    """Return the file with gears that are 15 % softer unloaded and 25 % stiffer loaded."""
    content = file.model_dump(by_alias=True)
    for spring, torque in zip(content["springs"][1:], (1890.0, 540.0), strict=True):
        k = spring["stiffness"]
        spring["stiffness"] = {"low": 0.85 * k, "high": 1.25 * k, "torque": torque}
    return type(file).model_validate(content)


def _friction(s: System) -> np.ndarray:
    """Return the FRF with Coulomb friction of the first motor, by its describing function.

    A motor that moves with the speed amplitude v has the damper 4 F/(pi v) beside it. With a
    constant amplitude of acceleration, v falls with the frequency.
    """
    G = s.response()
    force, speed = FRICTION[s.name.rstrip("0123456789")]
    damper = 4 * force / (np.pi * speed * s.omega[0] / s.omega)
    first = G[..., :1, :]
    gain = damper / (1j * s.omega)
    return G - G[..., :, :1] @ first * (gain / (1 + gain * G[..., 0, 0]))[..., None, None]


def _split(stiffness: float) -> Callable[[System], np.ndarray]:
    def plant(s: System) -> np.ndarray:
        return robotmodels.frequency_response(_split_chain(stiffness), s.positions, s.omega)

    return plant


WRONG: dict[str, WrongModel] = {
    "delay .1 ms": WrongModel(_delay(1e-4), "delay", 1e-4),
    "delay .5 ms": WrongModel(_delay(5e-4), "delay", 5e-4),
    "payload +5 %": WrongModel(_changed(_payload), "payload.mass", 0.05),
    "gear ratio +1 %": WrongModel(_changed(_gear_ratio), "gear ratio of m1", 0.01),
    "hardening": WrongModel(_changed(_hardening)),
    "Coulomb friction": WrongModel(_friction),
    "missing spring, soft": WrongModel(_changed(_with_spring(1e6))),
    "missing spring, medium": WrongModel(_changed(_with_spring(1e7))),
    "missing spring, stiff": WrongModel(_changed(_with_spring(1e8))),
    "missing masses, soft": WrongModel(_split(3e5)),
    "missing masses, medium": WrongModel(_split(2e6)),
    "missing masses, stiff": WrongModel(_split(2e7)),
}
"""Plants that differ from the model, by name."""
