"""What no whole visits exceed: each pays its move, settling and transients, and whole periods.

For any W_j, with c from `Objective.log_polar`, W their sum and M_0 the prior,

    c value(M) <= tr(W M) = tr(W M_0) + sum_i n_i tr(W H_i)

with n_i periods of pair i of a position and an excitation. Of pairs that take the same times only
the largest tr(W H_i) counts, so that an integer program of few variables bounds the right side
within a time, or the time for a value: v visits and n <= m v periods of each kind of pair. The
relaxed design, whose W is taken, has the same bound without "whole".
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import LinearConstraint, milp

from oed.information_sets.experiment_candidates import ExperimentCandidates
from robotmodels.common.arrays import Array

_GAP = 1e-6
"""Of the integer programs, and what their bounds may be off by the solver's tolerances."""


@dataclass(frozen=True, eq=False)
class VisitBound:
    """Kinds of pairs, by their times, at one W.

    Attributes
    ----------
    gains : ndarray, (k,)
        Largest tr(W H) of a period.
    setup, period : ndarray, (k,), s
        Time of a visit without periods, and of one period of all its runs.
    most : int
        Periods of a visit.
    before : float
        tr(W M_0).
    log_polar : float
        log c.
    """

    gains: Array
    setup: Array
    period: Array
    most: int
    before: float
    log_polar: float

    @classmethod
    def of(
        cls,
        candidates: ExperimentCandidates,
        derivatives: Array,
        before: float,
        log_polar: float,
    ) -> "VisitBound":
        """Return the bound by tr(W H_i) of all candidates (Q,), tr(W M_0) and log c."""
        runs, setup, period = candidates.run_times
        each = derivatives[: len(runs) * len(candidates.positions)] / candidates.periods[0]
        kinds, first, kind = np.unique(runs, return_index=True, return_inverse=True)
        gains = np.zeros(len(kinds))
        np.maximum.at(gains, kind, each.reshape(len(runs), -1).max(axis=1))
        most = max(candidates.periods)
        return cls(gains, setup[first], period[first], most, before, log_polar)

    def log_value(self, time: float) -> float:
        """Return the largest log value within a time [s]."""
        scale = float(self.gains.max()) or 1.0
        gains = np.concatenate([0 * self.gains, self.gains]) / scale
        most = -scale * self._least(-gains, -self._times / time, -1.0)
        return float(np.log(self.before + most) - self.log_polar)

    def least_time(self) -> float:
        """Return the least time for a log value of zero [s]."""
        missing = float(np.exp(self.log_polar)) - self.before
        gains = np.concatenate([0 * self.gains, self.gains])
        return self._least(self._times, gains / missing, 1.0) if missing > 0 else 0.0

    @property
    def _times(self) -> Array:
        return np.concatenate([self.setup, self.period])

    def _least(self, costs: Array, row: Array, least: float) -> float:
        """Return a bound on the costs of visits and periods (2 k,) with row x >= least."""
        one = np.eye(len(self.gains))
        shared = LinearConstraint(np.concatenate([self.most * one, -one], axis=1), 0.0)
        limits = [LinearConstraint(row, least), shared]
        options = {"mip_rel_gap": _GAP}
        answer = milp(costs, integrality=np.ones(len(costs)), constraints=limits, options=options)
        if answer.mip_dual_bound is None:
            return -np.inf
        return float(answer.mip_dual_bound - _GAP * abs(answer.mip_dual_bound))
