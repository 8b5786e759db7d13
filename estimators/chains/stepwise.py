"""A chain one or two masses at a time, as [HBH] section 3.4 has it, and how accurate it comes out.

Where poles and zeros nearly cancel, or a chain is long, its far masses hang on digits that the
spectra may not have. The result states its accuracy, to first order in the errors of poles and
zeros, and is refused by name where that is poor.
"""

from dataclasses import dataclass

import numpy as np

from estimators.chains.inverse_eigenvalue import (
    check_count,
    lanczos_chain,
    lanczos_step,
    without_first_mass,
)
from estimators.chains.pole_zero_spectra import (
    check_interlacing,
    first_components,
    separated,
    squared_components,
)
from robotmodels.common.arrays import Array, check_above_zero
from robotmodels.common.errors import InvalidInput, NotIdentifiable

EIGENVALUE_PRECISION = 16 * float(np.finfo(float).eps)
"""Errors of squared frequencies from an eigenvalue solver, relative to the largest, at most."""

_POOREST = 0.01  # relative error from which on a mass or spring is refused
_STEP = 1e-30  # of complex steps, which have no cancellation


@dataclass(frozen=True, eq=False)
class StepwiseChain:
    """Masses and springs of one chain, with bounds on their errors.

    Attributes
    ----------
    masses : ndarray, (N,), kg
        Masses, the motor's first.
    springs : ndarray, (N - 1,), N/m
        Springs between them.
    mass_errors, spring_errors : ndarray, (N,) and (N - 1,)
        Largest relative errors, to first order, that errors of poles and zeros can cause.
    """

    masses: Array
    springs: Array
    mass_errors: Array
    spring_errors: Array


def stepwise_chain(
    poles: Array,
    zeros: Array,
    first_mass: float,
    count: int,
    total: float,
    *,
    per_step: int = 2,
    precision: float = EIGENVALUE_PRECISION,
) -> StepwiseChain:
    """Return masses and springs as [HBH] section 3.4 has them, (13)-(22).

    Parameters
    ----------
    poles, zeros : ndarray, (k,) and (k - 1,), rad^2/s^2
        Squared resonances, the rigid one's zero included, and squared anti-resonances.
    first_mass : float
        m_1, the motor's: 1/A_H by (3), or from its data sheet.
    count : int
        Number of masses N.
    total : float
        Sum of the chain's masses: 1/A_L by (2), the other chains held, or an entry of the rigid
        inertia matrix. Poles and zeros do not say it unless the chain is alone.
    per_step : int
        2 takes a pair of masses off at a time and reads each next first mass from the high
        frequencies of what is left; 1 takes one off, whose successor is known already, and needs no
        high frequencies.
    precision : float
        Largest error of poles and zeros, relative to the largest pole; by default that of computed
        eigenvalues. A pole and a zero that are no further apart may cancel, or be out of order.

    Raises
    ------
    InvalidInput
        For spectra that do not interlace, or a count that does not fit.
    NotIdentifiable
        Naming masses and springs that this precision leaves open by more than 1 %.
    """
    check_above_zero(precision, "precision")
    if per_step not in (1, 2):
        raise InvalidInput(f"per_step: {per_step} masses at a time; 1 or 2 are possible")
    check_count(count, len(poles))
    tolerance = precision * float(np.max(poles))
    poles, zeros = _ordered(poles, zeros, tolerance)
    names = (*(f"m{i + 1}" for i in range(count)), *(f"K{i + 1}" for i in range(count - 1)))
    _check_modes(poles, zeros, tolerance, names[:count])
    first = first_components(poles, zeros)
    felt = first > 0
    solution = masses_in_steps(poles[felt], first[felt], first_mass, count, total, per_step)
    bound = _error_bound(poles, zeros, first_mass, count, total, tolerance)
    relative = np.nan_to_num(bound / np.abs(np.concatenate(solution)), nan=np.inf)
    _check_errors(relative, names, precision)
    return StepwiseChain(*solution, relative[:count], relative[count:])


def _ordered(poles: Array, zeros: Array, tolerance: float) -> tuple[Array, Array]:
    """Return poles, the rigid one 0, and zeros between them; refuse what is no chain's."""
    poles, zeros = np.sort(np.asarray(poles, float)), np.sort(np.asarray(zeros, float))
    check_interlacing(poles, zeros, tolerance)
    if abs(poles[0]) > tolerance:
        raise InvalidInput(
            f"poles: the lowest is {poles[0]:.4g} rad^2/s^2; the rigid mode's, 0, is needed first"
        )
    return separated(np.concatenate([[0.0], poles[1:]]), zeros, tolerance)


def _check_modes(poles: Array, zeros: Array, tolerance: float, names: tuple[str, ...]) -> None:
    """Refuse more masses than modes that no zero cancels."""
    beside = np.minimum(zeros - poles[:-1], poles[1:] - zeros) <= tolerance
    modes = len(poles) - int(np.count_nonzero(beside))
    if modes < len(names):
        raise NotIdentifiable(
            names[modes:],
            f"the motor's FRF has {modes} modes, the rigid one included, and {len(names)} masses "
            "need as many; the other poles have zeros within their precision beside them",
        )


def _check_errors(relative: Array, names: tuple[str, ...], precision: float) -> None:
    """Refuse masses and springs that the spectra leave open."""
    inaccurate = [name for name, e in zip(names, relative, strict=True) if not e <= _POOREST]
    if inaccurate:
        worst = relative.max()
        size = f"by up to {100 * worst:.2g} %" if worst < 1 else "altogether"
        raise NotIdentifiable(
            tuple(inaccurate),
            f"errors of poles and zeros of {precision:.2g} of the largest leave them open {size}; "
            "give fewer masses, or poles and zeros with more digits",
        )


def masses_in_steps(
    poles: Array, first: Array, first_mass: float, count: int, total: float, per_step: int
) -> tuple[Array, Array]:
    """Return masses (N,) and springs (N - 1,): [HBH] (14)-(19) and (22), masses taken off between.

    Later steps need no zeros: the weights of what is left are the u1^2/m of (13), and computed with
    the distances of its poles from the poles before.

    Parameters
    ----------
    poles, first : ndarray, (k,)
        Lambda and u1 of modes that the motor feels.
    first_mass, count, total, per_step
        As in `stepwise_chain`.
    """
    masses, springs, mass = [float(first_mass)], [], float(first_mass)
    weights = first**2 / (first @ first) / mass
    while True:
        step = lanczos_step(poles, np.sqrt(weights * mass))
        springs.append(step.b11 * mass)  # (17)
        if len(springs) == count - 1:
            break
        second = mass * step.b11**2 / step.b12**2  # (19)
        masses.append(second)
        poles, weights = without_first_mass(poles, weights, mass)
        if per_step == 2:
            springs.append(step.b22 * second - springs[-1])  # (18)
            if len(springs) == count - 1:
                break
            poles, weights = without_first_mass(poles, weights, second)
            second = 1 / float(weights.sum())  # (3) of what is left
            masses.append(second)
        mass = second
    masses.append(total - sum(masses))  # (22)
    return np.array(masses), np.array(springs)


def _error_bound(
    poles: Array, zeros: Array, first_mass: float, count: int, total: float, tolerance: float
) -> Array:
    """Return the largest errors, (2 N - 1,), that errors of up to `tolerance` in spectra can cause.

    Absolute slopes by complex steps, added up; those of the Lanczos recursion, which computes the
    same function of the spectra.
    """
    k = len(poles)
    moved = np.tile(np.concatenate([poles, zeros]).astype(complex), (2 * k - 1, 1))
    moved += 1j * _STEP * np.eye(2 * k - 1)
    # The rigid pole is zero and has no error.
    spectra = moved[1:]
    shifted, between = spectra[:, :k], spectra[:, k:]
    squares = squared_components(shifted, shifted[:, None, :] - between[:, :, None])
    with np.errstate(all="ignore"):
        masses, springs = lanczos_chain(shifted, squares, first_mass, count, total)
    slopes = np.concatenate([masses, springs], axis=1).imag / _STEP
    return np.asarray(np.abs(slopes).sum(axis=0) * tolerance)
