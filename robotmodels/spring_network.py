"""Springs and dampers strung on a rigid skeleton whose equilibria are held fixed.

Between equilibria everything is linear in stiffness and damping, so the derivative of an FRF
with respect to a spring is of rank one. The reference formulas here are plain numpy; the fast
ones in `kernel.py` are tested against them.
"""

from dataclasses import dataclass

import numpy as np

from robotmodels.arrays import Array, ComplexArray, IntArray
from robotmodels.linear_model import LinearModel
from robotmodels.measurement import Measurement
from robotmodels.parameters import Parameters


@dataclass(frozen=True, eq=False)
class SpringNetwork:
    """A skeleton (mass, gravity, bearing friction) at Q equilibria, and s spring-damper pairs.

    Attributes
    ----------
    mass : (Q, d, d) [kg m^2].
    damping : (d, d), and
    stiffness : (Q, d, d), what does not come from the springs.
    selector : (d, n), as in `LinearModel`.
    ends : (s, 2) the two coordinates each spring joins; -1 is the ground (passive torsions).
    spring_stiffness, spring_damping : (Q, s) at `parameters.values`; a nonlinear spring's
        stiffness differs from position to position.
    exponents : (Q, 2 s, p) derivative of ln(stiffnesses, dampings) with respect to ln theta:
        zeros and ones, except for nonlinear springs.
    parameters : the p free parameters at which the equilibria were found.
    measurement : as in `LinearModel`, with leading axis Q; None for motor accelerations.
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
    measurement: Measurement | None = None

    @property
    def only_springs(self) -> bool:
        """Whether every free parameter acts through springs and dampers alone."""
        return bool(self.exponents.any(axis=(0, 1)).all())

    def incidence(self) -> Array:
        """Return a, (s, d): a spring's elongation is a @ q."""
        return incidence(self.ends, self.mass.shape[-1])

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
            measurement=self.measurement,
        )

    def frequency_response(self, omega: Array, parameters: Array | None = None) -> ComplexArray:
        """Return G, (Q, F, m, n)."""
        return self.linear_model(parameters).frequency_response(omega)

    def sensitivity(
        self, omega: Array, parameters: Array | None = None
    ) -> tuple[ComplexArray, ComplexArray]:
        """Return G, (Q, F, m, n), and dG/d ln theta, (Q, F, m, n, p), equilibria held fixed.

        dG/d ln k = -k (Z^T a)(X^T a)^T and dG/d ln c = -j omega c (Z^T a)(X^T a)^T.
        """
        model = self.linear_model(parameters)
        X, Z = model.receptances(omega)
        k, c = self.springs(parameters)
        a = self.incidence()
        scale = np.stack(
            [
                np.broadcast_to(-k[:, None, :], (len(k), len(omega), len(a))),
                -1j * np.asarray(omega)[None, :, None] * c[:, None, :],
            ],
            axis=2,
        )
        exponents = self.exponents.reshape(len(k), 2, len(a), -1)
        weights = np.einsum("qfts,qtsp->qfsp", scale, exponents)
        left, right = np.swapaxes(Z, -1, -2) @ a.T, np.swapaxes(X, -1, -2) @ a.T
        products = left[..., :, None, :] * right[..., None, :, :]
        J = products.reshape(*left.shape[:2], -1, len(a)) @ weights
        G = np.swapaxes(Z, -1, -2) @ (model.selector * model.measured.gain)
        return G, J.reshape(*G.shape, -1)


def incidence(ends: IntArray, size: int) -> Array:
    """Return a, (s, size), for springs between the coordinates `ends` (s, 2); -1 is the ground."""
    a = np.zeros((len(ends), size))
    for row, (first, second) in zip(a, ends, strict=True):
        row[first] = 1.0
        if second >= 0:
            row[second] = -1.0
    return a
