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

from robotmodels.arrays import Array, ComplexArray
from robotmodels.errors import InvalidInput
from robotmodels.linear_model import LinearModel


@dataclass(frozen=True, eq=False)
class Modes:
    """Undamped modes, lowest first; leading axes as the model's.

    Attributes
    ----------
    squares : (..., k) squared angular frequencies; negative where gravity tips over [rad^2/s^2].
    shapes : (..., d, k) mode shapes of unit modal mass, in the model's coordinates.
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
    poles : (k,) with imaginary part >= 0 [rad/s].
    """

    poles: ComplexArray

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
    model : d coordinates, any leading axes.
    rigid : number of rigid modes; by default one per motor. A model whose motors are held, by
        position controllers for instance, has none.

    Raises
    ------
    InvalidInput : if a mass matrix is not positive definite.
    """
    modes = _undamped(model)
    r = _rigid_count(model, rigid)
    return Modes(modes.squares[..., r:], modes.shapes[..., :, r:])


def rigid_modes(model: LinearModel, rigid: int | None = None) -> Modes:
    """Return the rigid modes, as gravity leaves them. Arguments as in `resonances`.

    Raises
    ------
    InvalidInput : if a mass matrix is not positive definite.
    """
    modes = _undamped(model)
    r = _rigid_count(model, rigid)
    return Modes(modes.squares[..., :r], modes.shapes[..., :, :r])


def clamped(model: LinearModel, motor: int) -> LinearModel:
    """Return the model with the shaft of `motor` (0 to n - 1) held still.

    It has one coordinate and one motor fewer; its poles are the zeros of that motor's own FRF
    (Ram and Elhay 1996, used in [HBH]).

    Raises
    ------
    InvalidInput : if there is no such motor.
    """
    n = model.selector.shape[1]
    if not 0 <= motor < n:
        raise InvalidInput(f"motor {motor}: the model has motors 0 to {n - 1}")
    # Coordinates in which the shaft stands still: an orthonormal basis of their hyperplane.
    column = model.selector[:, [motor]]
    basis = np.linalg.qr(column, mode="complete")[0][:, 1:]
    return LinearModel(
        mass=basis.T @ model.mass @ basis,
        damping=basis.T @ model.damping @ basis,
        stiffness=basis.T @ model.stiffness @ basis,
        selector=basis.T @ np.delete(model.selector, motor, axis=1),
    )


def anti_resonances(model: LinearModel, motor: int) -> Array:
    """Return the undamped zeros of G_mm, (..., d - n), m = `motor` [rad/s].

    Damped ones are the poles of ``damped_modes(clamped(model, motor))``.

    Raises
    ------
    InvalidInput : if there is no such motor, or a mass matrix is not positive definite.
    """
    return resonances(clamped(model, motor)).frequencies


def damped_modes(model: LinearModel, rigid: int | None = None) -> DampedModes:
    """Return the flexible modes with their damping: det(s^2 M + s D + K) = 0.

    The 2 n slowest poles are taken as the rigid ones (gravity and bearing friction move them off
    zero, by far less than any spring does unless a mode is overdamped many times over).

    Parameters
    ----------
    model : without leading axes.
    rigid : number of rigid modes; by default one per motor.

    Raises
    ------
    InvalidInput : if the model has leading axes, or its mass matrix is not positive definite.
    """
    if model.mass.ndim != 2:
        raise InvalidInput(
            f"damped_modes: the model has leading axes {model.mass.shape[:-2]}; "
            "linearise one position at a time"
        )
    root = _inverse_root(model.mass)
    stiffness, damping = (root.T @ a @ root for a in (model.stiffness, model.damping))
    d = len(stiffness)
    poles = np.linalg.eigvals(np.block([[np.zeros((d, d)), np.eye(d)], [-stiffness, -damping]]))
    poles = poles[np.argsort(np.abs(poles), kind="stable")][2 * _rigid_count(model, rigid) :]
    return DampedModes(np.asarray(poles[poles.imag >= 0], dtype=complex))


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
