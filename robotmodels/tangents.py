"""What frozen equilibria leave out: derivatives of everything but the springs themselves."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from robotmodels.arrays import Array, ComplexArray
from robotmodels.linear_model import LinearModel
from robotmodels.skeleton import Skeleton

# Relative step of the central differences. Mass, inertia, gain and delay enter linearly or
# quadratically, where they are exact but for rounding; angles and locations are smooth.
STEP = 1e-4


@dataclass(frozen=True, eq=False)
class Tangents:
    """Derivatives by ln theta of mass, damping and stiffness, and of what is measured.

    Attributes
    ----------
    mass, damping, stiffness : (Q, p, d, d).
    gravity : (Q, p, d) of the gravity torques.
    position, acceleration : (Q, p, m, d) of `Measurement.position` and `.acceleration`.
    ln_gain : (p, n) of the logarithms of the torque gains.
    delay : (p,) of the delay [s].
    """

    mass: Array
    damping: Array
    stiffness: Array
    gravity: Array
    position: Array
    acceleration: Array
    ln_gain: Array
    delay: Array

    def stiffened(self, stiffness: Array) -> "Tangents":
        """Return the tangents with `stiffness` (Q, p, d, d) added."""
        return replace(self, stiffness=self.stiffness + stiffness)

    def sensitivity(self, omega: Array, model: LinearModel) -> ComplexArray:
        """Return the part of dG/d ln theta they add, (Q, F, m, n, p).

        dG = -Z^T (dK + j omega dD - omega^2 dM) X + dC X, then gains and delay.
        """
        w = np.asarray(omega, dtype=float)[:, None, None, None]
        X, Z = model.receptances(omega)
        # Each term is a product of real derivatives (no frequency) with complex columns.
        J = -_between(Z, self.stiffness, X) + w**2 * _between(Z, self.mass, X)
        if self.damping.any():
            J = J - 1j * w * _between(Z, self.damping, X)
        late = np.exp(-1j * w * model.measured.delay)
        if self.position.any():
            J = J + late * _times(self.position, X)
        if self.acceleration.any():
            J = J - late * w**2 * _times(self.acceleration, X)
        if self.ln_gain.any() or self.delay.any():
            G = model.frequency_response(omega)[..., None]
            J = J + G * (self.ln_gain.T - 1j * w * self.delay)
        return np.asarray(J)


def differentiate(
    rest: Callable[[Array, Array], Skeleton],
    theta: Array,
    coordinates: Array,
    shift: Array,
    columns: Sequence[int],
) -> Tangents:
    """Differentiate a skeleton along ln theta by central differences.

    Parameters
    ----------
    rest : the skeleton as a function of theta (p,) and the arm's coordinates (Q, d).
    theta, coordinates : where.
    shift : (Q, d, p) derivative of the coordinates by ln theta.
    columns : parameters to differentiate by; the other derivatives are zero.
    """
    derivatives = {
        name: np.zeros((len(theta), *array.shape))
        for name, array in _arrays(rest(theta, coordinates)).items()
    }
    for j in columns:
        factor = np.ones(len(theta))
        factor[j] += STEP
        plus = _arrays(rest(theta * factor, coordinates + STEP * shift[..., j]))
        factor[j] -= 2 * STEP
        minus = _arrays(rest(theta * factor, coordinates - STEP * shift[..., j]))
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


def _arrays(rest: Skeleton) -> dict[str, Array]:
    return {
        "mass": rest.mass,
        "damping": rest.damping,
        "stiffness": rest.stiffness,
        "gravity": rest.gravity,
        "position": rest.measurement.position,
        "acceleration": rest.measurement.acceleration,
        "ln_gain": np.log(rest.measurement.gain),
        "delay": np.array(rest.measurement.delay),
    }


def _times(derivative: Array, columns: ComplexArray) -> ComplexArray:
    """Return derivative (Q, p, m, d) times columns (Q, F, d, n), as (Q, F, m, n, p)."""
    q, f, d, n = columns.shape
    flat = columns.transpose(0, 2, 1, 3).reshape(q, 1, d, f * n)
    product = derivative @ flat.real + 1j * (derivative @ flat.imag)
    return np.asarray(product.reshape(q, -1, derivative.shape[-2], f, n).transpose(0, 3, 2, 4, 1))


def _between(left: ComplexArray, derivative: Array, right: ComplexArray) -> ComplexArray:
    """Return left^T (derivative) right, (Q, F, m, n, p)."""
    inner = _times(derivative, right)  # (Q, F, d, n, p)
    q, f, d, n, p = inner.shape
    product = np.swapaxes(left, -1, -2) @ inner.reshape(q, f, d, n * p)
    return np.asarray(product.reshape(q, f, -1, n, p))
