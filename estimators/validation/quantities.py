"""What a model can predict: compliance and responses of points of links, resonances, damping.

A quantity is a function of a model, positions (Q, n) and parameters (p,), with a name and a unit.
Any such object will do for `estimators.predict`.
"""

from dataclasses import dataclass
from typing import Any, Literal, Protocol, cast

import numpy as np

from estimators.validation.bands import relative_slope
from robotmodels.common.arrays import Array, ComplexArray, real_numbers
from robotmodels.common.errors import InvalidInput, nearest
from robotmodels.elastic.tool_response import (
    Frame,
    Motion,
    Motors,
    ToolModel,
    compliance_ellipsoid,
    tool_frame,
    tool_model,
    underlying_robot,
)
from robotmodels.linear.linear_model import LinearModel
from robotmodels.linear.modes import clamped, damped_poles, resonances
from robotmodels.linear.response import Elastic, by_ln_theta


class Quantity(Protocol):
    """Protocol of a quantity to predict."""

    def __call__(self, model: Elastic, positions: Array, parameters: Array) -> Array | ComplexArray:
        """Return the quantity in each position, (Q, ...); real ones above zero."""


@dataclass(frozen=True)
class ToolCompliance:
    """Static compliance of a point with clamped motors: principal values, or along a direction.

    Attributes
    ----------
    frame : Frame or None
        The point; by default the end of the last link.
    direction : tuple of float, (3,), or None
        In the frame's axes; None for the three half axes of the ellipsoid, softest first.
    """

    frame: Frame | None = None
    direction: tuple[float, float, float] | None = None

    def __call__(self, model: Elastic, positions: Array, parameters: Array) -> Array:
        """Return compliances, (Q, 3), or (Q, 1) along a direction [m/N]."""
        frame = self.frame or tool_frame(underlying_robot(model))
        return self.of(tool_model(model, positions, frame, parameters))

    def of(self, tool: ToolModel) -> Array:
        """Return the compliances of a linear model."""
        compliance = tool.compliance()
        if self.direction is None:
            return compliance_ellipsoid(compliance).values
        unit = unit_vector(self.direction)
        return np.asarray(np.einsum("i,qij,j->q", unit, compliance[:, :3, :3], unit)[:, None])


@dataclass(frozen=True, eq=False)
class ToolResponse:
    """Receptance, mobility or accelerance of a point, or of motors, under a force at the point.

    Attributes
    ----------
    omega : ndarray, (F,), rad/s
        Any angular frequencies above zero.
    frame : Frame or None
        The point; by default the end of the last link.
    motion : {"displacement", "velocity", "acceleration"}
        What of the motion.
    motors : {"clamped", "free"} or callable
        As in `robotmodels.ToolModel.response`.
    at : {"frame", "motors"}
        Whose motion.
    """

    omega: Array
    frame: Frame | None = None
    motion: Motion = "displacement"
    motors: Motors = "clamped"
    at: Literal["frame", "motors"] = "frame"

    def __call__(self, model: Elastic, positions: Array, parameters: Array) -> ComplexArray:
        """Return responses to forces along and torques about x, y, z, (Q, F, 6 or n, 6)."""
        frame = self.frame or tool_frame(underlying_robot(model))
        return self.of(tool_model(model, positions, frame, parameters))

    def of(self, tool: ToolModel) -> ComplexArray:
        """Return the responses of a linear model."""
        return tool.response(self.omega, self.motion, self.motors, self.at)


@dataclass(frozen=True)
class Resonances:
    """Undamped resonances, lowest first.

    Attributes
    ----------
    count : int or None
        How many; None for all.
    motors : {"clamped", "free"}
        Clamped as by brakes, or free.
    """

    count: int | None = None
    motors: Literal["clamped", "free"] = "clamped"

    def __call__(self, model: Elastic, positions: Array, parameters: Array) -> Array:
        """Return angular frequencies, (Q, count) [rad/s]."""
        return self.of(model.network(positions, parameters).linear_model())

    def of(self, linear: LinearModel) -> Array:
        """Return the resonances of a linear model with free motors."""
        return resonances(_with_motors(linear, self.motors)).frequencies[:, : self.count]


@dataclass(frozen=True)
class DampingRatios:
    """Damping ratios of the modes of lowest frequency.

    Attributes
    ----------
    count : int
        How many.
    motors : {"clamped", "free"}
        Clamped as by brakes, or free.
    """

    count: int = 1
    motors: Literal["clamped", "free"] = "clamped"

    def __call__(self, model: Elastic, positions: Array, parameters: Array) -> Array:
        """Return damping ratios, (Q, count) [-]; not a number where fewer modes oscillate."""
        return self.of(model.network(positions, parameters).linear_model())

    def of(self, linear: LinearModel) -> Array:
        """Return the damping ratios of a linear model with free motors."""
        linear = _with_motors(linear, self.motors)
        rows = np.full((len(linear.mass), self.count), np.nan)
        for row, poles in zip(rows, damped_poles(linear), strict=True):
            oscillating = poles[poles.imag > 0][: self.count]
            row[: len(oscillating)] = -oscillating.real / np.abs(oscillating)
        return rows


def free_modes(model: Elastic, positions: Array, parameters: Array) -> Array:
    """Return undamped resonances [rad/s] and damping ratios with free motors, (Q, 2, k), of k <= 4.

    A damping ratio is not a number where fewer modes oscillate.
    """
    linear = model.network(positions, parameters).linear_model()
    frequencies = Resonances(4, "free").of(linear)
    ratios = DampingRatios(frequencies.shape[1], "free").of(linear)
    return np.stack([frequencies, ratios], axis=1)


def _with_motors(linear: LinearModel, motors: str) -> LinearModel:
    if motors not in ("clamped", "free"):
        raise InvalidInput(f"motors {motors!r}: clamped or free is needed")
    return clamped(linear) if motors == "clamped" else linear


NAMED: dict[str, Quantity] = {
    "tool_compliance": ToolCompliance(),
    "resonances": Resonances(),
    "damping_ratios": DampingRatios(),
}
"""Quantities that need no settings."""


def find_quantity(quantity: str | Quantity, omega: Array | None = None) -> Quantity:
    """Return a quantity, or that of a name; "tool_response" is that at `omega` (F,) [rad/s].

    Raises
    ------
    InvalidInput
        If there is none of that name, or no frequencies for the response.
    """
    if not isinstance(quantity, str):
        return quantity
    if quantity == "tool_response" and omega is not None:
        return ToolResponse(omega)
    if quantity not in NAMED:
        needed = ": omega is needed" if quantity == "tool_response" else " is unknown"
        there = (*NAMED, "tool_response")
        raise InvalidInput(
            f"quantity {quantity!r}{needed}{nearest(quantity, there)}; "
            f"there are {', '.join(there)}, and objects such as ToolCompliance"
        )
    return NAMED[quantity]


def log_gradients(
    model: Elastic, quantity: str | Quantity, positions: Array, parameters: Array | None = None
) -> Array | ComplexArray:
    """Return the derivatives of ln(quantity) by ln theta, (Q, ..., p); zero where it is zero.

    Raises
    ------
    InvalidInput
        For an unknown quantity.
    IdentificationError
        If the model has no equilibrium in a position.
    """
    evaluated, at = find_quantity(quantity), np.atleast_2d(real_numbers(positions, "positions"))
    theta = model.parameters.check(parameters)
    values: Any = evaluated(model, at, theta)
    slope = by_ln_theta(lambda x: cast(Array, evaluated(model, at, x)), theta)
    return np.asarray(relative_slope(values, slope))


def unit_vector(direction: tuple[float, float, float]) -> Array:
    """Return a direction, (3,), of unit length.

    Raises
    ------
    InvalidInput
        If it is zero.
    """
    vector = real_numbers(direction, "direction")
    length = np.linalg.norm(vector)
    if vector.shape != (3,) or not (np.isfinite(length) and length > 0):
        raise InvalidInput(f"direction: {vector.tolist()}; three numbers other than zero needed")
    return np.asarray(vector / length)
