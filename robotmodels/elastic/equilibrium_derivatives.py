"""Derivatives of a robot's mass, damping, stiffness and outputs along its equilibria."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.linear.equilibrium_sensitivity import Tangents

if TYPE_CHECKING:
    from robotmodels.elastic.skeleton import Skeleton


# Relative step of the central differences. Mass, inertia, gain and delay enter linearly or
# quadratically, where they are exact but for rounding; angles and locations are smooth.
STEP = 1e-4


def differentiate(
    skeleton: "Callable[[Array, Array], Skeleton]",
    here: "Skeleton",
    theta: Array,
    coordinates: Array,
    shift: Array,
    columns: Sequence[int],
) -> Tangents:
    """Differentiate a skeleton along ln theta by central differences.

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
    columns : sequence of int
        Parameters to differentiate by; the other derivatives are zero.
    """
    derivatives = {
        name: np.zeros((len(theta), *array.shape)) for name, array in _arrays(here).items()
    }
    for j in columns:
        factor = np.ones(len(theta))
        factor[j] += STEP
        plus = _arrays(skeleton(theta * factor, coordinates + STEP * shift[..., j]))
        factor[j] -= 2 * STEP
        minus = _arrays(skeleton(theta * factor, coordinates - STEP * shift[..., j]))
        for name, derivative in derivatives.items():
            derivative[j] = (plus[name] - minus[name]) / (2 * STEP)
    count = len(coordinates)
    damping = np.broadcast_to(derivatives["damping"], (count, *derivatives["damping"].shape))
    return Tangents(
        mass=np.swapaxes(derivatives["mass"], 0, 1),
        damping=damping,
        stiffness=np.swapaxes(derivatives["stiffness"], 0, 1),
        gravity=np.swapaxes(derivatives["gravity"], 0, 1),
        position=np.swapaxes(derivatives["position"], 0, 1),
        acceleration=np.swapaxes(derivatives["acceleration"], 0, 1),
        ln_gain=derivatives["ln_gain"],
        delay=derivatives["delay"],
    )


def _arrays(skeleton: "Skeleton") -> dict[str, Array]:
    return {
        "mass": skeleton.mass,
        "damping": skeleton.damping,
        "stiffness": skeleton.stiffness,
        "gravity": skeleton.gravity,
        "position": skeleton.measurement.position,
        "acceleration": skeleton.measurement.acceleration,
        "ln_gain": np.log(skeleton.measurement.gain),
        "delay": np.array(skeleton.measurement.delay),
    }
