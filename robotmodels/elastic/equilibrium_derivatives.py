"""Derivatives of a robot's mass, damping, stiffness and outputs along its equilibria."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.linear.equilibrium_sensitivity import ChannelTangents, Tangents
from robotmodels.linear.linear_model import Channels

if TYPE_CHECKING:
    from robotmodels.elastic.skeleton import Skeleton


# Relative step of the central differences. Mass, inertia, gain and delay enter linearly or
# quadratically, where they are exact but for rounding; angles and locations are smooth.
STEP = 1e-4
# Positions in one call, above which memory grows but no time is saved.
_AT_ONCE = 2000


def differentiate(
    skeleton: "Callable[[Array, Array], Skeleton]",
    here: "Skeleton",
    theta: Array,
    coordinates: Array,
    shift: Array,
    direct: Sequence[int],
) -> Tangents:
    """Differentiate a skeleton along ln theta by central differences.

    Of parameters that act through the coordinates alone, many are differentiated in one call.

    Parameters
    ----------
    skeleton : callable
        As a function of theta (p,) and the arm's coordinates (Q, d).
    here : Skeleton
        The skeleton there.
    theta, coordinates : ndarray
        Point of differentiation.
    shift : ndarray, (Q, d, p)
        Derivative of the coordinates by ln theta.
    direct : sequence of int
        Parameters that act on the skeleton itself too.
    """
    count, arrays = len(coordinates), _arrays(here)
    derivatives = {name: np.zeros((len(theta), *array.shape)) for name, array in arrays.items()}
    for j in direct:
        factor = np.ones(len(theta))
        factor[j] += STEP
        plus = _arrays(skeleton(theta * factor, coordinates + STEP * shift[..., j]))
        factor[j] -= 2 * STEP
        minus = _arrays(skeleton(theta * factor, coordinates - STEP * shift[..., j]))
        for name, derivative in derivatives.items():
            derivative[j] = (plus[name] - minus[name]) / (2 * STEP)
    moved = [j for j in range(len(theta)) if j not in direct and shift[..., j].any()]
    at_once = max(1, _AT_ONCE // (2 * count))
    for part in (moved[i : i + at_once] for i in range(0, len(moved), at_once)):
        ways = np.moveaxis(shift[..., part], -1, 0)
        for name, slopes in _along(lambda q: skeleton(theta, q), arrays, coordinates, ways).items():
            derivatives[name][part] = slopes
    damping = derivatives["damping"]
    if damping.ndim == 3:  # alike in all positions
        damping = np.broadcast_to(damping[:, None], (len(damping), count, *damping.shape[1:]))
    return Tangents(
        mass=np.swapaxes(derivatives["mass"], 0, 1),
        damping=np.swapaxes(damping, 0, 1),
        stiffness=np.swapaxes(derivatives["stiffness"], 0, 1),
        gravity=np.swapaxes(derivatives["gravity"], 0, 1),
        rows=_unless_zero(np.swapaxes(derivatives["rows"], 0, 2)),
        delay=_unless_zero(derivatives["delay"]),
        torque=_channels(derivatives, "torque"),
        sensor=_channels(derivatives, "sensor"),
    )


def _along(
    skeleton: "Callable[[Array], Skeleton]",
    arrays: dict[str, Array],
    coordinates: Array,
    ways: Array,
) -> dict[str, Array]:
    """Return derivatives (c, ...) of what differs by position, along `ways` (c, Q, d)."""
    ends = coordinates + STEP * np.stack([ways, -ways])
    both = _arrays(skeleton(ends.reshape(-1, coordinates.shape[1])))
    result = {}
    for name in ("mass", "damping", "stiffness", "gravity", "rows"):
        if both[name].shape != arrays[name].shape:  # otherwise alike in all positions
            plus, minus = both[name].reshape(2, len(ways), *arrays[name].shape)
            result[name] = (plus - minus) / (2 * STEP)
    return result


_PARTS = ("ln_gain", "delay", "lag")


def _channels(derivatives: dict[str, Array], name: str) -> ChannelTangents | None:
    parts = [derivatives[f"{name} {part}"] for part in _PARTS]
    return ChannelTangents(*parts) if any(part.any() for part in parts) else None


def _unless_zero(derivative: Array) -> Array | None:
    return derivative if derivative.any() else None


def _arrays(skeleton: "Skeleton") -> dict[str, Array]:
    measured = skeleton.measurement
    channels = {"torque": measured.torque, "sensor": measured.sensor or Channels.plain(np.ones(0))}
    parts = {
        f"{name} {part}": array
        for name, c in channels.items()
        for part, array in zip(_PARTS, (np.log(np.abs(c.gain)), c.delay, c.lag), strict=True)
    }
    return parts | {
        "mass": skeleton.mass,
        "damping": skeleton.damping,
        "stiffness": skeleton.stiffness,
        "gravity": skeleton.gravity,
        "rows": np.stack([measured.position, measured.velocity, measured.acceleration], axis=1),
        "delay": np.array(measured.delay),
    }
