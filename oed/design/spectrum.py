"""Positions and spectra together: which position to excite at which frequency lines, how strongly.

The information of an experiment is linear in the power of each line, and so are its limits. With
powers P_f of a position's lines between zero and their own limits, and C P <= c for every limit
(mean squares of torques and speeds, total power), the experiments in a position fill a polytope; a
design shares the experiments between corners of these polytopes. The corners are too many to list:
the dearest one of each position, by the prices of the present design, is found when it is needed,
and when none is dearer than the design allows, no other spectrum in any position could help.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from oed.design.certificate import efficiency_bound
from oed.design.criteria import Criterion, objective
from oed.design.objective import Objective
from oed.design.relaxed import Design, optimal_design
from oed.information_set import InformationSet
from robotmodels.arrays import Array, IntArray, read_only, real_numbers
from robotmodels.errors import InvalidInput, NotIdentifiable, SolverFailed

_REMEDY = "add positions or lines, or fix or tie some of these parameters"


@dataclass(frozen=True, eq=False)
class LineLimit:
    """A limit on a weighted sum of the lines' powers in each position.

    Attributes
    ----------
    cost : (F,) or (Q, F), what a unit of power of each line takes of it, none negative: ones for
        the total power, half the squared gain to a joint's speed for its mean square.
    most : the limit, for all positions.
    """

    cost: Array
    most: float


@dataclass(frozen=True, eq=False)
class SpectrumDesign:
    """Shares of the experiments and the powers of their lines, certified.

    Attributes
    ----------
    weights : (Q,) shares of the experiments that sum to one.
    power : (Q, F) mean power of each line in an experiment of each position; zero where none is.
    amplitude : (Q, F) of sines with these powers, sqrt(2 power).
    value, gap, information, criterion, names : as of a `Design`; the gap is over all spectra.
    uniform_efficiency : of the best positions with one common flat spectrum scaled to the limits.
    rounds : sets of spectra solved.
    """

    weights: Array
    power: Array
    value: float
    gap: float
    information: Array
    criterion: str
    names: tuple[str, ...]
    uniform_efficiency: float
    rounds: int

    @property
    def amplitude(self) -> Array:
        """Amplitudes of the lines' sines, (Q, F)."""
        return np.sqrt(2.0 * self.power)

    @property
    def efficiency(self) -> float:
        """Certified lower bound on the efficiency against every spectrum in every position."""
        return efficiency_bound(self.gap)


def optimal_spectrum(
    lines: Array,
    names: tuple[str, ...],
    limits: Mapping[str, LineLimit],
    criterion: str | Criterion = "D",
    line_most: float = np.inf,
    tolerance: float = 1e-5,
    max_rounds: int = 200,
) -> SpectrumDesign:
    """Return positions and powers of the lines that maximise the criterion.

    Parameters
    ----------
    lines : (Q, F, p, p), information of each position and line for a unit of power.
    names : p parameter names.
    limits : what holds in every experiment, by name; at least one must count every line.
    criterion : a smooth criterion.
    line_most : largest power of one line.
    tolerance : largest certified gap accepted.
    max_rounds : largest number of sets of spectra.

    Raises
    ------
    InvalidInput : if lines and limits do not fit, a line has no limit, or `max_rounds` is not
        positive.
    NotIdentifiable : naming the parameters, if all lines in all positions leave some open.
    SolverFailed : if the gap stays above the tolerance.
    """
    if max_rounds < 1:
        raise InvalidInput(f"max_rounds: {max_rounds!r}; at least 1 is needed")
    shapes = _Spectra.checked(lines, names, limits, line_most)
    wanted = objective(criterion, names)
    if not wanted.smooth:
        raise InvalidInput(f"criterion {wanted.name} is not smooth: spectra need one that is")
    flat = shapes.flat()
    owners, powers = np.arange(len(flat)), flat
    start = shapes.design(owners, powers, wanted, tolerance)
    design = start
    for done in range(1, max_rounds + 1):
        witness = wanted.witness(design.information)
        prices = np.tensordot(shapes.lines, wanted.price(witness, design.information.shape))
        budget, corners, found = shapes.dearest(prices, 0.1 * tolerance)
        gap = (
            float(
                np.exp(
                    np.log(budget)
                    - wanted.log_polar(witness)
                    - wanted.log_value(design.information)
                )
            )
            - 1.0
        )
        if gap <= tolerance:
            return _answer(shapes, owners, powers, design, start, wanted, gap, done)
        used = design.support
        owners = np.concatenate([owners[used], found])
        powers = np.concatenate([powers[used], corners])
        design = shapes.design(owners, powers, wanted, 0.01 * tolerance)
    raise SolverFailed(
        f"optimal spectrum: the certified gap is {gap:.2g} after {max_rounds} rounds, above the "
        f"tolerance {tolerance:.2g}; allow more rounds or a larger tolerance"
    )


@dataclass(frozen=True, eq=False)
class _Spectra:
    """The polytopes of spectra: costs (Q, R, F), bounds (R,), and the largest power of a line."""

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
    ) -> "_Spectra":
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
            if not (np.isfinite(limit.most) and limit.most > 0):
                raise InvalidInput(f"limits: {name}: most: {limit.most!r} is not a number > 0")
            costs[:, r], bounds[r] = cost, limit.most
        if not line_most > 0:
            raise InvalidInput(f"line_most: {line_most!r} is not a number > 0")
        free = ~(costs > 0).any(axis=1)
        if free.any() and np.isinf(line_most):
            q, line = np.argwhere(free)[0]
            raise InvalidInput(f"limits: none holds for line {line} in position {q}")
        return cls(lines, names, costs, bounds, line_most)

    def flat(self) -> Array:
        """Return each position's flat spectrum, as strong as its limits allow, (Q, F)."""
        sums = self.costs.sum(axis=2)
        with np.errstate(divide="ignore"):
            level = np.minimum((self.bounds / sums).min(axis=1, initial=np.inf), self.line_most)
        return np.repeat(level[:, None], self.lines.shape[1], axis=1)

    def design(
        self, owners: IntArray, powers: Array, wanted: Objective, tolerance: float
    ) -> Design:
        """Return the best shares of experiments with these spectra in these positions."""
        matrices = np.einsum("if,ifab->iab", powers, self.lines[owners])
        info = InformationSet(owners[:, None].astype(float), matrices, self.names)
        try:
            return optimal_design(info, wanted, solver="newton", tolerance=max(tolerance, 1e-8))
        except NotIdentifiable as error:
            raise NotIdentifiable(error.names, _REMEDY) from error

    def dearest(self, prices: Array, slack: float) -> tuple[float, Array, IntArray]:
        """Return the largest price of any spectrum, the dearest spectra, and their positions.

        prices : (Q, F) of a unit of power. Each single limit bounds what a position can cost; a
        linear program is solved only where that leaves a chance of more than one. At most 2p
        spectra that are dearer than one are returned.
        """
        single = [self._single(prices, r) for r in range(len(self.bounds))]
        bounds = np.stack([bound for bound, _ in single])
        lowest = np.argmin(bounds, axis=0)
        value = bounds.min(axis=0)
        spectra = np.stack([s for _, s in single])[lowest, np.arange(len(prices))]
        taken = np.einsum("qrf,qf->qr", self.costs, spectra)
        inside = (taken <= self.bounds * (1 + 1e-12)).all(axis=1)
        dear: list[int] = []
        for q in np.argsort(-value):
            if len(dear) == 2 * len(self.names) or value[q] <= 1 + slack:
                break
            if not inside[q]:
                value[q], spectra[q] = self._program(prices[q], q)
            if value[q] > 1 + slack:
                dear.append(int(q))
        chosen = np.array(dear, dtype=np.int64)
        return float(value.max()), spectra[chosen], chosen

    def _single(self, prices: Array, row: int) -> tuple[Array, Array]:
        """Return the largest prices (Q,) under one limit, and the spectra (Q, F): knapsacks."""
        cost, gain = self.costs[:, row], np.maximum(prices, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(gain > 0, gain / cost, -np.inf)
        order = np.argsort(-ratio, axis=1, kind="stable")
        sorted_cost = np.take_along_axis(cost, order, axis=1)
        with np.errstate(invalid="ignore"):
            wanted = np.where(sorted_cost > 0, sorted_cost * self.line_most, 0.0)
        before = np.zeros_like(wanted)
        before[:, 1:] = np.cumsum(wanted, axis=1)[:, :-1]
        left = np.maximum(self.bounds[row] - before, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            power = np.where(
                sorted_cost > 0, np.minimum(wanted, left) / sorted_cost, self.line_most
            )
        power[np.take_along_axis(gain, order, axis=1) <= 0] = 0.0
        spectra = np.zeros_like(power)
        np.put_along_axis(spectra, order, power, axis=1)
        with np.errstate(invalid="ignore"):
            return np.where(gain > 0, gain * spectra, 0.0).sum(axis=1), spectra

    def _program(self, prices: Array, position: int) -> tuple[float, Array]:
        """Return the dearest spectrum of one position under all limits."""
        top = None if np.isinf(self.line_most) else self.line_most
        found = linprog(
            -prices, A_ub=self.costs[position], b_ub=self.bounds, bounds=[(0.0, top)] * len(prices)
        )
        if found.x is None:
            raise SolverFailed(f"optimal spectrum: HiGHS: {found.message}")
        # The dual value is the bound, whatever the precision of the spectrum.
        y = np.maximum(-found.ineqlin.marginals, 0.0)
        paid = y @ self.costs[position]
        if top is not None:
            return float(y @ self.bounds + top * np.maximum(prices - paid, 0.0).sum()), found.x
        wanted = prices > 0
        stretch = float((prices[wanted] / paid[wanted]).max(initial=1.0))
        return stretch * float(y @ self.bounds), found.x


def _answer(
    spectra: _Spectra,
    owners: IntArray,
    powers: Array,
    design: Design,
    start: Design,
    wanted: Objective,
    gap: float,
    rounds: int,
) -> SpectrumDesign:
    n, f = spectra.lines.shape[:2]
    weights, power = np.zeros(n), np.zeros((n, f))
    np.add.at(weights, owners, design.weights)
    np.add.at(power, owners, design.weights[:, None] * powers)
    used = weights > 0
    power[used] /= weights[used, None]
    return SpectrumDesign(
        weights=read_only(weights),
        power=read_only(power),
        value=design.value,
        gap=gap,
        information=design.information,
        criterion=design.criterion,
        names=spectra.names,
        uniform_efficiency=wanted.efficiency(start.information, design.information),
        rounds=rounds,
    )
