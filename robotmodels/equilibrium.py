"""Static equilibrium: where gravity leaves an elastic arm whose motors stand still."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from robotmodels.arm import Arm
from robotmodels.arrays import Array, IntArray
from robotmodels.errors import NoEquilibrium

LARGEST_DEFLECTION = 0.5  # [rad] or [m]: beyond it a lumped spring is no model of elasticity

# Elongations (s,) -> spring torques (s,) and their slopes (s,).
SpringLaw = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Static equilibria of an arm.

    Attributes
    ----------
    coordinates : (Q, d) drives and torsions [rad or m].
    elongations : (Q, s) of the springs [rad or m].
    slopes : (Q, s) stiffnesses of the springs there [N m/rad or N/m].
    """

    coordinates: Array
    elongations: Array
    slopes: Array


def find_equilibrium(
    arm: Arm, start: Array, springs: Array, free: IntArray, law: SpringLaw, names: tuple[str, ...]
) -> Equilibrium:
    """Find the coordinates at which springs and gravity balance, by Newton's method.

    Parameters
    ----------
    arm : the elastic arm, d coordinates.
    start : (Q, d) coordinates with unloaded springs.
    springs : (s, d) elongation of each spring per coordinate.
    free : coordinates that the springs hold; the others are held by rigid drives.
    law : torques and slopes of the springs.
    names : of the springs, for errors.

    Raises
    ------
    NoEquilibrium : if a spring gives way, naming it, the position and its torque.
    """
    data = arm.model.createData()
    q = np.array(start, dtype=float)
    elongations = np.zeros((len(q), len(springs)))
    slopes = np.zeros_like(elongations)
    for i in range(len(q)):
        q[i] = _newton(arm.model, data, q[i], springs, free, law, names)
        elongations[i] = springs @ (q[i] - start[i])
        slopes[i] = law(elongations[i])[1]
    return Equilibrium(q, elongations, slopes)


def _newton(
    model: pin.Model,
    data: pin.Data,
    start: Array,
    springs: Array,
    free: IntArray,
    law: SpringLaw,
    names: tuple[str, ...],
) -> Array:
    a = springs[:, free]
    q = start.copy()
    for _ in range(30):
        torques, slopes = law(springs @ (q - start))
        residual = pin.computeGeneralizedGravity(model, data, q)[free] + a.T @ torques
        gravity = pin.computeGeneralizedGravityDerivatives(model, data, q)[np.ix_(free, free)]
        step = np.linalg.solve(gravity + (a.T * slopes) @ a, residual)
        q[free] -= step
        if np.abs(springs @ (q - start)).max(initial=0.0) > LARGEST_DEFLECTION:
            break
        if np.abs(step).max(initial=0.0) < 1e-13:
            _check_stable(gravity + (a.T * slopes) @ a, a, names, start)
            return q
    elongations = np.abs(springs @ (q - start))
    load = np.abs(np.linalg.pinv(a.T) @ pin.computeGeneralizedGravity(model, data, start)[free])
    worst = int(np.argmax(elongations))
    raise NoEquilibrium(
        f"no static equilibrium at position {np.round(start, 3).tolist()}: "
        f"spring {names[worst]!r} gives way under a gravity torque of {load[worst]:.4g} N m; "
        "it is too weak for the load"
    )


def _check_stable(stiffness: Array, a: Array, names: tuple[str, ...], start: Array) -> None:
    values, vectors = np.linalg.eigh(stiffness)
    if len(values) and values[0] <= 0:
        worst = int(np.argmax(np.abs(a @ vectors[:, 0])))
        raise NoEquilibrium(
            f"the equilibrium at position {np.round(start, 3).tolist()} is not stable: "
            f"gravity overcomes spring {names[worst]!r}, which is too weak for the load"
        )


def curvature(model: pin.Model, coordinates: Array) -> tuple[Array, Array]:
    """Return dM/dq_i and d(dg/dq)/dq_i, both (d, d, d) with i first, at one equilibrium.

    Central differences of Pinocchio's analytic mass matrix and gravity derivatives: the error,
    about 1e-9 of the result, is multiplied by deflections of 1e-3 where it is used.
    """
    data = model.createData()
    step = 1e-4
    mass, gravity = [], []
    for unit in np.eye(model.nv):
        plus, minus = coordinates + step * unit, coordinates - step * unit
        mass.append(
            (pin.crba(model, data, plus).copy() - pin.crba(model, data, minus)) / (2 * step)
        )
        gravity.append(
            (
                pin.computeGeneralizedGravityDerivatives(model, data, plus).copy()
                - pin.computeGeneralizedGravityDerivatives(model, data, minus)
            )
            / (2 * step)
        )
    return np.array(mass), np.array(gravity)
