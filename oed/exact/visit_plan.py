"""Whole visits within minutes, or to stated standard deviations, with a bound on all of them.

A visit is a position, an excitation and a whole number of periods up to the most that the
candidates have; each pays its move, settling and transients. Visits are added by what they gain a
second, and taken out again where others make better use of their time.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from oed.criteria.criteria import Criterion
from oed.criteria.objective import Objective
from oed.criteria.robust_criteria import robust_objective
from oed.criteria.targets import TargetCriterion, Targets
from oed.design.constraints import Constraints
from oed.design.design import Design
from oed.design.fastest_design import FastestDesign, fastest_design
from oed.design.optimal_design import checked_prior, optimal_design
from oed.exact.plan_score import standard_deviations
from oed.exact.visit_bound import VisitBound
from oed.exact.visit_search import VisitSearch
from oed.information_sets.experiment_candidates import ExperimentCandidates
from robotmodels.common.arrays import Array, IntArray, check_above_zero, check_kind, read_only
from robotmodels.common.errors import InvalidInput
from robotmodels.common.printing import ReprHtml

_WIDER, _MOST_WIDER = 1.1, 40
_HALVINGS = 3
_RELAXED_GAP = 1e-4
"""Of the relaxation: whole periods cost far more."""


@dataclass(frozen=True, eq=False)
class VisitPlan(ReprHtml):
    """Whole visits, with a bound that no other visits of these candidates exceed.

    Attributes
    ----------
    candidates : ExperimentCandidates
        Visits that could be made.
    periods : ndarray of int, (E Q,)
        Measured periods of each excitation in each position, positions inside.
    duration : float, s
        Time of all visits, moves included.
    efficiency : float
        Lower bound on the efficiency against all whole visits within the time; of a plan to targets
        on the share of the time that is needed at least.
    value : float
        log value of the criterion.
    std : ndarray, (p,)
        Predicted standard deviations, relative ones where parameters are ln theta; of the first
        sample of theta where there are several.
    information : ndarray, (p, p), or (K, p, p)
        Information with the prior's.
    """

    candidates: ExperimentCandidates
    periods: IntArray
    duration: float
    efficiency: float
    value: float
    std: Array
    information: Array

    @property
    def shared_moves(self) -> float:
        """Time of moves that are not needed, visits in one position made in a row [s]."""
        positions = [position for position, _, _ in self.visits]
        return (len(positions) - len(set(positions))) * self.candidates.timing.move

    @property
    def visits(self) -> list[tuple[int, str, int]]:
        """Position, excitation and periods of each visit, by position.

        More periods than the most are shared by visits.
        """
        most, count = max(self.candidates.periods), len(self.candidates.positions)
        visits = []
        for pair in np.flatnonzero(self.periods):
            excitation = self.candidates.excitations[int(pair) // count].name
            parts = -(-int(self.periods[pair]) // most)
            for part in np.array_split(np.ones(self.periods[pair]), parts):
                visits.append((int(pair) % count, excitation, len(part)))
        return sorted(visits, key=itemgetter(0))

    def __str__(self) -> str:
        lines = [
            f"{len(self.visits)} visits in {self.duration / 60:.3g} min, efficiency >= "
            f"{self.efficiency:.3f}, largest standard deviation {self.std.max():.3g}"
        ]
        if self.shared_moves > 0:
            lines[0] += f"; {self.shared_moves:.3g} s less where visits share a position"
        for (position, excitation, periods), times in Counter(self.visits).items():
            often = f", {times} times" if times > 1 else ""
            lines.append(f"  position {position}: {excitation}, {periods} periods{often}")
        return "\n".join(lines)


@dataclass(frozen=True, eq=False)
class TimeCurve(ReprHtml):
    """Plans of growing time, each with its bound.

    Attributes
    ----------
    times : ndarray, (T,), s
        Budgets.
    plans : tuple of VisitPlan
        One for each.
    """

    times: Array
    plans: tuple[VisitPlan, ...]

    @property
    def std(self) -> Array:
        """Predicted standard deviations, (T, p)."""
        return np.array([plan.std for plan in self.plans])

    def __str__(self) -> str:
        return "\n".join(
            f"{time / 60:.3g} min: {len(plan.visits)} visits, largest standard deviation "
            f"{plan.std.max():.3g}, efficiency >= {plan.efficiency:.3f}"
            for time, plan in zip(self.times, self.plans, strict=True)
        )


def visit_plan(
    candidates: ExperimentCandidates,
    time: float,
    criterion: str | Criterion = "D",
    prior: Array | None = None,
    kind: str = "average",
) -> VisitPlan:
    """Return visits within a time that inform most.

    Parameters
    ----------
    candidates : ExperimentCandidates
        Visits that could be made.
    time : float, s
        Time of all visits, moves included.
    criterion : str or Criterion
        What is maximised, as in `optimal_design`.
    prior : ndarray, (p, p), optional
        Information there is already.
    kind : {"average", "maximin"}
        How samples of theta count, see `robust_design`.

    Raises
    ------
    InvalidInput
        If the time is shorter than every visit, naming the shortest.
    NotIdentifiable
        Naming the parameters, if all candidates together leave open what the criterion asks for.
    """
    check_kind(candidates, ExperimentCandidates, "visit_plan: candidates")
    _check_time(candidates, time)
    info = candidates.information
    before = checked_prior(prior, info)
    limits = Constraints(time=time, durations=candidates.duration)

    def best(one: Objective) -> Design:
        return optimal_design(info, one, limits, before)

    def best_value(one: Objective) -> float:
        return one.log_value(best(one).information)

    objective = robust_objective(criterion, info.names, info.samples, kind, best_value)
    relaxed = best(objective)
    search, whole = _whole(candidates, objective, before, relaxed)
    periods = search.best(time)
    reached = objective.log_value(relaxed.information) + np.log1p(relaxed.gap)
    bound = min(reached, whole.log_value(time))
    return _plan(candidates, search, periods, float(np.exp(search.value(periods) - bound)))


def fastest_visit_plan(
    candidates: ExperimentCandidates,
    targets: Targets,
    prior: Array | None = None,
    relaxed: FastestDesign | None = None,
) -> VisitPlan:
    """Return whole visits that reach targets, in a time near the least.

    Parameters
    ----------
    candidates : ExperimentCandidates
        Visits that could be made.
    targets : float, mapping of str to float or TargetCriterion
        Standard deviations asked for, as of `TargetCriterion`.
    prior : ndarray, (p, p), optional
        Information there is already.
    relaxed : FastestDesign, optional
        That of these candidates and targets, where there is one already.

    Raises
    ------
    InvalidInput, NotIdentifiable
        As `fastest_design`.
    """
    check_kind(candidates, ExperimentCandidates, "fastest_visit_plan: candidates")
    info = candidates.information
    objective = TargetCriterion.of(targets).objective(info.names, info.samples)
    before = checked_prior(prior, info)
    relaxed = relaxed or fastest_design(info, candidates.duration, targets, before, _RELAXED_GAP)
    search, whole = _whole(candidates, objective, before, relaxed)
    if relaxed.time == 0:
        return _plan(candidates, search, search.nothing, 1.0)
    bound = max(relaxed.bound, whole.least_time())
    first = max(bound, relaxed.time, float(candidates.duration.min()))
    periods = _reaching(search, bound, first)
    return _plan(candidates, search, periods, bound / search.cost(periods))


def time_curve(
    candidates: ExperimentCandidates,
    times: Sequence[float],
    criterion: str | Criterion = "D",
    prior: Array | None = None,
    kind: str = "average",
) -> TimeCurve:
    """Return the best plans of several times, for the trade-off of minutes against accuracy.

    Parameters
    ----------
    candidates : ExperimentCandidates
        As of `visit_plan`.
    times : sequence of float, s
        Times of all visits of a plan.
    criterion : str or Criterion
        As of `visit_plan`; a `TargetCriterion` for the accuracy asked for.
    prior : ndarray, optional
        As of `visit_plan`.
    kind : str
        As of `visit_plan`.

    Raises
    ------
    InvalidInput, NotIdentifiable
        As `visit_plan`.
    """
    plans = tuple(visit_plan(candidates, time, criterion, prior, kind) for time in times)
    if not plans:
        raise InvalidInput("times: none given; at least one is needed")
    return TimeCurve(read_only(np.array(times, dtype=float)), plans)


def _check_time(candidates: ExperimentCandidates, time: float) -> None:
    """Refuse a time in which no visit fits."""
    check_above_zero(time, "time [s]")
    shortest = int(np.argmin(candidates.duration))
    if time < candidates.duration[shortest]:
        position, excitation, count = candidates.visit(shortest)
        raise InvalidInput(
            f"time: {time:g} s is less than the shortest visit, {candidates.duration[shortest]:g} "
            f"s ({excitation.name}, {count} periods in position {position})"
        )


def _whole(
    candidates: ExperimentCandidates,
    objective: Objective,
    prior: Array | None,
    relaxed: Design | FastestDesign,
) -> tuple[VisitSearch, VisitBound]:
    """Return the search for whole visits about a relaxed design, and the bound by its witness."""
    weight = objective.summed_by_sample(relaxed.witness, relaxed.information.shape)
    derivatives = candidates.information.directional_derivatives(weight)
    search = VisitSearch.of(candidates, objective, prior, relaxed.weights, derivatives)
    before = 0.0 if prior is None else float(np.vdot(weight, prior))
    log_polar = objective.log_polar(relaxed.witness)
    return search, VisitBound.of(candidates, derivatives, before, log_polar)


def _reaching(search: VisitSearch, low: float, high: float) -> IntArray:
    """Return periods of value one, of the least time between two times, or later if need be."""
    periods = search.best(high)
    for _ in range(_MOST_WIDER):
        if search.value(periods) >= 0:
            break
        low, high = high, _WIDER * high
        periods = search.best(high)
    periods = search.shortened(periods)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + search.cost(periods))
        attempt = search.best(middle, enough=0.0)
        if search.value(attempt) >= 0:
            periods = search.shortened(attempt)
        else:
            low = middle
    return periods


def _plan(
    candidates: ExperimentCandidates, search: VisitSearch, periods: IntArray, efficiency: float
) -> VisitPlan:
    """Return the result for periods of the pool."""
    total = np.zeros(len(candidates.excitations) * len(candidates.positions), dtype=np.int64)
    total[search.pairs] = periods
    information = search.information(periods)
    return VisitPlan(
        candidates=candidates,
        periods=read_only(total),
        duration=search.cost(periods),
        efficiency=min(1.0, efficiency),
        value=search.objective.log_value(information),
        std=read_only(standard_deviations(information)),
        information=read_only(information),
    )
