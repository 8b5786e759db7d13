"""Static equilibrium: where gravity leaves an elastic arm whose motors stand still."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from robotmodels.arrays import Array, IntArray
from robotmodels.description.spring_laws import SpringLaws
from robotmodels.elastic.arm import Arm
from robotmodels.errors import NoEquilibrium

LARGEST_DEFLECTION = 0.5  # [rad] or [m]: beyond it a lumped spring is no model of elasticity


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


def gravity(arm: Arm, coordinates: Array) -> tuple[Array, Array]:
    """Return gravity torques g, (Q, d), and dg/dq, (Q, d, d), at `coordinates` (Q, d)."""
    data = arm.model.createData()
    torques = np.empty(coordinates.shape)
    slopes = np.empty((*coordinates.shape, coordinates.shape[1]))
    for i, q in enumerate(coordinates):
        slopes[i] = pin.computeGeneralizedGravityDerivatives(arm.model, data, q)
        torques[i] = data.g  # a by-product
    return torques, slopes


def gravity_torques(arm: Arm, coordinates: Array) -> Array:
    """Return gravity torques g, (Q, d), at `coordinates` (Q, d)."""
    data = arm.model.createData()
    torques = np.empty(coordinates.shape)
    for i, q in enumerate(coordinates):
        torques[i] = pin.computeGeneralizedGravity(arm.model, data, q)
    return torques


def mass_matrices(arm: Arm, coordinates: Array) -> Array:
    """Return the mass matrices (Q, d, d) at `coordinates` (Q, d)."""
    data = arm.model.createData()
    mass = np.empty((*coordinates.shape, coordinates.shape[1]))
    for i, q in enumerate(coordinates):
        mass[i] = pin.crba(arm.model, data, q)
    return mass


def find_equilibrium(
    arm: Arm,
    start: Array,
    sprung: IntArray,
    held: IntArray,
    law: SpringLaws,
    *,
    springs: Sequence[str],
    places: Callable[[int], str],
) -> Equilibrium:
    """Find the coordinates at which springs and gravity balance, by Newton's method.

    Parameters
    ----------
    arm : the elastic arm, d coordinates.
    start : (Q, d) coordinates with unloaded springs.
    sprung : (s,) the coordinate that each spring holds.
    held : coordinates that rigid drives hold.
    law : of the springs.
    springs, places : what errors call the springs, and each of the Q positions.

    Raises
    ------
    NoEquilibrium : if a spring gives way, naming it, the position and its torque.
    """
    q = _first_guess(arm, start, sprung, law)
    moving = np.arange(len(q))  # positions whose Newton iteration has not ended
    for _ in range(30):
        torques, slopes = law((q - start)[np.ix_(moving, sprung)])
        residual, K = gravity(arm, q[moving])
        residual[:, sprung] += torques
        K[:, sprung, sprung] += slopes
        residual[:, held] = 0.0
        K[:, held, :] = K[:, :, held] = 0.0
        K[:, held, held] = 1.0
        try:
            step = np.linalg.solve(K, residual[..., None])[..., 0]
        except np.linalg.LinAlgError:  # singular, hence not stable either
            _check_stable(K, sprung, moving, springs, places)
            raise
        q[moving] -= step
        bent = np.abs(q - start)[np.ix_(moving, sprung)].max(axis=1, initial=0.0)
        if (bent > LARGEST_DEFLECTION).any():
            i = int(moving[np.argmax(bent)])
            raise _gives_way(arm, start[i], q[i], sprung, springs, places(i))
        # Newton's error is at most about the square of its last step: only rounding is left.
        done = np.abs(step).max(axis=1, initial=0.0) < 1e-8
        _check_stable(K[done], sprung, moving[done], springs, places)
        moving = moving[~done]
        if not len(moving):
            elongations = (q - start)[:, sprung]
            return Equilibrium(q, elongations, law(elongations)[1])
    i = int(moving[0])
    raise _gives_way(arm, start[i], q[i], sprung, springs, places(i))


def _first_guess(arm: Arm, start: Array, sprung: IntArray, law: SpringLaws) -> Array:
    """Return coordinates near the equilibrium by three cheap steps: each spring carries its load.

    A step leaves gravity's stiffness over the spring's, about a hundredth, of the error.
    """
    q = np.array(start, dtype=float)
    for _ in range(3):
        deflection = law.elongations(-gravity_torques(arm, q)[:, sprung])
        # Where a spring is weak, Newton does better from the unloaded coordinates.
        deflection[np.abs(deflection).max(axis=1, initial=0.0) > LARGEST_DEFLECTION] = 0.0
        q[:, sprung] = start[:, sprung] + deflection
    return q


def _gives_way(
    arm: Arm, start: Array, bent: Array, sprung: IntArray, springs: Sequence[str], place: str
) -> NoEquilibrium:
    worst = int(np.argmax(np.abs(bent - start)[sprung]))
    load = abs(gravity_torques(arm, start[None])[0, sprung[worst]])
    return NoEquilibrium(
        f"no static equilibrium at {place}: {springs[worst]} gives way under a gravity torque of "
        f"{load:.4g} N m; it is too weak for the load"
    )


def _check_stable(
    stiffness: Array,
    sprung: IntArray,
    at: IntArray,
    springs: Sequence[str],
    places: Callable[[int], str],
) -> None:
    try:
        np.linalg.cholesky(stiffness)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(stiffness)
        i = int(np.argmin(values[:, 0]))
        worst = int(np.argmax(np.abs(vectors[i, sprung, 0])))
        raise NoEquilibrium(
            f"the equilibrium at {places(int(at[i]))} is not stable: gravity overcomes "
            f"{springs[worst]}, which is too weak for the load"
        ) from None
