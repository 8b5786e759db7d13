"""Prepare the evaluation of residual costs: a `CostKernel` is made once and called often."""

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol, Self

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import InvalidInput
from robotmodels.kernel.adjoint import slopes
from robotmodels.kernel.cost_cells import Cells, cell_costs
from robotmodels.kernel.elimination_order import EliminationPlan, layout, reduced
from robotmodels.kernel.gauss_newton import cell_normals
from robotmodels.kernel.memory import address, aligned
from robotmodels.kernel.output_cells import RunShape
from robotmodels.kernel.prepare import prepare_matrices, prepare_targets
from robotmodels.kernel.simd import LANES
from robotmodels.kernel.threads import over_threads
from robotmodels.kernel.workspace import Workspaces, contiguous, network_tables, workspace
from robotmodels.linear.normal_equations import NormalEquations, model_slopes, normal_equations
from robotmodels.linear.residuals import RESIDUALS, ResidualForm, residual_error, residual_form
from robotmodels.linear.spring_network import SpringNetwork

_PIECES = 4  # in which cells are summed
_SOLVES = 4  # what a cell's normal equations cost, in factorisations


class FitKernel(Protocol):
    """A compiled cost V of theta about fixed equilibria, with derivatives by ln theta."""

    def at(self, network: SpringNetwork) -> Self:
        """Return the cost of the same data about the equilibria of another network."""

    def __call__(self, parameters: Array) -> Array:
        """Return the costs, (W,), of W sets of parameters, (W, p)."""

    def normal_equations(self, parameters: Array) -> NormalEquations:
        """Return the cost at one set of parameters (p,), its gradient and Gauss-Newton's matrix."""

    def gradient(self, parameters: Array) -> tuple[float, Array]:
        """Return the cost and the gradient (p,) of `normal_equations`."""

    def model_slopes(self) -> tuple[Array, Array]:
        """Return dV/dK and dV/dM, (Q, d, d) each, at the network's own parameters."""


class CostKernel:
    """Sum of w |epsilon|^2 over positions, frequencies and elements, as a function of theta.

    epsilon is measured - G ("nls"), the principal value of log(measured / G) ("lls") or its real
    part ("lls_magnitude"); the equilibria are those of `network`. Calls may come from several
    threads at once, and another process prepares its own from a pickled one.

    Parameters
    ----------
    network : SpringNetwork
        Q positions, the nominal parameters.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    measured : ndarray of complex, (Q, F, m, n)
        FRFs.
    weights : ndarray, (Q, F, m, n)
        Inverse variances; zero leaves an element out, whatever it is.
    residual : str or ResidualForm
        "nls", "lls" or "lls_magnitude", for which there is compiled code, or one of your own, which
        numpy evaluates.

    Raises
    ------
    InvalidInput
        If a free parameter acts on more than the network's terms; for shapes that do not fit,
        negative weights, another residual, or a measured element with a weight that is not finite,
        or zero where a logarithm is taken.
    """

    _code: int | None
    _scratch = 0
    _targets: tuple[Array, Array, float] | None = None

    def __init__(
        self,
        network: SpringNetwork,
        omega: Array,
        measured: ComplexArray,
        weights: Array,
        residual: str | ResidualForm = "nls",
    ) -> None:
        self.residual = residual_form(residual)
        self._omega = positive_frequencies(omega)
        self._measured, self._weights = _checked(
            network, self._omega, measured, weights, self.residual
        )
        self._blocks = -(-self._omega.size // LANES)
        codes = list(RESIDUALS.values())
        compiles = self._measured.size and self.residual in codes
        self._code = codes.index(self.residual) if compiles else None
        self._set(network)

    def at(self, network: SpringNetwork) -> Self:
        """Return the kernel of the same data about the equilibria of another network.

        That is several times faster: what is measured is not prepared again.

        Raises
        ------
        InvalidInput
            If the network is of other positions, or a free parameter acts on more than its terms.
        """
        if network.mass.shape != self.network.mass.shape:
            raise InvalidInput(
                f"network: mass matrices of shape {network.mass.shape}; the same positions and "
                f"coordinates are needed as before, {self.network.mass.shape}"
            )
        if network is self.network:
            return self
        other = self._copy()
        other._set(network)
        return other

    def of_data(self, measured: ComplexArray, weights: Array) -> Self:
        """Return the kernel of other data about the same equilibria, whose matrices stay.

        Raises
        ------
        InvalidInput
            As a new one.
        """
        other = self._copy()
        made_of = self.network, self._omega, measured, weights, self.residual
        other._measured, other._weights = _checked(*made_of)
        if self._plan is not None:
            w, targets, other._constant = other._targets = other._prepared()
            other._cells = w, *self._cells[1:3], targets
            other._at = Cells(*(address(a) for a in other._cells))
        return other

    def _copy(self) -> Self:
        other = type(self).__new__(type(self))
        other.__dict__.update(self.__dict__)
        return other

    def _set(self, network: SpringNetwork) -> None:
        check_complete(network)
        self.network = network
        system = self._system = self._with_terminals(network)
        full = layout(system)
        if full is None or self._code is None:
            self._plan = None
            return
        self._plan = reduced(full)
        self._tables = network_tables(system)
        if self._targets is None:
            self._targets = self._prepared()
        coupled, shape = bool(np.any(self._plan.needed[:, 2] >= 0)), self._run_shape(self._plan)
        self._options = len(network.mass), self._blocks, coupled, self._code, shape
        self._spaces = Workspaces(self._plan, system, self._tables, self._scratch)
        exponents = network.coefficient_exponents
        alike = bool(np.all(exponents == exponents[:1]))
        self._exponents = exponents[: 1 if alike else None]
        w, targets, self._constant = self._targets
        matrix, off = prepare_matrices(system, self._omega, full, self._plan)
        self._cells = w, matrix, off, targets
        self._at = Cells(*(address(a) for a in self._cells))

    def _with_terminals(self, network: SpringNetwork) -> SpringNetwork:
        """Return the network that compiled code solves; one of the same springs."""
        return network

    def _run_shape(self, plan: EliminationPlan) -> RunShape | None:
        """Return the sizes of runs; None of FRFs."""
        return None

    def _prepared(self) -> tuple[Array, Array, float]:
        """Return frequencies and data as `Cells` wants them, and the cost no model can undo."""
        return prepare_targets(self._omega, *self._of_accelerations(), self.residual.name)

    def _of_accelerations(self) -> tuple[ComplexArray, Array]:
        """Return measured FRFs and weights as those of motor accelerations, the cost unchanged."""
        if self.network.measurement is None:
            return self._measured, self._weights
        factors = self.network.motor_factors(self._omega)[:, None, :]
        weights = (
            self._weights * np.abs(factors) ** 2 if not self.residual.relative else self._weights
        )
        return self._measured / factors, weights

    def __call__(self, parameters: Array) -> Array:
        """Return the costs, (W,), of W sets of parameters, (W, p).

        Raises
        ------
        InvalidInput
            If the size is wrong or a parameter is not positive and finite.
        """
        theta = np.atleast_2d(np.asarray(parameters, dtype=float))
        p = len(self.network.parameters)
        if theta.shape[1:] != (p,) or not np.all(np.isfinite(theta) & (theta > 0)):
            for row in theta:
                self.network.parameters.check(row)
        if self._plan is None:
            return np.array([self._reference(row) for row in theta])
        costs = self._sum(cell_costs, theta, len(theta), len(theta), len(theta))
        return np.asarray(self._constant + costs)

    def normal_equations(self, parameters: Array) -> NormalEquations:
        """Return the cost V at one set of parameters (p,), its gradient and Gauss-Newton's matrix.

        V is what the call returns, without a factor 1/2; derivatives are by ln theta, equilibria
        held fixed; the matrix is 2 sum w Re(conj(d epsilon) d epsilon^T).

        Raises
        ------
        InvalidInput
            If the size is wrong or a parameter is not positive and finite.
        """
        theta = self.network.parameters.check(parameters)
        if self._plan is None:
            return normal_equations(
                self.network, self._omega, self._measured, self._weights, theta, self.residual
            )
        p = len(theta)
        sums = self._sum(cell_normals, theta[None], 1 + p + p * p, _SOLVES, True)
        return NormalEquations(
            cost=float(self._constant + sums[0]),
            gradient=sums[1 : 1 + p],
            hessian=sums[1 + p :].reshape(p, p),
        )

    def gradient(self, parameters: Array) -> tuple[float, Array]:
        """Return the cost and the gradient (p,) of `normal_equations`, in half of its time."""
        theta = self.network.parameters.check(parameters)
        if self._plan is None:
            normal = self.normal_equations(theta)
            return normal.cost, normal.gradient
        sums = self._sum(cell_normals, theta[None], 1 + len(theta), _SOLVES // 2, False)
        return float(self._constant + sums[0]), sums[1:]

    def model_slopes(self) -> tuple[Array, Array]:
        """Return dV/dK and dV/dM, (Q, d, d) each, at the network's own parameters.

        By the stiffness and mass matrices of its linear model, for symmetric changes: dV is the sum
        of dV/dK dK and dV/dM dM over positions and entries.
        """
        network = self._system
        q, d = network.mass.shape[:2]
        full = layout(network)
        if full is None or self._plan is None:
            return model_slopes(network, self._omega, self._measured, self._weights, self.residual)
        plan = replace(full, first=full.pad)
        out = np.empty((q, 2, d, d))

        def run(start: int, stop: int) -> None:
            space = workspace(plan, network, self._tables, self._scratch)
            n = len(plan.motors)
            columns, sums = aligned(2 * n * (d + n)), aligned(d * (d + 1))
            buffers = address(columns), address(sums)
            slopes(space.at, self._at, self._options, *buffers, start, stop, address(out))

        over_threads(run, q, _SOLVES * self._blocks)
        return out[:, 0], out[:, 1]

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        # Copies of aligned buffers would not be aligned: another process prepares its own.
        made_of = self.network, self._omega, self._measured, self._weights, self.residual
        return CostKernel, made_of

    def _sum(
        self,
        compiled: Callable[..., None],
        theta: Array,
        length: int,
        work_per_item: int,
        choice: int,
    ) -> Array:
        """Return the sum over all cells of the `length` doubles that compiled code adds to.

        `choice` is its argument before the options: sets of parameters, or whether to sum a matrix.

        Each of a few pieces has a sum of its own, whatever thread computes it: the same bits from
        any number of threads.
        """
        plan = self._plan
        assert plan is not None
        stiffness, damping = self._springs(theta)
        springs = address(stiffness), address(damping)
        cells = self._blocks * len(self.network.mass)
        bounds = [cells * k // _PIECES for k in range(_PIECES + 1)]
        sums = np.zeros((_PIECES, length))

        def run(start: int, stop: int) -> None:
            with self._spaces.one() as work:
                for k in range(start, stop):
                    ends, out = bounds[k : k + 2], address(sums[k])
                    compiled(work, self._at, *springs, choice, self._options, *ends, out)

        over_threads(run, _PIECES, work_per_item * cells // _PIECES)
        return np.asarray(sums.sum(axis=0))

    def _springs(self, theta: Array) -> tuple[Array, Array]:
        """Return the first and second coefficients of all terms, (W, Q, s)."""
        first, second = self.network.coefficients
        steps = np.log(theta / self.network.parameters.values)
        factors = np.exp((self._exponents @ steps.T).transpose(2, 0, 1))
        return (
            contiguous(first * factors[..., : first.shape[1]]),
            contiguous(second * factors[..., first.shape[1] :]),
        )

    def _reference(self, theta: Array) -> float:
        """Return the cost by plain numpy: what the kernel does not know."""
        used = self._weights > 0
        G = self.network.frequency_response(self._omega, theta)[used]
        error = residual_error(self.residual, self._measured[used], G)
        return float(self._weights[used] @ np.abs(error) ** 2)


def _checked(
    network: SpringNetwork,
    omega: Array,
    measured: ComplexArray,
    weights: Array,
    residual: ResidualForm,
) -> tuple[ComplexArray, Array]:
    """Return measured FRFs and weights as arrays, elements of weight zero replaced by ones."""
    n, sensors = network.selector.shape[-1], network.measurement
    outputs = n if sensors is None else sensors.position.shape[-2]
    shape = (len(network.mass), omega.size, outputs, n)
    measured, weights = np.asarray(measured, dtype=complex), np.asarray(weights, dtype=float)
    for name, array in (("measured", measured), ("weights", weights)):
        if array.shape != shape:
            raise InvalidInput(f"{name}: shape {array.shape} was given, {shape} is needed")
    if not np.all(weights >= 0):
        raise InvalidInput("weights: a weight is negative; inverse variances are needed")
    measured = np.where(weights > 0, measured, 1.0)
    wrong = ~np.isfinite(measured) | ((measured == 0) & residual.relative)
    if wrong.any():
        index = tuple(int(i) for i in np.argwhere(wrong)[0])
        raise InvalidInput(
            f"measured: {measured[index]} at position, frequency, output, input {index}; a finite "
            f"FRF{' other than zero' if residual.relative else ''} or the weight zero is needed"
        )
    return measured, weights


def check_complete(network: SpringNetwork) -> None:
    """Refuse a network whose terms are not all that the free parameters act on.

    Raises
    ------
    InvalidInput
        Naming those parameters.
    """
    if network.outside:
        raise InvalidInput(
            f"free parameters {', '.join(network.outside)}: the kernel supports springs, dampers "
            "and single inertias only; use robotmodels.sensitivity"
        )


def positive_frequencies(omega: Array) -> Array:
    """Return `omega` as an array.

    Raises
    ------
    InvalidInput
        Unless it is a list of positive, finite frequencies.
    """
    w = np.asarray(omega, dtype=float)
    wrong = ~(np.isfinite(w) & (w > 0))
    if w.ndim != 1 or wrong.any():
        fault = f"shape {w.shape}" if w.ndim != 1 else f"{w[wrong][0]:g}"
        raise InvalidInput(f"omega: {fault}; a list of positive frequencies [rad/s] is needed")
    return w
