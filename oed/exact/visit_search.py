"""The search for whole visits: periods of pairs of a position and an excitation within a time."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from oed.criteria.objective import Objective, samples
from oed.exact.gain_bounds import group_log_values, log_values
from oed.information_sets.candidates import sensitivities
from oed.information_sets.experiment_candidates import ExperimentCandidates
from robotmodels.common.arrays import Array, IntArray

_POOL = 4  # pairs for each parameter, beside those that the relaxed design uses
_RIDGE = 1e-9  # of the relaxed information, so that every plan has a finite value
_FIRST, _BATCH = 6, 24  # additions that are evaluated together
_IMPROVED = 1e-9


@dataclass(frozen=True, eq=False)
class VisitSearch:
    """Promising pairs of a position and an excitation, and what their periods cost.

    Attributes
    ----------
    objective : Objective
        What is maximised.
    pairs : ndarray of int, (k,)
        Indices of the pairs, positions inside.
    matrices : ndarray, (k, p, p) or (k, K, p, p)
        Information of one period.
    setup, period : ndarray, (k,), s
        Time of a visit without periods, and of one period of all its runs.
    most : int
        Periods of a visit.
    base : ndarray
        Prior information, of the shape of one pair's.
    ridge : ndarray
        A little information that keeps values finite.
    start : ndarray of int, (k,)
        Periods of the relaxed design, rounded down.
    """

    objective: Objective
    pairs: IntArray
    matrices: Array
    setup: Array
    period: Array
    most: int
    base: Array
    ridge: Array
    start: IntArray

    @classmethod
    def of(
        cls,
        candidates: ExperimentCandidates,
        objective: Objective,
        prior: Array | None,
        weights: Array,
        derivatives: Array,
    ) -> "VisitSearch":
        """Return the search about a relaxed design, of these weights and derivatives (Q,)."""
        info, counts = candidates.information, candidates.periods
        n, size = len(counts), len(candidates) // len(counts)
        relaxed = np.array(counts) @ weights.reshape(n, size)
        worth = (derivatives / candidates.duration).reshape(n, size).max(axis=0)
        number = min(size, _POOL * len(info.names))
        pairs = np.union1d(np.argpartition(-worth, number - 1)[:number], np.flatnonzero(relaxed))
        matrices = info.take(pairs) / counts[0]
        excitation = pairs // len(candidates.positions)
        _, setup, period = candidates.run_times
        total = info.combined(weights)
        base = np.zeros_like(total) if prior is None else prior
        return cls(
            objective=objective,
            pairs=pairs,
            matrices=matrices,
            setup=setup[excitation],
            period=period[excitation],
            most=max(counts),
            base=base,
            ridge=_RIDGE * (base + total),
            start=np.floor(relaxed[pairs] + 1e-9).astype(np.int64),
        )

    @property
    def nothing(self) -> IntArray:
        """No visit at all, (k,)."""
        return np.zeros(len(self.pairs), dtype=np.int64)

    def information(self, periods: IntArray) -> Array:
        """Return the prior's and the visits' information."""
        return np.asarray(self.base + np.tensordot(periods.astype(float), self.matrices, axes=1))

    def value(self, periods: IntArray) -> float:
        """Return the log value, without the ridge."""
        return float(log_values(self.objective, self.information(periods)[None])[0])

    def cost(self, periods: IntArray) -> float:
        """Return the time of the visits [s]."""
        return float(self._costs(periods).sum())

    def best(self, time: float, enough: float = np.inf) -> IntArray:
        """Return the best plan within a time that additions and removals lead to.

        The first one of a log value that is `enough` will do.
        """
        start, plans = self.start.copy(), []
        while self.cost(start) > time:
            start[np.flatnonzero(start)[np.argmin(start[start > 0])]] = 0
        for one in (start, self.nothing):
            plans.append(self._improved(self._filled(one, time), time, enough))
            if self.value(plans[-1]) >= enough:
                break
        return max(plans, key=self._ridged_value)

    def shortened(self, periods: IntArray) -> IntArray:
        """Return fewer periods of a log value that is not negative still, by the time they save."""
        periods = periods.copy()
        while True:
            options = [
                (self._costs(periods)[i] - self._costs(fewer)[i], fewer)
                for i in np.flatnonzero(periods)
                for fewer in self._less(periods, int(i))
            ]
            options = [one for one in options if self.value(one[1]) >= 0]
            if not options:
                return periods
            periods = max(options, key=lambda one: one[0])[1]

    def _less(self, periods: IntArray, i: int) -> list[IntArray]:
        """Return plans with one period less of a pair, and with none."""
        plans = []
        for count in {int(periods[i]) - 1, 0}:
            plans.append(periods.copy())
            plans[-1][i] = count
        return plans

    def _improved(self, periods: IntArray, time: float, enough: float) -> IntArray:
        """Return a plan that no removal of a pair, its time used otherwise, improves, or enough."""
        value, improved = self._ridged_value(periods), self.value(periods) < enough
        while improved:
            improved = False
            for i in np.flatnonzero(periods):
                fewer = periods.copy()
                fewer[i] = 0
                other = self._filled(fewer, time)
                new = self._ridged_value(other)
                if new > value + _IMPROVED:
                    periods, value, improved = other, new, True
                    if self.value(periods) >= enough:
                        return periods
        return periods

    def _filled(self, periods: IntArray, time: float) -> IntArray:
        """Return a plan with periods added, by what they gain a second, until none fits."""
        periods = periods.copy()
        while True:
            pair, count = self._best_addition(periods, time - self.cost(periods))
            if not count:
                return periods
            periods[pair] += count

    def _best_addition(self, periods: IntArray, room: float) -> tuple[int, int]:
        """Return the pair and the number of periods that gain most a second; zero if none fits."""
        pair, count, extra = self._additions(periods, room)
        information = self.information(periods) + self.ridge
        value, slopes = self._tangent(information)
        ceilings = count * slopes[pair] / extra
        order, best, choice = np.argsort(-ceilings, kind="stable"), 0.0, (0, 0)
        starts = (0, *range(_FIRST, len(order), _BATCH))
        for start, end in pairwise((*starts, len(order))):
            batch = order[start:end]
            if not len(batch) or ceilings[batch[0]] <= best:
                break
            factors = count[batch].reshape(-1, *(1,) * information.ndim)
            stack = information + factors * self.matrices[pair[batch]]
            rates = (log_values(self.objective, stack) - value) / extra[batch]
            k = int(np.argmax(rates))
            if rates[k] > best:
                best, choice = float(rates[k]), (int(pair[batch[k]]), int(count[batch[k]]))
        return choice

    def _additions(self, periods: IntArray, room: float) -> tuple[IntArray, IntArray, Array]:
        """Return pairs, numbers of periods and times of the additions for which there is room."""
        steps = 2 ** np.arange(int(np.log2(self.most)) + 1)
        count = np.repeat(steps, len(self.pairs))
        pair = np.tile(np.arange(len(self.pairs)), len(steps))
        extra = self._costs(periods[pair] + count, pair) - self._costs(periods[pair], pair)
        fits = extra <= room * (1 + 1e-12)
        return pair[fits], count[fits], extra[fits]

    def _tangent(self, information: Array) -> tuple[float, Array]:
        """Return the log value and its derivative by the periods of each pair, (k,)."""
        groups = group_log_values(self.objective, information[None])[0]
        weight, stack = np.zeros(information.shape), samples(information)
        for term in self.objective.groups[int(np.argmin(groups))]:
            W = term.share * term.mean.log_gradient(stack[term.sample])
            weight.reshape(-1, *W.shape)[term.sample] += W
        return float(groups.min()), sensitivities(weight, self.matrices)

    def _costs(self, periods: IntArray, pair: IntArray | None = None) -> Array:
        """Return the time of periods of some pairs, each by itself [s]."""
        which = slice(None) if pair is None else pair
        visits = -(-periods // self.most)
        return np.asarray(visits * self.setup[which] + periods * self.period[which])

    def _ridged_value(self, periods: IntArray) -> float:
        information = self.information(periods) + self.ridge
        return float(log_values(self.objective, information[None])[0])
