"""Static equilibrium: where gravity leaves an elastic arm whose motors stand still."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from robotmodels.arrays import Array, IntArray
from robotmodels.description.spring_laws import SpringLaws
from robotmodels.elastic.arm import Arm
from robotmodels.elastic.dynamics import Gravity, gravity, gravity_torques
from robotmodels.errors import NoEquilibrium

LARGEST_DEFLECTION = 0.5  # [rad] or [m]: beyond it a lumped spring is no model of elasticity
_SMALL = 0.3
"""Gravity's share of the springs' stiffness below which a series solves Newton's equations."""


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
        load = gravity(arm, q[moving])
        residual = load.torques.copy()
        residual[:, sprung] += torques
        residual[:, held] = 0.0
        stiffness = np.full(residual.shape, np.inf)  # of what rigid drives hold
        stiffness[:, sprung] = slopes
        stiff = bool(np.all(load.slope_bounds < _SMALL * stiffness))  # hence stable
        K = None if stiff else _total(stiffness, load)
        try:
            step = _series(stiffness, load, residual) if K is None else _solve(K, residual)
        except np.linalg.LinAlgError:  # singular, hence not stable either
            if K is not None:
                _check_stable(K, sprung, moving, springs, places)
            raise
        q[moving] -= step
        bent = np.abs(q - start)[np.ix_(moving, sprung)].max(axis=1, initial=0.0)
        if (bent > LARGEST_DEFLECTION).any():
            i = int(moving[np.argmax(bent)])
            raise _gives_way(arm, start[i], q[i], sprung, springs, places(i))
        # A step's error is about its square times how fast the stiffness changes on the way, over
        # the stiffness: far less than the square where springs are linear and prevail.
        last = 1e-6 if stiff and law.linear else 1e-8
        done = np.abs(step).max(axis=1, initial=0.0) < last
        if K is not None:
            _check_stable(K[done], sprung, moving[done], springs, places)
        moving = moving[~done]
        if not len(moving):
            elongations = (q - start)[:, sprung]
            return Equilibrium(q, elongations, law(elongations)[1])
    i = int(moving[0])
    raise _gives_way(arm, start[i], q[i], sprung, springs, places(i))


def _first_guess(arm: Arm, start: Array, sprung: IntArray, law: SpringLaws) -> Array:
    """Return coordinates near the equilibrium: each spring carries its load.

    Gravity is linearised at `start`; a round leaves gravity's stiffness over the spring's, about a
    hundredth, of the error.
    """
    load = gravity(arm, start)
    deflection, held = np.zeros(start.shape), load.torques
    for _ in range(3):
        deflection[:, sprung] = law.elongations(-held[:, sprung])
        held = load.torques + load.slopes_times(deflection)
    # Where a spring is weak, Newton does better from the unloaded coordinates.
    deflection[np.abs(deflection).max(axis=1, initial=0.0) > LARGEST_DEFLECTION] = 0.0
    return np.asarray(start + deflection)


def _series(stiffness: Array, load: Gravity, residual: Array) -> Array:
    """Solve (stiffness + dg/dq) x = residual where the springs' stiffness, (Q, d), prevails."""
    step = residual / stiffness
    for _ in range(30):  # so many where gravity's share is the largest; as a rule three do
        last, step = step, (residual - load.slopes_times(step)) / stiffness
        if np.abs(step - last).max(initial=0.0) < 1e-15:
            break
    return np.asarray(step)


def _solve(matrices: Array, residual: Array) -> Array:
    """Solve matrices (Q, d, d) x = residual (Q, d)."""
    return np.asarray(np.linalg.solve(matrices, residual[..., None])[..., 0], dtype=float)


def _total(stiffness: Array, load: Gravity) -> Array:
    """Return the stiffness of springs and gravity; rigid coordinates apart, with the unit one."""
    free = np.isfinite(stiffness)
    K = np.where(free[:, :, None] & free[:, None, :], load.slopes, 0.0)
    diagonal = np.einsum("qii->qi", K)
    diagonal += np.where(free, stiffness, 1.0)
    return np.asarray(K)


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
