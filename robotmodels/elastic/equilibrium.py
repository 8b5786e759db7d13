"""Static equilibrium: where gravity leaves an elastic arm whose motors stand still."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robotmodels.common.arrays import Array, BoolArray, IntArray
from robotmodels.common.errors import NoEquilibrium
from robotmodels.description.spring_laws import SpringLaws
from robotmodels.elastic.arm import Arm
from robotmodels.elastic.dynamics import Gravity, gravity, gravity_torques

LARGEST_DEFLECTION = 0.5  # [rad] or [m]: beyond it a lumped spring is no model of elasticity
_SMALL = 0.3
"""Gravity's share of the springs' stiffness below which a series solves Newton's equations."""


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Static equilibria of an arm.

    Attributes
    ----------
    coordinates : ndarray, (Q, d), rad or m
        Drives and torsions.
    elongations : ndarray, (Q, s), rad or m
        Elongations of the springs.
    slopes : ndarray, (Q, s), N m/rad or N/m
        Stiffnesses of the springs there.
    """

    coordinates: Array
    elongations: Array
    slopes: Array


@dataclass(frozen=True)
class Labels:
    """What errors call springs and positions.

    Attributes
    ----------
    springs : sequence of str
        Each of the s springs.
    forces : sequence of bool
        Whether it is forces that bend it, as at a prismatic joint, instead of torques.
    position : callable
        Words for the position with an index.
    """

    springs: Sequence[str]
    forces: Sequence[bool]
    position: Callable[[int], str]

    def load(self, spring: int, torques: Array) -> str:
        """Return what gravity loads a spring with, such as ``torque of 3 N m``."""
        kind, unit = ("force", "N") if self.forces[spring] else ("torque", "N m")
        return f"{kind} of {abs(torques[spring]):.4g} {unit}"


def find_equilibrium(
    arm: Arm, start: Array, sprung: IntArray, fixed: IntArray, law: SpringLaws, labels: Labels
) -> Equilibrium:
    """Find the coordinates at which springs and gravity balance, by Newton's method.

    Parameters
    ----------
    arm : Arm
        The elastic arm, d coordinates.
    start : ndarray, (Q, d)
        Coordinates with unloaded springs.
    sprung : ndarray of int, (s,)
        The coordinate that each spring holds.
    fixed : ndarray of int
        Coordinates that rigid drives hold.
    law : SpringLaws
        Law of the springs.
    labels : Labels
        Labels for errors.

    Raises
    ------
    NoEquilibrium
        If a spring gives way, naming it, the position and its torque.
    """
    q = _first_guess(arm, start, sprung, law)
    moving = np.arange(len(q))  # positions whose Newton iteration has not ended
    for _ in range(30):
        here = _balance(arm, start[moving], q[moving], sprung, fixed, law)
        try:
            step = here.step()
        except np.linalg.LinAlgError:  # singular, hence not stable either
            _check_stable(here, np.full(len(moving), True), sprung, moving, labels)
            raise
        q[moving] -= step
        bent = np.abs(q - start)[np.ix_(moving, sprung)].max(axis=1, initial=0.0)
        if (bent > LARGEST_DEFLECTION).any():
            raise _gives_way(arm, start, q, sprung, int(moving[np.argmax(bent)]), labels)
        # A step's error is about its square times how fast the stiffness changes on the way, over
        # the stiffness: far less than the square where springs are linear and prevail.
        last = 1e-6 if here.stiff and law.linear else 1e-8
        done = np.abs(step).max(axis=1, initial=0.0) < last
        _check_stable(here, done, sprung, moving, labels)
        moving = moving[~done]
        if not len(moving):
            elongations = (q - start)[:, sprung]
            return Equilibrium(q, elongations, law(elongations)[1])
    raise _gives_way(arm, start, q, sprung, int(moving[0]), labels)


def _first_guess(arm: Arm, start: Array, sprung: IntArray, law: SpringLaws) -> Array:
    """Return coordinates near the equilibrium: each spring carries its load.

    Gravity is linearised at `start`; a round leaves gravity's stiffness over the spring's, about a
    hundredth, of the error.
    """
    load = gravity(arm, start)
    deflection, torques = np.zeros(start.shape), load.torques
    for _ in range(3):
        deflection[:, sprung] = law.elongations(-torques[:, sprung])
        torques = load.torques + load.slopes_times(deflection)
    # Where a spring is weak, Newton does better from the unloaded coordinates.
    deflection[np.abs(deflection).max(axis=1, initial=0.0) > LARGEST_DEFLECTION] = 0.0
    return np.asarray(start + deflection)


@dataclass(frozen=True, eq=False)
class _Balance:
    """Springs against gravity at Q coordinate vectors.

    Attributes
    ----------
    load : Gravity
        Gravity.
    residual : ndarray, (Q, d)
        Torques out of balance, zero where rigid drives hold.
    stiffness : ndarray, (Q, d)
        Stiffness of the springs, infinite where rigid drives hold.
    """

    load: Gravity
    residual: Array
    stiffness: Array

    @cached_property
    def stiff(self) -> bool:
        """Whether the springs prevail over gravity by far: the equilibria are stable."""
        return bool(np.all(self.load.slope_bounds < _SMALL * self.stiffness))

    @cached_property
    def total(self) -> Array:
        """Stiffness of springs and gravity, (Q, d, d); unit rows for rigid coordinates."""
        free = np.isfinite(self.stiffness)
        K = np.where(free[:, :, None] & free[:, None, :], self.load.slopes, 0.0)
        diagonal = np.einsum("qii->qi", K)
        diagonal += np.where(free, self.stiffness, 1.0)
        return np.asarray(K)

    def step(self) -> Array:
        """Return Newton's step, (Q, d): (stiffness + dg/dq) step = residual."""
        if not self.stiff:
            return np.asarray(np.linalg.solve(self.total, self.residual[..., None])[..., 0])
        step = self.residual / self.stiffness
        for _ in range(30):  # so many where gravity's share is the largest; as a rule three do
            last = step
            step = (self.residual - self.load.slopes_times(step)) / self.stiffness
            if np.abs(step - last).max(initial=0.0) < 1e-15:
                break
        return np.asarray(step)


def _balance(
    arm: Arm, start: Array, q: Array, sprung: IntArray, fixed: IntArray, law: SpringLaws
) -> _Balance:
    torques, slopes = law((q - start)[:, sprung])
    load = gravity(arm, q)
    residual = load.torques.copy()
    residual[:, sprung] += torques
    residual[:, fixed] = 0.0
    stiffness = np.full(residual.shape, np.inf)
    stiffness[:, sprung] = slopes
    return _Balance(load, residual, stiffness)


def _gives_way(
    arm: Arm, start: Array, bent: Array, sprung: IntArray, i: int, labels: Labels
) -> NoEquilibrium:
    worst = int(np.argmax(np.abs(bent[i] - start[i])[sprung]))
    torques = gravity_torques(arm, start[[i]])[0, sprung]
    return NoEquilibrium(
        f"no static equilibrium at {labels.position(i)}: {labels.springs[worst]} yields under a "
        f"gravity {labels.load(worst, torques)}; it is too weak for the load"
    )


def _check_stable(
    here: _Balance, where: BoolArray, sprung: IntArray, moving: IntArray, labels: Labels
) -> None:
    if here.stiff:
        return
    try:
        np.linalg.cholesky(here.total[where])
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(here.total[where])
        i = int(np.argmin(values[:, 0]))
        at = int(np.flatnonzero(where)[i])
        worst = int(np.argmax(np.abs(vectors[i, sprung, 0])))
        load = labels.load(worst, here.load.torques[at, sprung])
        raise NoEquilibrium(
            f"the equilibrium at {labels.position(int(moving[at]))} is not stable: gravity "
            f"overcomes {labels.springs[worst]}: its {load} there rises faster than the spring's; "
            "it is too weak for the load"
        ) from None
