"""Modes of a linear model: resonances, anti-resonances, damping ratios, rigid modes.

A motor shaft turns freely but for gravity and friction, so a model with n motors has n rigid
modes. Without gravity their squared frequencies are zero; gravity makes them slightly positive
(a pendulum) or negative (an arm that would fall over). Here the n modes of lowest squared
frequency are the rigid ones, whatever gravity does to them: clamping all motors shifts the
spectrum by at most n places (Cauchy's interlacing), so every other mode lies at or above the
lowest mode of the arm with its motors clamped, which a stable equilibrium makes positive.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import InvalidInput, SolverFailed
from robotmodels.linear.linear_model import LinearModel


@dataclass(frozen=True, eq=False)
class Modes:
    """Undamped modes, lowest first; leading axes as the model's.

    Attributes
    ----------
    squares : ndarray, (..., k), rad^2/s^2
        Squared angular frequencies; negative where gravity makes the mode unstable.
    shapes : ndarray, (..., d, k)
        Mode shapes of unit modal mass, in the model's coordinates.
    """

    squares: Array
    shapes: Array

    @cached_property
    def frequencies(self) -> Array:
        """Angular frequencies, (..., k); zero for modes that do not oscillate [rad/s]."""
        return np.asarray(np.sqrt(np.maximum(self.squares, 0.0)))


@dataclass(frozen=True, eq=False)
class DampedModes:
    """Poles, slowest first; one of each conjugate pair, both of an overdamped mode.

    Attributes
    ----------
    poles : ndarray of complex, (k,), rad/s
        Poles with imaginary part >= 0.
    shapes : ndarray of complex, (d, k)
        Mode shapes of unit length in the mass matrix, in the model's coordinates.
    """

    poles: ComplexArray
    shapes: ComplexArray

    @cached_property
    def frequencies(self) -> Array:
        """Magnitudes of the poles, (k,) [rad/s]."""
        return np.abs(self.poles)

    @cached_property
    def damping_ratios(self) -> Array:
        """Return -Re s / |s|, (k,): 0 undamped, 1 overdamped, negative unstable [-]."""
        return np.asarray(-self.poles.real / self.frequencies)


def resonances(model: LinearModel, rigid: int | None = None) -> Modes:
    """Return the undamped flexible modes: the poles of every FRF.

    Parameters
    ----------
    model : LinearModel
        d coordinates, any leading axes.
    rigid : int, optional
        Number of rigid modes; by default one per motor. A model whose motors are held, by position
        controllers for instance, has none.

    Raises
    ------
    InvalidInput
        If a mass matrix is not positive definite.
    """
    modes = _undamped(model)
    r = _rigid_count(model, rigid)
    return Modes(modes.squares[..., r:], modes.shapes[..., :, r:])


def rigid_modes(model: LinearModel, rigid: int | None = None) -> Modes:
    """Return the rigid modes, as gravity leaves them. Arguments as in `resonances`.

    Raises
    ------
    InvalidInput
        If a mass matrix is not positive definite.
    """
    modes = _undamped(model)
    r = _rigid_count(model, rigid)
    return Modes(modes.squares[..., :r], modes.shapes[..., :, :r])


def clamped(model: LinearModel, motor: int | None = None) -> LinearModel:
    """Return the model with the shaft of `motor` (0 to n - 1) fixed, or all shafts, as by brakes.

    It has one coordinate and one motor fewer; its poles are the zeros of that motor's own FRF
    (Ram and Elhay 1996, used in [HBH]).

    Raises
    ------
    InvalidInput
        If there is no such motor.
    """
    n = model.selector.shape[1]
    if not 0 <= (motor or 0) < n:
        raise InvalidInput(f"motor {motor}: the model has motors 0 to {n - 1}")
    motors = list(range(n)) if motor is None else [motor]
    # Coordinates in which the shafts stand still: an orthonormal basis of their subspace.
    basis = np.linalg.qr(model.selector[:, motors], mode="complete")[0][:, len(motors) :]
    return LinearModel(
        mass=basis.T @ model.mass @ basis,
        damping=basis.T @ model.damping @ basis,
        stiffness=basis.T @ model.stiffness @ basis,
        selector=basis.T @ np.delete(model.selector, motors, axis=1),
    )


def anti_resonances(model: LinearModel, motor: int) -> Array:
    """Return the undamped zeros of G_mm, (..., d - n), m = `motor` [rad/s].

    Damped ones are the poles of ``damped_modes(clamped(model, motor))``.

    Raises
    ------
    InvalidInput
        If there is no such motor, or a mass matrix is not positive definite.
    """
    return resonances(clamped(model, motor)).frequencies


def damped_modes(model: LinearModel, rigid: int | None = None) -> DampedModes:
    """Return the flexible modes with their damping: det(s^2 M + s D + K) = 0.

    Known limit: the 2 n slowest poles are taken as the rigid ones. Gravity and bearing friction
    move these off zero, as a rule by far less than any spring does. But one pole of an overdamped
    mode tends to zero as its damping grows; once slower than a rigid pole (damping / stiffness of
    a tenth of a second and more) it is taken for one, and the rigid one is returned instead.
    Where this would part a conjugate pair it is an error; where it swaps real poles, or two of
    them with a pair, it is not noticed. Poles of an ordinary damping ratio are never concerned.

    Parameters
    ----------
    model : LinearModel
        Model without leading axes.
    rigid : int, optional
        Number of rigid modes; by default one per motor.

    Raises
    ------
    InvalidInput
        If the model has leading axes, or its mass matrix is not positive definite.
    SolverFailed
        If the number of rigid modes would part a conjugate pair.
    """
    if model.mass.ndim != 2:
        raise InvalidInput(
            f"damped_modes: the model has leading axes {model.mass.shape[:-2]}; "
            "linearise one position at a time"
        )
    root = _inverse_root(model.mass)
    poles, vectors = (a.astype(complex) for a in np.linalg.eig(_first_order(model, root)))
    flexible = _flexible(poles, _rigid_count(model, rigid))
    shapes = vectors[: len(root), flexible]
    return DampedModes(poles[flexible], root @ (shapes / np.linalg.norm(shapes, axis=0)))


def damped_poles(model: LinearModel, rigid: int | None = None) -> list[ComplexArray]:
    """Return the poles of `damped_modes` of Q models, (k,) each, without shapes.

    Parameters
    ----------
    model : LinearModel
        With a leading axis Q.
    rigid : int, optional
        As in `damped_modes`.

    Raises
    ------
    InvalidInput, SolverFailed
        As `damped_modes`.
    """
    slow = _rigid_count(model, rigid)
    poles = np.linalg.eigvals(_first_order(model, _inverse_root(model.mass))).astype(complex)
    return [one[_flexible(one, slow)] for one in poles]


def _first_order(model: LinearModel, root: Array) -> Array:
    """Return the matrix of x' = A x with x = (q, q'), (..., 2 d, 2 d), masses scaled to one."""
    transposed, d = np.swapaxes(root, -1, -2), root.shape[-1]
    A = np.zeros((*root.shape[:-2], 2 * d, 2 * d))
    A[..., :d, d:] = np.eye(d)
    A[..., d:, :d] = -(transposed @ model.stiffness @ root)
    A[..., d:, d:] = -(transposed @ model.damping @ root)
    return A


def _flexible(poles: ComplexArray, rigid: int) -> list[int]:
    """Return where flexible poles with imaginary part >= 0 are, slowest first."""
    order = np.argsort(np.abs(poles), kind="stable")
    _check_pairs(poles[order], 2 * rigid)
    return [int(i) for i in order[2 * rigid :] if poles[i].imag >= 0]


def _check_pairs(poles: ComplexArray, slow: int) -> None:
    """Refuse to part a conjugate pair; each must lie among the `slow` first poles or behind."""
    if np.count_nonzero(poles[:slow].imag > 0) != np.count_nonzero(poles[:slow].imag < 0):
        pole = poles[slow]
        raise SolverFailed(
            f"damped_modes: {slow // 2} rigid modes would part the pair of poles at "
            f"{pole.real:.4g} +- {abs(pole.imag):.4g}j rad/s: a mode is so overdamped that one of "
            "its poles is slower than a rigid one; lower its damping or use resonances"
        )


def _undamped(model: LinearModel) -> Modes:
    root = _inverse_root(model.mass)
    transposed = np.swapaxes(root, -1, -2)
    squares, shapes = np.linalg.eigh(transposed @ model.stiffness @ root)
    return Modes(squares, root @ shapes)


def _inverse_root(mass: Array) -> Array:
    """Return R, (..., d, d), with R^T mass R = 1."""
    try:
        lower = np.linalg.cholesky(mass)
    except np.linalg.LinAlgError:
        raise InvalidInput("modes: the mass matrix is not positive definite") from None
    return np.asarray(np.swapaxes(np.linalg.inv(lower), -1, -2))


def _rigid_count(model: LinearModel, rigid: int | None) -> int:
    d, n = model.selector.shape
    count = n if rigid is None else rigid
    if not 0 <= count <= d:
        raise InvalidInput(f"modes: {count} rigid modes of {d} coordinates are impossible")
    return count
