"""The Nyquist curve of all loops at once: stability by encirclements of the determinant.

Along a contour around all growing motions det(1 + F G) turns about the origin as often, against the
clock, as the open loop has unstable poles more than the closed one (Skogestad and Postlethwaite
2005, theorem 4.9). The contour is shifted by a small growth to the right, so that integrators and
rigid motions lie outside it; delays are exact.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.linear.linear_model import LinearModel
from robotmodels.linear.response import Elastic
from robotmodels.simulation.linear_feedback import LinearFeedback
from robotmodels.simulation.loop_plant import LoopPlant, checked_models, loop_plant

GROWTH = 1e-3
"""Motions that grow more slowly do not count [1/s]."""
_STEP, _ROUNDS, _LINES = 0.3, 60, 400
"""Change of ln det between frequencies, how often these are halved, how many to begin with."""


@dataclass(frozen=True, eq=False)
class DeterminantLocus:
    """$det(1 + F G)$ in one position, and the Nyquist criterion of its stability.

    Attributes
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies, from zero frequency.
    values : ndarray of complex, (F,)
        Determinants.
    open_unstable : int
        Unstable poles of robot and controller, not connected.
    encirclements : int
        Encirclements of the origin, counter-clockwise, by frequencies of both signs.
    """

    omega: Array
    values: ComplexArray
    open_unstable: int
    encirclements: int

    @property
    def unstable(self) -> int:
        """Number of unstable poles of the closed loop."""
        return self.open_unstable - self.encirclements

    @property
    def stable(self) -> bool:
        """Whether there is none."""
        return self.unstable == 0


def determinant_loci(
    robot: Elastic, positions: Array, feedback: LinearFeedback, parameters: Array | None = None
) -> tuple[DeterminantLocus, ...]:
    """Return the curve about the equilibrium at each of `positions` (Q, n).

    Raises
    ------
    InvalidInput, NoEquilibrium
        As `loop_margins`.
    """
    models = checked_models(robot, positions, feedback, parameters)
    return tuple(_locus(models.at(i), feedback) for i in range(len(models.mass)))


def _locus(model: LinearModel, feedback: LinearFeedback) -> DeterminantLocus:
    time = feedback.sample_time
    plant = loop_plant(model, time)
    poles = np.concatenate([np.linalg.eigvals(plant.A), np.linalg.eigvals(feedback.A)])
    edge = GROWTH if time is None else np.exp(GROWTH * time)
    outside = (poles.real if time is None else np.abs(poles)) > edge
    respond, eye = plant.response(), np.eye(model.inputs)

    def determinant(omega: Array) -> ComplexArray:
        shifted: ComplexArray = np.asarray(omega - 1j * GROWTH)
        loop = feedback.response(shifted) @ respond(shifted)
        return np.asarray(np.linalg.det(eye + loop))

    omega, values = _refined(determinant, _first_frequencies(plant, poles))
    turned = float(np.angle(values[1:] / values[:-1]).sum()) / np.pi
    return DeterminantLocus(omega, values, int(outside.sum()), round(turned))


def _refined(
    determinant: Callable[[Array], ComplexArray], omega: Array
) -> tuple[Array, ComplexArray]:
    """Return frequencies between which the curve hardly changes, and the curve there."""
    values = determinant(omega)
    for _ in range(_ROUNDS):
        i = np.flatnonzero(np.abs(np.log(values[1:] / values[:-1])) > _STEP)
        if not i.size:
            break
        middle = (omega[i] + omega[i + 1]) / 2
        omega = np.insert(omega, i + 1, middle)
        values = np.insert(values, i + 1, determinant(middle))
    return omega, values


def _first_frequencies(plant: LoopPlant, poles: ComplexArray) -> Array:
    """Return angular frequencies from zero to where nothing responds any more, or to Nyquist's."""
    time = plant.sample_time
    if time is not None:
        poles = np.asarray(np.log(np.where(np.abs(poles) > 1e-12, poles, 1e-12 + 0j)) / time)
    high = 1e4 * np.abs(poles).max(initial=1.0) if time is None else np.pi / time
    near = np.abs(poles.imag)
    near = near[(near > GROWTH) & (near < high)]
    return np.unique(np.concatenate([[0.0], np.geomspace(GROWTH / 30, high, _LINES), near]))
