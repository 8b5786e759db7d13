"""The least time in which standard deviations that are asked for can be reached.

The time T of a design over visits of durations t_c is the least for which M_0 + sum_c w_c H_c has
value one by `TargetCriterion`. Its relaxation is convex, and any W_i >= 0, here those of the design
at a time T_0, bounds it from below: at value one

    c <= tr(W M_0) + sum_c w_c tr(W H_c) <= tr(W M_0) + T max_c tr(W H_c) / t_c

with W = sum_i W_i and c from `Objective.log_polar`. For W_i = mu_i x_i x_i' that is
T >= sum_i mu_i (2 x_ii - s_i^2 - x_i' M_0 x_i) / max_c sum_i mu_i x_i' H_c x_i / t_c at its best x.
"""

from dataclasses import dataclass, replace
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from oed.criteria.targets import TargetCriterion, Targets, by_name_or_kind
from oed.design.constraints import Constraints
from oed.design.design import SHOWN, Design
from oed.design.optimal_design import checked_prior, optimal_design
from oed.design.problem import DesignSolver
from oed.information_sets.candidates import Candidates, check_candidates
from robotmodels.common.arrays import Array, IntArray, read_only
from robotmodels.common.errors import NotIdentifiable, SolverFailed
from robotmodels.common.printing import ReprHtml

_MOST_ROUNDS = 30
_EVER = 1e15  # of each candidate [s]
# Of budgets far from the least time designs need not be precise: this part of the gap so far.
_SHARPER = 0.03
# Weights below these shares of the largest are tried without, the last one with all of them.
_SHARES = (1e-3, 1e-4, 1e-5, 0.0)


@dataclass(frozen=True, eq=False)
class FastestDesign(ReprHtml):
    """Visits that reach every target in the least time, not yet whole ones, certified.

    Attributes
    ----------
    time : float, s
        Time of all visits.
    bound : float, s
        No visits of these candidates reach the targets in less.
    weights : ndarray, (Q,)
        Visits of each candidate.
    support : ndarray of int
        Candidates with visits.
    information : ndarray, (p, p), or (K, p, p)
        Information with the prior's.
    names : tuple of str
        p parameter names.
    witness : tuple of ndarray
        Matrices W_i behind the bound.
    """

    time: float
    bound: float
    weights: Array
    support: IntArray
    information: Array
    names: tuple[str, ...]
    witness: tuple[Array, ...]

    @property
    def gap(self) -> float:
        """How much longer this takes than any other, at most, relative."""
        return self.time / self.bound - 1.0 if self.bound > 0 else 0.0

    def __str__(self) -> str:
        shares = ", ".join(f"{self.weights[i]:.3g} of {i}" for i in self.support[:SHOWN])
        more = len(self.support) - SHOWN
        return (
            f"targets reached in {self.time / 60:.3g} min, no visits do in less than "
            f"{self.bound / 60:.3g}: {shares}{f' and {more} more' if more > 0 else ''}"
        )


def fastest_design(
    info: Candidates,
    duration: ArrayLike,
    targets: Targets,
    prior: Array | None = None,
    tolerance: float = 1e-6,
    solver: str | DesignSolver = "newton",
) -> FastestDesign:
    """Return the visits that reach targets in the least time.

    At wrong guesses of the parameters such a design may take longer than one for D: first D or a
    prior, targets after a fit.

    Parameters
    ----------
    info : Candidates
        Information of each visit, such as that of `ExperimentCandidates`.
    duration : float or array_like, (Q,), s
        Duration of each visit.
    targets : float, mapping of str to float or TargetCriterion
        Standard deviations asked for, as of `TargetCriterion`.
    prior : ndarray, (p, p), optional
        Information there is already.
    tolerance : float
        Largest gap between the time and its bound.
    solver : str or DesignSolver
        As of `optimal_design`.

    Raises
    ------
    InvalidInput
        If durations, targets or prior do not fit.
    NotIdentifiable
        Naming the parameters, if all candidates together leave a target open, however long.
    SolverFailed
        If the gap stays above the tolerance.
    """
    check_candidates(info)
    problem = _Problem(info, targets, checked_prior(prior, info), duration)
    objective, before = problem.objective, problem.prior
    if before is not None and objective.log_value(before) >= 0:
        return problem.design(np.zeros(len(info)), _Bound(0.0, objective.witness(before)))
    problem.check_reachable()
    bound, budget = _Bound(), float(np.median(problem.costs)) * len(info.names)
    weights, accuracy, last = np.full(len(info), np.inf), _SHARPER, 0.3 * tolerance
    for _ in range(_MOST_ROUNDS):
        limits = Constraints(time=budget, durations=duration)
        design = optimal_design(info, objective, limits, before, accuracy, solver=solver)
        bound = max(bound, problem.bound(design, budget), key=attrgetter("time"))
        for share in _SHARES:
            fewer = problem.stretched(_without_small(design.weights, share))
            weights = min(weights, fewer, key=problem.costs.dot)
            if problem.costs @ weights <= (1 + tolerance) * bound.time:
                return problem.design(weights, bound)
        budget = float(problem.costs @ weights)
        accuracy = max(
            min(accuracy, _SHARPER * (budget / max(bound.time, 1e-9 * budget) - 1.0)), last
        )
    raise SolverFailed(
        f"fastest design: {problem.costs @ weights:.6g} s, and no less than {bound.time:.6g} s are "
        f"needed; allow a larger tolerance than {tolerance:.1g}"
    )


def _without_small(weights: Array, share: float) -> Array:
    """Return weights without those up to a share of the largest."""
    return np.where(weights > share * weights.max(), weights, 0.0)


class _Bound(NamedTuple):
    """A time that no design goes below, and the matrices W_i that show it."""

    time: float = 0.0
    witness: tuple[Array, ...] = ()


class _Problem:
    """Candidates, what each costs, and the value that must be one."""

    def __init__(
        self,
        info: Candidates,
        targets: Targets,
        prior: Array | None,
        duration: ArrayLike,
    ) -> None:
        self.info, self.targets, self.prior = info, TargetCriterion.of(targets), prior
        self.objective = self.targets.objective(info.names, info.samples)
        self.costs = Constraints(time=1.0, durations=duration).polytope(len(info)).rows[0]

    def information(self, weights: Array) -> Array:
        """Return the prior and sum_c w_c H_c."""
        total = self.info.combined(weights)
        return total if self.prior is None else total + self.prior

    def check_reachable(self) -> None:
        """Refuse targets of what the prior tells alone: no time adds to that."""
        if self.prior is None:
            return  # the design names what candidates leave open
        targets = by_name_or_kind(self.targets.deviations, self.info.names, "targets")
        total, missed = self.information(_EVER / self.costs), []
        for name, target in zip(self.info.names, targets, strict=True):
            if np.isnan(target):
                continue
            single = replace(self.targets, deviations={name: target})
            alone = single.objective(self.info.names, self.info.samples)
            if (short := alone.log_value(total)) < 0:
                least = target * float(np.exp(-short / 2))
                missed.append(f"{name} (not below {least:.3g}, {target:.3g} asked for)")
        if missed:
            remedy = "no time suffices; relax the targets, add candidates, or fix these parameters"
            raise NotIdentifiable(missed, remedy)

    def bound(self, design: Design, budget: float) -> _Bound:
        """Return the bound that a design within a budget gives on the time of any other."""
        shape = design.information.shape
        weight = self.objective.summed_by_sample(design.witness, shape)
        prior = 0.0 if self.prior is None else float(np.vdot(weight, self.prior))
        rate = float((design.sensitivity / self.costs).max())
        log_bound = self.objective.log_value(design.information) + np.log1p(design.gap)
        polar = (prior + budget * rate) / float(np.exp(log_bound))
        return _Bound(max((polar - prior) / rate, 0.0), design.witness)

    def stretched(self, weights: Array) -> Array:
        """Return the multiple of weights that reaches every target, the last one exactly."""
        added = self.info.combined(weights)
        base = np.zeros_like(added) if self.prior is None else self.prior

        def excess(log_factor: float) -> float:
            return self.objective.log_value(base + float(np.exp(log_factor)) * added)

        low, high = -1.0, 1.0
        while excess(low) > 0:
            low *= 2.0
        while excess(high) < 0:
            high *= 2.0
        factor = float(brentq(excess, low, high, xtol=1e-13))
        while excess(factor) < 0:
            factor += 1e-12
        return np.asarray(weights * np.exp(factor))

    def design(self, weights: Array, bound: _Bound) -> FastestDesign:
        """Return the result for weights."""
        return FastestDesign(
            time=float(self.costs @ weights),
            bound=bound.time,
            weights=read_only(weights),
            support=read_only(np.flatnonzero(weights)),
            information=read_only(self.information(weights)),
            names=self.info.names,
            witness=bound.witness,
        )
