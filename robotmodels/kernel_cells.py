"""Prepare the evaluation of residual costs: a `CostKernel` is made once and called often."""

from typing import Literal, get_args

import numpy as np

from robotmodels.arrays import Array, ComplexArray
from robotmodels.errors import InvalidInput, nearest
from robotmodels.kernel_cost import Cells, cell_costs, parted, vectors
from robotmodels.kernel_layout import Layout, layout, reduced
from robotmodels.kernel_memory import address
from robotmodels.kernel_threads import over_threads
from robotmodels.kernel_work import contiguous, network_tables, workspace
from robotmodels.simd import LANES
from robotmodels.spring_network import SpringNetwork

Residual = Literal["nls", "lls"]


class CostKernel:
    """Sum of w |epsilon|^2 over positions, frequencies and elements, as a function of theta.

    epsilon is measured - G ("nls") or the principal value of log(measured / G) ("lls"); the
    equilibria are those of `network`.

    Parameters
    ----------
    network : Q positions, the nominal parameters.
    omega : (F,) [rad/s].
    measured : (Q, F, m, n) FRFs.
    weights : (Q, F, m, n) inverse variances; zero leaves an element out.
    residual : "nls" or "lls".

    Raises
    ------
    InvalidInput : for shapes that do not fit, negative weights, or another residual.
    """

    def __init__(
        self,
        network: SpringNetwork,
        omega: Array,
        measured: ComplexArray,
        weights: Array,
        residual: Residual = "nls",
    ) -> None:
        self.network, self.residual = network, residual
        self._omega = positive_frequencies(omega)
        self._measured, self._weights = _checked(network, self._omega, measured, weights, residual)
        full = layout(network)
        if full is None or not self._measured.size:
            self._plan = None
            return
        self._plan = reduced(full)
        self._coupled = bool(np.any(self._plan.needed[:, 2] >= 0))
        self._tables = network_tables(network)
        self._cells, self._constant = self._prepare(full, self._plan)

    def __call__(self, parameters: Array) -> Array:
        """Return the costs, (W,), of W sets of parameters, (W, p).

        Raises
        ------
        InvalidInput : if the size is wrong or a parameter is not positive and finite.
        """
        theta = np.atleast_2d(np.asarray(parameters, dtype=float))
        p = len(self.network.parameters)
        if theta.shape[1:] != (p,) or not np.all(np.isfinite(theta) & (theta > 0)):
            for row in theta:
                self.network.parameters.check(row)
        if self._plan is None:
            return np.array([self._reference(row) for row in theta])
        stiffness, damping = self._springs(theta)
        plan, tables = self._plan, self._tables
        blocks = -(-self._omega.size // LANES)
        options = len(self.network.mass), blocks, self._coupled, self.residual == "lls"
        cells = Cells(*(address(a) for a in self._cells))
        pieces: list[Array] = []

        def run(start: int, stop: int) -> None:
            out = np.zeros(len(theta))
            space = workspace(plan, self.network, tables)
            cell_costs(
                space.at,
                cells,
                address(stiffness),
                address(damping),
                len(theta),
                options,
                start,
                stop,
                address(out),
            )
            pieces.append(out)

        over_threads(run, blocks * len(self.network.mass), work_per_item=len(theta))
        return np.asarray(self._constant + np.sum(pieces, axis=0))

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        # Copies of aligned buffers would not be aligned: another process prepares its own.
        made_of = self.network, self._omega, self._measured, self._weights, self.residual
        return CostKernel, made_of

    def _springs(self, theta: Array) -> tuple[Array, Array]:
        """Return stiffnesses and dampings, (W, Q, s)."""
        exponents, s = self.network.exponents, len(self.network.ends)
        if np.all(exponents == exponents[:1]):
            exponents = exponents[:1]
        steps = np.log(theta / self.network.parameters.values)
        factors = np.exp(np.einsum("qtp,wp->wqt", exponents, steps, optimize=True))
        return (
            contiguous(self.network.spring_stiffness * factors[..., :s]),
            contiguous(self.network.spring_damping * factors[..., s:]),
        )

    def _prepare(self, full: Layout, plan: Layout) -> tuple[list[Array], float]:
        """Return the arrays of `Cells`, and the cost no model can undo."""
        blocks = -(-self._omega.size // LANES)
        A = _remaining_matrix(self.network, self._omega, full, plan)
        size = A.shape[-1]
        off = np.abs(A * (1 - np.eye(size))).max(axis=-1)
        w = np.broadcast_to(self._omega, A.shape[:2])
        targets, constant = self._targets()
        inside = np.pad(np.ones(self._omega.size), (0, blocks * LANES - self._omega.size))
        packed = vectors(targets, blocks).reshape(len(A), blocks, -1, targets.shape[-1], LANES)
        packed[..., _WEIGHTS[self.residual], :] *= inside.reshape(blocks, 1, 1, LANES)
        return (
            [
                vectors(w[..., None], blocks),
                vectors(parted(A[..., *np.tril_indices(size)]), blocks),
                vectors(off, blocks),
                packed.reshape(-1),
            ],
            constant,
        )

    def _targets(self) -> tuple[Array, float]:
        """Return what each element i <= j is compared with, and the cost no model can undo."""
        i, j = np.triu_indices(self._measured.shape[-1])
        single = i == j
        w2 = self._omega[:, None] ** 2
        upper, lower = (-self._measured[..., a, b] / w2 for a, b in ((i, j), (j, i)))
        u, v = self._weights[..., i, j], np.where(single, 0.0, self._weights[..., j, i])
        both = np.where(u + v > 0, u + v, 1.0)
        if self.residual == "nls":
            mean = (u * upper + v * lower) / both
            constant = u * np.abs(upper - mean) ** 2 + v * np.abs(lower - mean) ** 2
            parts = [mean.real, mean.imag, (u + v) * w2**2]
            return np.stack(parts, axis=-1), float(np.sum(constant * w2**2))
        a, b = np.log(np.abs(upper)), np.log(np.abs(lower))
        mean = (u * a + v * b) / both
        constant = u * (a - mean) ** 2 + v * (b - mean) ** 2
        parts = [mean, u + v, np.angle(upper), u, np.angle(lower), v]
        return np.stack(parts, axis=-1), float(np.sum(constant))

    def _reference(self, theta: Array) -> float:
        """Return the cost by plain numpy: what the kernel does not know."""
        G = self.network.frequency_response(self._omega, theta)
        apart = self._measured - G if self.residual == "nls" else np.log(self._measured / G)
        return float(np.sum(self._weights * np.abs(apart) ** 2))


_WEIGHTS = {"nls": [2], "lls": [1, 3, 5]}


def _checked(
    network: SpringNetwork, omega: Array, measured: ComplexArray, weights: Array, residual: str
) -> tuple[ComplexArray, Array]:
    """Return measured FRFs and weights as arrays, elements of weight zero replaced by ones."""
    if residual not in get_args(Residual):
        known = get_args(Residual)
        raise InvalidInput(
            f"residual: {residual!r} is not one of {', '.join(known)}{nearest(residual, known)}"
        )
    n, sensors = network.selector.shape[1], network.measurement
    outputs = n if sensors is None else sensors.position.shape[-2]
    shape = (len(network.mass), omega.size, outputs, n)
    measured, weights = np.asarray(measured, dtype=complex), np.asarray(weights, dtype=float)
    for name, array in (("measured", measured), ("weights", weights)):
        if array.shape != shape:
            raise InvalidInput(f"{name}: shape {array.shape} was given, {shape} is needed")
    if not np.all(weights >= 0):
        raise InvalidInput("weights: a weight is negative; inverse variances are needed")
    return np.where(weights > 0, measured, 1.0), weights


def positive_frequencies(omega: Array) -> Array:
    """Return `omega` as an array.

    Raises
    ------
    InvalidInput : unless it is a list of positive, finite frequencies.
    """
    w = np.asarray(omega, dtype=float)
    wrong = ~(np.isfinite(w) & (w > 0))
    if w.ndim != 1 or wrong.any():
        found = f"shape {w.shape}" if w.ndim != 1 else f"{w[wrong][0]:g}"
        raise InvalidInput(f"omega: {found}; a list of positive frequencies [rad/s] is needed")
    return w


def _remaining_matrix(
    network: SpringNetwork, omega: Array, full: Layout, plan: Layout
) -> ComplexArray:
    """Return A without free and motor springs, (Q, F, size, size), other rows eliminated."""
    mass, damping, stiffness = (
        np.array(m, dtype=float) for m in (network.mass, network.damping, network.stiffness)
    )
    free = set(full.needed[:, 0])
    for s, i, j in full.inner:
        if s in free:
            continue
        a = np.zeros(mass.shape[-1])
        a[full.order[i]] = 1.0
        if j >= 0:
            a[full.order[j]] = -1.0
        stiffness += network.spring_stiffness[:, s, None, None] * np.outer(a, a)
        damping = damping + network.spring_damping[:, s, None, None] * np.outer(a, a)
    rows = full.order[full.pad :]
    w = omega[:, None, None]
    A = (
        stiffness[:, None, rows[:, None], rows]
        - w**2 * mass[:, None, rows[:, None], rows]
        + 1j * w * np.broadcast_to(damping, mass.shape)[:, None, rows[:, None], rows]
    )
    cut = full.first - full.pad
    if cut:
        A = A[..., cut:, cut:] - A[..., cut:, :cut] @ np.linalg.solve(
            A[..., :cut, :cut], A[..., :cut, cut:]
        )
    out = np.zeros((*A.shape[:2], len(plan.order), len(plan.order)), dtype=complex)
    out[..., range(plan.pad), range(plan.pad)] = 1.0
    out[..., plan.pad :, plan.pad :] = A
    return out
