"""Springs and dampers strung on a rigid skeleton whose equilibria are held fixed.

Between equilibria everything is linear in stiffness and damping, so the derivative of an FRF
with respect to a spring is of rank one. The reference formulas here are plain numpy; the fast
ones in `kernel.py` are tested against them.
"""

from dataclasses import dataclass

import numpy as np

from robotmodels.arrays import Array, ComplexArray, IntArray
from robotmodels.linear_model import LinearModel
from robotmodels.parameters import Parameters


@dataclass(frozen=True, eq=False)
class SpringNetwork:
    """A skeleton (mass, gravity, bearing friction) at Q equilibria, and s spring-damper pairs.

    Attributes
    ----------
    mass : (Q, d, d) [kg m^2].
    damping, stiffness : (Q, d, d), what does not come from the springs.
    selector : (d, n), as in `LinearModel`.
    ends : (s, 2) the two coordinates each spring joins; -1 is the ground (passive torsions).
    spring_stiffness, spring_damping : (Q, s) at `parameters.values`; a nonlinear spring's
        stiffness differs from position to position.
    exponents : (Q, 2 s, p) derivative of ln(stiffnesses, dampings) with respect to ln theta:
        zeros and ones, except for nonlinear springs.
    parameters : the p free parameters at which the equilibria were found.
    """

    mass: Array
    damping: Array
    stiffness: Array
    selector: Array
    ends: IntArray
    spring_stiffness: Array
    spring_damping: Array
    exponents: Array
    parameters: Parameters

    def incidence(self) -> Array:
        """Return a, (s, d): a spring's elongation is a @ q."""
        a = np.zeros((len(self.ends), self.mass.shape[-1]))
        for row, (first, second) in zip(a, self.ends, strict=True):
            row[first] = 1.0
            if second >= 0:
                row[second] = -1.0
        return a

    def springs(self, parameters: Array | None = None) -> tuple[Array, Array]:
        """Return the (Q, s) stiffnesses and dampings at `parameters`, equilibria held fixed."""
        theta = self.parameters.check(parameters)
        factors = np.exp(self.exponents @ np.log(theta / self.parameters.values))
        s = len(self.ends)
        return self.spring_stiffness * factors[:, :s], self.spring_damping * factors[:, s:]

    def linear_model(self, parameters: Array | None = None) -> LinearModel:
        """Return the linear models, leading axis Q, at `parameters`."""
        a = self.incidence()
        k, c = self.springs(parameters)
        return LinearModel(
            mass=self.mass,
            damping=self.damping + np.einsum("qs,si,sj->qij", c, a, a),
            stiffness=self.stiffness + np.einsum("qs,si,sj->qij", k, a, a),
            selector=self.selector,
        )

    def frequency_response(self, omega: Array, parameters: Array | None = None) -> ComplexArray:
        """Return G, (Q, F, n, n)."""
        return self.linear_model(parameters).frequency_response(omega)

    def sensitivity(
        self, omega: Array, parameters: Array | None = None
    ) -> tuple[ComplexArray, ComplexArray]:
        """Return G, (Q, F, n, n), and dG/d ln theta, (Q, F, n, n, p), equilibria held fixed.

        dG/d ln k = omega^2 k v v^T and dG/d ln c = j omega^3 c v v^T with v = X^T a.
        """
        X = self.linear_model(parameters).receptance(omega)
        k, c = self.springs(parameters)
        v = np.einsum("si,qfin->qfsn", self.incidence(), X)
        w = np.asarray(omega, dtype=float)
        scale = np.concatenate(
            [
                w[None, :, None] ** 2 * k[:, None, :],
                1j * w[None, :, None] ** 3 * c[:, None, :],
            ],
            axis=-1,
        )
        twice = np.concatenate([v, v], axis=2)
        J = np.einsum(
            "qft,qftm,qftn,qtp->qfmnp", scale, twice, twice, self.exponents, optimize=True
        )
        G = -(w[:, None, None] ** 2) * (self.selector.T @ X)
        return G, J


@dataclass(frozen=True, eq=False)
class Tangents:
    """What the frozen equilibria leave out: derivatives of mass and stiffness by ln theta.

    Attributes
    ----------
    mass, stiffness : (Q, p, d, d).
    """

    mass: Array
    stiffness: Array

    def sensitivity(self, omega: Array, receptance: ComplexArray) -> ComplexArray:
        """Return the part of dG/d ln theta they add, (Q, F, n, n, p).

        dG = omega^2 X^T (dK - omega^2 dM) X, with X (Q, F, d, n) the `receptance`.
        """
        w = np.asarray(omega, dtype=float)[:, None, None]

        def through(derivative: Array) -> ComplexArray:
            """X^T (derivative) X, (Q, F, n, n, p), one product of real matrices per position."""
            q, f, d, n = receptance.shape
            columns = receptance.transpose(0, 2, 1, 3).reshape(q, 1, d, f * n)
            right = (derivative @ columns.real + 1j * (derivative @ columns.imag)).reshape(
                q, -1, d, f, n
            )
            return np.asarray(np.einsum("qfdm,qpdfn->qfmnp", receptance, right, optimize=True))

        stiff, inert = through(self.stiffness), through(self.mass)
        return np.asarray(w[..., None] ** 2 * stiff - w[..., None] ** 4 * inert)
