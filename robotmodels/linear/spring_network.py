"""Springs, dampers and free inertias on a rigid skeleton whose equilibria are fixed.

Between equilibria everything is linear in stiffness, damping and inertia, so the derivative of an
FRF with respect to a spring, or to the inertia of one coordinate, is of rank one. The reference
formulas here are plain numpy; the fast ones in `kernel` are tested against them.
"""

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.common.deprecation import renamed_attributes
from robotmodels.common.errors import InvalidInput
from robotmodels.description.parameters import Parameters
from robotmodels.linear.linear_model import LinearModel, Measurement

_T = TypeVar("_T", bound=np.generic)


@dataclass(frozen=True, eq=False)
class Inertances:
    """Free inertias of single coordinates, each with viscous friction against the ground.

    As a spring and its damper add k + j omega c to the dynamic stiffness, these add
    j omega (friction + j omega inertia).

    Attributes
    ----------
    coordinates : ndarray of int, (r,)
        What moves.
    friction, inertia : ndarray, (r,)
        At the network's parameters [N m s/rad, kg m^2].
    exponents : ndarray, (2 r, p)
        Derivative of ln(frictions, inertias) with respect to ln theta.
    """

    coordinates: IntArray
    friction: Array
    inertia: Array
    exponents: Array


@renamed_attributes("0.2", ends="nodes", beyond="non_spring_parameters")
@dataclass(frozen=True, eq=False)
class SpringNetwork:
    """A skeleton (mass, gravity, bearing friction) at Q equilibria, and s spring-damper pairs.

    Terms of the dynamic stiffness are springs, then inertances; each has two coefficients:
    stiffness and damping, or friction and inertia.

    Attributes
    ----------
    mass : ndarray, (Q, d, d), kg m^2
        Mass matrix without the terms.
    damping : ndarray, (d, d) or (Q, d, d), N m s/rad
        Damping matrix without the terms.
    stiffness : ndarray, (Q, d, d), N m/rad
        Stiffness matrix without the terms.
    selector : ndarray, (d, n) or (Q, d, n)
        As in `LinearModel`.
    nodes : ndarray of int, (s, 2)
        The two coordinates that each spring joins; -1 is the ground (passive torsions).
    spring_stiffness, spring_damping : ndarray, (Q, s)
        At `parameters.values`; a nonlinear spring's stiffness differs from position to position.
    exponents : ndarray, (Q, 2 s, p)
        Derivative of ln(stiffnesses, dampings) with respect to ln theta: zeros and ones, except for
        nonlinear springs.
    parameters : Parameters
        The p free parameters at which the equilibria were computed.
    measurement : Measurement or None
        As in `LinearModel`, with leading axis Q; None for motor accelerations.
    inertances : Inertances or None
        r of them, alike at all positions; None where no inertia is free.
    non_spring_parameters : tuple of str
        Names of free parameters that also change mass, gravity or outputs.
    torque_springs : ndarray of int, (m,), or None
        Spring whose torque on what is beyond it an output measures; -1 of other outputs, None
        where there is no such output. `measurement` leaves these torques out, as they change with
        the parameters; that of `linear_model` has them.
    """

    mass: Array
    damping: Array
    stiffness: Array
    selector: Array
    nodes: IntArray
    spring_stiffness: Array
    spring_damping: Array
    exponents: Array
    parameters: Parameters
    measurement: Measurement | None = None
    inertances: Inertances | None = None
    non_spring_parameters: tuple[str, ...] = ()
    torque_springs: IntArray | None = None

    @property
    def only_springs(self) -> bool:
        """Whether every free parameter acts through springs, dampers and inertances alone."""
        return not self.outside

    @property
    def outside(self) -> tuple[str, ...]:
        """Names of free parameters that act on more than the terms, or not on them at all."""
        exponents = shared(self.coefficient_exponents)
        acts: NDArray[np.bool_] = np.any(exponents, axis=(0, 1)) | (len(exponents) == 0)
        return tuple(
            name
            for name, acting in zip(self.parameters.names, acts, strict=True)
            if name in self.non_spring_parameters or not acting
        )

    @property
    def only_motors(self) -> bool:
        """Whether motor angles, speeds or accelerations are measured, and nothing else."""
        return self.measurement is None or self.measurement.motor_order(self.selector) is not None

    @property
    def outputs_stay(self) -> bool:
        """Whether outputs read motions alike at all equilibria, as encoders do.

        Their rows are then one and the same in memory; sensors on links turn with these.
        """
        if self.measurement is None:
            return True
        parts = self.measurement.position, self.measurement.velocity, self.measurement.acceleration
        return all(part.strides[0] == 0 for part in parts)

    @property
    def motor_rows(self) -> IntArray:
        """Output that is each motor's angle, speed or acceleration, (n,); -1 where none is."""
        n = self.selector.shape[1]
        if self.measurement is None:
            return np.arange(n)
        parts = self.measurement.position, self.measurement.velocity, self.measurement.acceleration
        seen = [np.any(part, axis=(0, -1)) for part in parts]  # (m,) each
        rows = np.full(n, -1, dtype=np.int64)
        for j, motor in enumerate(self.selector.T):
            for k, part in enumerate(parts):
                equal = (part == motor).all(axis=(0, -1)) & (sum(seen) == 1) & seen[k]
                rows[j] = np.argmax(equal) if equal.any() and rows[j] < 0 else rows[j]
        return rows

    def of_outputs(self, rows: IntArray) -> "SpringNetwork":
        """Return the network with some outputs (rows) of its measurement, in that order."""
        if self.measurement is None:
            return self
        springs = self.torque_springs
        return replace(
            self,
            measurement=self.measurement.of_outputs(rows),
            torque_springs=None if springs is None else springs[rows],
        )

    def motor_factors(self, omega: Array) -> ComplexArray:
        """Return what the FRF is per FRF of plain motor accelerations, (F, n), by input.

        Raises
        ------
        InvalidInput
            If something else than the motors is measured.
        """
        w = np.asarray(omega, dtype=float)[:, None]
        if self.measurement is None:
            return np.ones((len(w), self.selector.shape[1]), dtype=complex)
        order = self.measurement.motor_order(self.selector)
        if order is None:
            raise InvalidInput("network: something else than the motors is measured")
        delay = np.exp(-1j * w * self.measurement.delay)
        torques = self.measurement.torque.response(omega)
        return np.asarray(delay * (1j * w) ** (order - 2) * torques)

    @property
    def coefficient_exponents(self) -> Array:
        """Derivative of ln(first, second coefficients) of the terms, (Q, 2 (s + r), p)."""
        if self.inertances is None:
            return self.exponents
        s, r = len(self.nodes), len(self.inertances.coordinates)
        inertial = np.broadcast_to(
            self.inertances.exponents, (len(self.mass), *self.inertances.exponents.shape)
        )
        parts = [self.exponents[:, :s], inertial[:, :r], self.exponents[:, s:], inertial[:, r:]]
        return np.concatenate(parts, axis=1)

    @property
    def free_terms(self) -> IntArray:
        """Terms of which a free parameter sets one of the coefficients."""
        exponents = shared(self.coefficient_exponents)
        moved = (
            np.any(exponents != 0, axis=(0, 2)) if len(exponents) else np.ones(exponents.shape[1])
        )
        return np.flatnonzero(np.any(moved.reshape(2, -1), axis=0))

    @property
    def coefficients(self) -> tuple[Array, Array]:
        """First and second coefficients of the terms, (Q, s + r), at the network's parameters."""
        if self.inertances is None:
            return self.spring_stiffness, self.spring_damping
        inertances = self.inertances
        shape = len(self.mass), len(inertances.coordinates)
        return (
            np.concatenate(
                [self.spring_stiffness, np.broadcast_to(inertances.friction, shape)], axis=1
            ),
            np.concatenate(
                [self.spring_damping, np.broadcast_to(inertances.inertia, shape)], axis=1
            ),
        )

    def incidence(self) -> Array:
        """Return a, (s, d): a spring's elongation is a @ q."""
        return incidence(self.nodes, self.mass.shape[-1])

    def coefficients_at(self, parameters: Array | None = None) -> tuple[Array, Array]:
        """Return both coefficients of the terms, (Q, s + r), at `parameters`."""
        first, second = self.coefficients
        if parameters is None:
            return first, second
        theta = self.parameters.check(parameters)
        factors = np.exp(self.coefficient_exponents @ np.log(theta / self.parameters.values))
        return first * factors[:, : first.shape[1]], second * factors[:, first.shape[1] :]

    def springs(self, parameters: Array | None = None) -> tuple[Array, Array]:
        """Return the (Q, s) stiffnesses and dampings at `parameters`, equilibria fixed."""
        s = len(self.nodes)
        first, second = self.coefficients_at(parameters)
        return first[:, :s], second[:, :s]

    def without_springs(self, parameters: Array | None = None) -> tuple[Array, Array]:
        """Return mass, (Q, d, d), and damping, (d, d) or (Q, d, d), of all but the springs."""
        if self.inertances is None:
            return self.mass, self.damping
        e, s = self._moves(), len(self.nodes)
        friction, inertia = (
            np.einsum("qs,si,sj->qij", x[:, s:], e, e) for x in self.coefficients_at(parameters)
        )
        return self.mass + inertia, self.damping + friction

    def linear_model(self, parameters: Array | None = None) -> LinearModel:
        """Return the linear models, leading axis Q, at `parameters`."""
        a, s = self.incidence(), len(self.nodes)
        first, second = self.coefficients_at(parameters)
        mass, damping = self.without_springs(parameters)
        return LinearModel(
            mass=mass,
            damping=damping + np.einsum("qs,si,sj->qij", second[:, :s], a, a),
            stiffness=self.stiffness + np.einsum("qs,si,sj->qij", first[:, :s], a, a),
            selector=self.selector,
            measurement=self._measurement(first, second),
        )

    def _measurement(self, stiffness: Array, damping: Array) -> Measurement | None:
        """Return what is measured, with the torques -(k + s c) a q of springs."""
        if self.measurement is None or self.torque_springs is None:
            return self.measurement
        rows, springs, a = self._torque_rows()
        position, velocity = self.measurement.position.copy(), self.measurement.velocity.copy()
        position[:, rows] -= stiffness[:, springs, None] * a
        velocity[:, rows] -= damping[:, springs, None] * a
        return replace(self.measurement, position=position, velocity=velocity)

    def _torque_rows(self) -> tuple[IntArray, IntArray, Array]:
        """Return outputs that are torques of springs, their springs, and a of these."""
        assert self.torque_springs is not None
        rows = np.flatnonzero(self.torque_springs >= 0)
        springs = self.torque_springs[rows]
        return rows, springs, self.incidence()[springs]

    def frequency_response(self, omega: Array, parameters: Array | None = None) -> ComplexArray:
        """Return G, (Q, F, m, n)."""
        return self.linear_model(parameters).frequency_response(omega)

    def sensitivity(
        self,
        omega: Array,
        parameters: Array | None = None,
        receptances: tuple[ComplexArray, ComplexArray] | None = None,
    ) -> tuple[ComplexArray, ComplexArray]:
        """Return G, (Q, F, m, n), and dG/d ln theta, (Q, F, m, n, p), equilibria fixed.

        dG/d ln k = -k (Z^T a)(X^T a)^T and dG/d ln c = -j omega c (Z^T a)(X^T a)^T; of an
        inertance, friction has the factor -j omega and inertia omega^2. `receptances` are X and Z
        of the linear model, where the caller has them.
        """
        model = self.linear_model(parameters)
        X, Z = model.receptances(omega) if receptances is None else receptances
        left, right, weights = self._factors(omega, (X, Z), parameters)
        products = left[..., :, None, :] * right[..., None, :, :]
        J = products.reshape(*left.shape[:2], -1, left.shape[-1]) @ weights
        G = np.swapaxes(Z, -1, -2) @ model.forces(omega) + model.measured.direct(omega)
        J = J.reshape(*G.shape, -1)
        if self.torque_springs is not None:
            rows, springs, a = self._torque_rows()
            sensors = np.broadcast_to(model.measured.sensors(omega), G.shape[1:3])[:, rows, None]
            # What its coefficients are to a spring's torque, beside its elongation.
            direct = self._weights(omega, springs, parameters)
            J[:, :, rows] += (sensors * direct)[..., None, :] * (a @ X)[..., None]
        return G, J

    def rank_one_sensitivity(
        self, omega: Array, parameters: Array | None = None
    ) -> tuple[ComplexArray, ComplexArray, ComplexArray, ComplexArray]:
        """Return G and the factors of dG/d ln theta_a = sum_t w_ta y_t v_t^T.

        Of the t free terms y is (Q, F, m, t), v (Q, F, n, t) and w (Q, F, t, p). What springs do to
        sensors of their own torque is not in it.
        """
        model = self.linear_model(parameters)
        X, Z = model.receptances(omega)
        G = np.swapaxes(Z, -1, -2) @ model.forces(omega) + model.measured.direct(omega)
        return G, *self._factors(omega, (X, Z), parameters)

    def _factors(
        self, omega: Array, receptances: tuple[ComplexArray, ComplexArray], parameters: Array | None
    ) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Return y, v and w of `rank_one_sensitivity`."""
        a, free = self.incidence(), self.free_terms
        if self.inertances is not None:
            a = np.concatenate([a, self._moves()])
        right, left = (np.swapaxes(part, -1, -2) @ a[free].T for part in receptances)
        return left, right, self._weights(omega, free, parameters)

    def rank_one_weights(self, omega: Array) -> ComplexArray:
        """Return w of `rank_one_sensitivity`, (Q, F, t, p)."""
        return self._weights(omega, self.free_terms, None)

    def _weights(self, omega: Array, terms: IntArray, parameters: Array | None) -> ComplexArray:
        """Return what parameters do to terms, in units of their elongations, (Q, F, t, p)."""
        first, second = self.coefficients_at(parameters)
        jw = 1j * np.asarray(omega)[None, :, None]
        ones = np.ones((len(first), jw.size, len(self.nodes)), dtype=complex)
        if self.inertances is not None:
            # What j omega is to a damper beside its spring, it is to an inertia beside friction.
            more = np.ones((len(first), 1, len(self.inertances.friction)))
            ones = np.concatenate([ones, jw * more], axis=-1)
        scale = np.stack([-ones * first[:, None], -ones * jw * second[:, None]], axis=2)
        exponents = self.coefficient_exponents.reshape(len(first), 2, first.shape[1], -1)
        return np.asarray(np.einsum("qfts,qtsp->qfsp", scale[..., terms], exponents[:, :, terms]))

    def _moves(self) -> Array:
        """Return the unit vectors of the inertances' coordinates, (r, d)."""
        unit = np.eye(self.mass.shape[-1])
        return (
            unit[:0] if self.inertances is None else np.asarray(unit[self.inertances.coordinates])
        )


def shared(array: NDArray[_T]) -> NDArray[_T]:
    """Return `array` (Q, ...), or its first item where all are one and the same in memory."""
    return array[:1] if array.strides[0] == 0 else array


def incidence(ends: IntArray, size: int) -> Array:
    """Return a, (s, size), for springs between the coordinates `nodes` (s, 2); -1 is the ground."""
    a = np.zeros((len(ends), size))
    for row, (first, second) in zip(a, ends, strict=True):
        row[first] = 1.0
        if second >= 0:
            row[second] = -1.0
    return a
