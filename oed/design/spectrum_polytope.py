"""The spectra that an experiment in each position may have, and the best for a linear objective."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from oed.design.column_generation import Columns
from oed.information_sets.information_set import InformationSet
from robotmodels.common.arrays import Array, IntArray, check_above_zero, real_numbers
from robotmodels.common.errors import InvalidInput, SolverFailed


@dataclass(frozen=True, eq=False)
class LineLimit:
    """A limit on a weighted sum of the lines' powers in each position.

    Attributes
    ----------
    cost : ndarray, (F,) or (Q, F)
        What a unit of power of each line takes of it, none negative: ones for the total power, half
        the squared gain to a joint's speed for its mean square.
    most : float
        The limit, for all positions.
    """

    cost: Array
    most: float


@dataclass(frozen=True, eq=False)
class SpectrumPolytopes:
    """The polytopes of the spectra that each position may have.

    Attributes
    ----------
    lines : ndarray, (Q, F, p, p)
        Information of each position and line for a unit of power.
    names : tuple of str
        p parameter names.
    costs, bounds : ndarray, (Q, R, F)
        (R,) of the limits.
    line_most : float
        Largest power of one line.
    """

    lines: Array
    names: tuple[str, ...]
    costs: Array
    bounds: Array
    line_most: float

    @classmethod
    def checked(
        cls,
        lines: Array,
        names: tuple[str, ...],
        limits: Mapping[str, LineLimit],
        line_most: float,
    ) -> "SpectrumPolytopes":
        """Return the polytopes of limits on `lines`.

        Raises
        ------
        InvalidInput
            If lines and limits do not fit, or a line has no limit.
        """
        lines, p = real_numbers(lines, "lines"), len(names)
        if lines.ndim != 4 or lines.shape[2:] != (p, p) or 0 in lines.shape:
            raise InvalidInput(f"lines: shape {lines.shape}; (Q, F, {p}, {p}) is needed")
        n, f = lines.shape[:2]
        # Every matrix is judged as a candidate is.
        InformationSet(np.zeros((n * f, 1)), lines.reshape(-1, p, p), names)
        costs, bounds = np.empty((n, len(limits), f)), np.empty(len(limits))
        for r, (name, limit) in enumerate(limits.items()):
            cost = real_numbers(limit.cost, f"limits: {name}: cost")
            if cost.shape not in ((f,), (n, f)) or not (np.isfinite(cost) & (cost >= 0)).all():
                raise InvalidInput(
                    f"limits: {name}: cost of shape {cost.shape}; numbers >= 0 of shape "
                    f"{(f,)} or {(n, f)} are needed"
                )
            check_above_zero(limit.most, f"limits: {name}: most")
            costs[:, r], bounds[r] = cost, limit.most
        if not line_most > 0:
            raise InvalidInput(f"line_most: {line_most!r} is not a number > 0")
        free = ~(costs > 0).any(axis=1)
        if free.any() and np.isinf(line_most):
            q, line = np.argwhere(free)[0]
            raise InvalidInput(f"limits: none holds for line {line} in position {q}")
        return cls(lines, names, costs, bounds, line_most)

    def flat(self) -> Columns:
        """Return each position's flat spectrum, as strong as its limits allow."""
        sums = self.costs.sum(axis=2)
        with np.errstate(divide="ignore"):
            level = np.minimum((self.bounds / sums).min(axis=1, initial=np.inf), self.line_most)
        powers = np.repeat(level[:, None], self.lines.shape[1], axis=1)
        return self._columns(np.arange(len(powers)), powers)

    def best_columns(self, weight: Array, level: float) -> tuple[float, Columns]:
        """Return a bound on tr(W H) of any spectrum, and the best spectra.

        Each single limit bounds the gain of a position; a linear program is solved only where
        that bound exceeds `level`. At most 2p spectra, all of larger gains, are returned.
        """
        gains = np.tensordot(self.lines, weight)
        single = [self._single(gains, r) for r in range(len(self.bounds))]
        bounds = np.stack([bound for bound, _ in single])
        lowest = np.argmin(bounds, axis=0)
        value = bounds.min(axis=0)
        spectra = np.stack([s for _, s in single])[lowest, np.arange(len(gains))]
        taken = np.einsum("qrf,qf->qr", self.costs, spectra)
        inside = (taken <= self.bounds * (1 + 1e-12)).all(axis=1)
        best: list[int] = []
        for q in np.argsort(-value):
            if len(best) == 2 * len(self.names) or value[q] <= level:
                break
            if not inside[q]:
                value[q], spectra[q] = self._program(gains[q], q)
            if value[q] > level:
                best.append(int(q))
        indices = np.array(best, dtype=np.int64)
        return float(value.max()), self._columns(indices, spectra[indices])

    def _columns(self, owners: IntArray, powers: Array) -> Columns:
        matrices = np.einsum("if,ifab->iab", powers, self.lines[owners])
        return Columns(owners, powers, matrices)

    def _single(self, gains: Array, row: int) -> tuple[Array, Array]:
        """Return the largest gains (Q,) under one limit, and the spectra (Q, F): knapsacks."""
        cost, gain = self.costs[:, row], np.maximum(gains, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(gain > 0, gain / cost, -np.inf)
        order = np.argsort(-ratio, axis=1, kind="stable")
        sorted_cost = np.take_along_axis(cost, order, axis=1)
        with np.errstate(invalid="ignore"):
            demand = np.where(sorted_cost > 0, sorted_cost * self.line_most, 0.0)
        before = np.zeros_like(demand)
        before[:, 1:] = np.cumsum(demand, axis=1)[:, :-1]
        slack = np.maximum(self.bounds[row] - before, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            power = np.where(
                sorted_cost > 0, np.minimum(demand, slack) / sorted_cost, self.line_most
            )
        power[np.take_along_axis(gain, order, axis=1) <= 0] = 0.0
        spectra = np.zeros_like(power)
        np.put_along_axis(spectra, order, power, axis=1)
        with np.errstate(invalid="ignore"):
            return np.where(gain > 0, gain * spectra, 0.0).sum(axis=1), spectra

    def _program(self, gains: Array, position: int) -> tuple[float, Array]:
        """Return a bound on the gain of one position under all limits, and the best spectrum."""
        top = None if np.isinf(self.line_most) else self.line_most
        solution = linprog(
            -gains, A_ub=self.costs[position], b_ub=self.bounds, bounds=[(0.0, top)] * len(gains)
        )
        if solution.x is None:
            raise SolverFailed(f"optimal spectrum: HiGHS: {solution.message}")
        # The dual value is the bound, whatever the precision of the spectrum.
        y = np.maximum(-solution.ineqlin.marginals, 0.0)
        line_costs = y @ self.costs[position]
        if top is not None:
            return float(
                y @ self.bounds + top * np.maximum(gains - line_costs, 0.0).sum()
            ), solution.x
        useful = gains > 0
        stretch = float((gains[useful] / line_costs[useful]).max(initial=1.0))
        return stretch * float(y @ self.bounds), solution.x
