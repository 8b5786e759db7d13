"""Fits from many starts: in parallel, resumable, none lost."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from estimators.fitting.fit_problem import FitProblem
from estimators.fitting.least_squares import Fit, Runs, as_fit, fit_problem
from estimators.fitting.priors import Prior
from estimators.fitting.run_fit import RunFit
from estimators.fitting.search import MINIMISERS, check_effort, search_or_reason
from estimators.fitting.search_checkpoint import SearchStore, problem_fingerprint
from estimators.fitting.trust_region import START_FAILED, STOPPED, Minimiser, SearchResult
from estimators.frf.frf_estimate import FrfEstimate
from robotmodels.common.arrays import Array, IntArray, check_above_zero, check_count
from robotmodels.common.errors import InvalidInput, check_word
from robotmodels.common.progress import Progress
from robotmodels.description.parameters import Parameters
from robotmodels.linear.residuals import ResidualForm
from robotmodels.linear.response import Elastic

# A start, and what an earlier search from there came to.
_Begun = tuple[Array, SearchResult | None]
# Tasks into which the starts are parted: few enough that handing out the problem costs little.
TASKS = 32
# Costs this close, relatively, are one minimum: searches end at changes of 1e-10.
SAME_COST = 1e-8


@dataclass(frozen=True)
class EarlyStop:
    """Rule by which poor searches are stopped early.

    Every start is first searched for `evaluations`. A search that has not ended then, and whose
    cost exceeds `factor` times the least cost of all starts so far, is stopped there: its fit has
    the status -2 and says so in its message. The rule depends on nothing but the starts: neither
    on their order nor on the executor.
    """

    evaluations: int = 40
    factor: float = 100.0

    def __post_init__(self) -> None:
        if self.evaluations < 2 or not (np.isfinite(self.factor) and self.factor > 1):
            raise InvalidInput(
                f"early_stop: evaluations = {self.evaluations}, factor = {self.factor:g}; at least "
                "2 and more than 1 are needed"
            )


def perturbed_starts(
    parameters: Parameters, n: int, decades: float, rng: np.random.Generator
) -> Array:
    """Return (n, p) values multiplied by 10^U(-decades, decades), [WM] section 6."""
    check_count(n, "perturbed_starts: n")
    check_above_zero(decades, "perturbed_starts: decades", zero=True)
    exponents = rng.uniform(-decades, decades, (n, len(parameters)))
    return np.asarray(parameters.values * 10.0**exponents)


@overload
def multistart(
    model: Elastic,
    estimate: FrfEstimate,
    starts: Array | Sequence[Array],
    residual: str | ResidualForm | None = None,
    weights: str | NDArray[Any] | None = None,
    bounds: tuple[float, float] | Array = (1e-3, 1e3),
    max_evaluations: int = 200,
    tolerance: float = 1e-10,
    *,
    executor: Executor | None = None,
    progress: Progress | None = None,
    positions: Sequence[int] | IntArray | None = None,
    prior: Prior | None = None,
    loss: str = "linear",
    early_stop: EarlyStop | None = None,
    store: str | Path | None = None,
    minimiser: str = "trust_region",
) -> tuple[Fit, ...]: ...
@overload
def multistart(
    model: Elastic,
    estimate: Runs,
    starts: Array | Sequence[Array],
    residual: str | ResidualForm | None = None,
    weights: str | NDArray[Any] | None = None,
    bounds: tuple[float, float] | Array = (1e-3, 1e3),
    max_evaluations: int = 200,
    tolerance: float = 1e-10,
    *,
    executor: Executor | None = None,
    progress: Progress | None = None,
    positions: Sequence[int] | IntArray | None = None,
    prior: Prior | None = None,
    loss: str = "linear",
    early_stop: EarlyStop | None = None,
    store: str | Path | None = None,
    minimiser: str = "trust_region",
) -> tuple[RunFit, ...]: ...
def multistart(
    model: Elastic,
    estimate: FrfEstimate | Runs,
    starts: Array | Sequence[Array],
    residual: str | ResidualForm | None = None,
    weights: str | NDArray[Any] | None = None,
    bounds: tuple[float, float] | Array = (1e-3, 1e3),
    max_evaluations: int = 200,
    tolerance: float = 1e-10,
    *,
    executor: Executor | None = None,
    progress: Progress | None = None,
    positions: Sequence[int] | IntArray | None = None,
    prior: Prior | None = None,
    loss: str = "linear",
    early_stop: EarlyStop | None = None,
    store: str | Path | None = None,
    minimiser: str = "trust_region",
) -> tuple[Fit, ...] | tuple[RunFit, ...]:
    """Return the fits from all `starts` (N, p), the least cost first, equal ones as the starts.

    A start at which the model has no FRF gives a fit that is not converged, of infinite cost and
    with the reason as its message. Other arguments as in `fit`.

    Parameters
    ----------
    executor : Executor, optional
        Runs the searches; in sequence where None.
    progress : Progress, optional
        Called with the number of finished searches and their total.
    early_stop : EarlyStop, optional
        Gives up hopeless searches; None pursues all to their end.
    store : str or Path, optional
        HDF5 file that keeps every search as soon as it has ended; with an executor, as soon as its
        share of the starts has. A run that was interrupted, or one with more starts, goes on from
        it.
    minimiser : {"trust_region", "quasi_newton"}
        Gauss-Newton steps in a trust region, damped instead where costs are compiled, or BFGS,
        which uses gradients alone as [WM]'s fminunc does; the tolerance of its gradient is
        relative to 1 + that at the start.

    Raises
    ------
    InvalidInput
        As `fit`; if there is no start; if the store holds searches of something else.
    """
    check_effort(max_evaluations, tolerance)
    check_word("minimiser", minimiser, tuple(MINIMISERS))
    problem = fit_problem(model, estimate, residual, weights, bounds, positions, prior, loss)
    points = [problem.checked_start(np.asarray(start, dtype=float)) for start in starts]
    if not points:
        raise InvalidInput("multistart: no starts were given")
    checkpoint = None
    if store is not None:
        checkpoint = SearchStore(
            Path(store), problem_fingerprint(problem, max_evaluations, tolerance, minimiser)
        )
    runs = _Runs(problem, max_evaluations, tolerance, minimiser, executor, checkpoint)
    outcomes = _all_searched(runs, points, early_stop, progress)
    fits = [as_fit(problem, point, outcomes[i]) for i, point in enumerate(points)]
    order = order_of_costs([one.cost for one in fits])
    return tuple(fits[i] for i in order)  # type: ignore[return-value]  # alike, as the data are


def order_of_costs(costs: Sequence[float] | Array) -> list[int]:
    """Return the order of costs, the least first; those of one minimum in the order given.

    Fits from different starts that end in one minimum differ by what rounding made of them, which
    another processor would make otherwise.
    """
    order: list[int] = []
    alike: list[int] = []
    for i in sorted(range(len(costs)), key=lambda i: costs[i]):
        if alike and costs[i] > costs[alike[0]] * (1 + SAME_COST):
            order += sorted(alike)
            alike = []
        alike.append(i)
    return order + sorted(alike)


def _all_searched(
    runs: "_Runs", points: list[Array], early_stop: EarlyStop | None, progress: Progress | None
) -> dict[int, SearchResult]:
    """Return what the search from each start came to."""
    outcomes: dict[int, SearchResult] = {}

    def finish(i: int, outcome: SearchResult) -> None:
        outcomes[i] = outcome
        if progress is not None:
            progress(len(outcomes), len(points))

    begun: dict[int, SearchResult | None] = dict.fromkeys(range(len(points)))
    stage, limit = "whole", runs.max_evaluations
    if early_stop is not None:
        begun = _begin(runs, points, early_stop, limit, finish)
        stage = f"after {early_stop.evaluations}"
    for i, outcome in runs.searches(stage, points, begun, limit):
        finish(i, outcome)
    return outcomes


@dataclass(frozen=True, eq=False)
class _Runs:
    """Runs searches of one problem, and keeps what has ended."""

    problem: FitProblem
    max_evaluations: int
    tolerance: float
    minimiser: str
    executor: Executor | None
    store: SearchStore | None

    def searches(
        self, stage: str, points: list[Array], begun: dict[int, SearchResult | None], limit: int
    ) -> Iterator[tuple[int, SearchResult]]:
        """Yield the outcomes of the starts `begun`, as they end.

        Parameters
        ----------
        stage : str
            The name under which they are stored.
        points : list of ndarray
            All starts.
        begun : dict of int to SearchResult or None
            Which of them, and what an earlier search from there came to.
        limit : int
            Limit of evaluations, the earlier ones included.
        """
        waiting = {}
        for i, before in begun.items():
            stored = None if self.store is None else self.store.load(stage, points[i])
            if stored is not None:
                yield i, stored
            else:
                waiting[i] = before
        several = partial(
            _search_several,
            self.problem,
            limit=limit,
            tolerance=self.tolerance,
            minimise=MINIMISERS[self.minimiser],
        )
        for i, outcome in self._ran(several, points, waiting):
            if self.store is not None:
                self.store.append(stage, points[i], outcome)
            yield i, outcome

    def _ran(
        self,
        several: Callable[[list[_Begun]], list[SearchResult]],
        points: list[Array],
        waiting: dict[int, SearchResult | None],
    ) -> Iterator[tuple[int, SearchResult]]:
        every = list(waiting)
        if self.executor is None:
            for i in every:
                yield i, several([(points[i], waiting[i])])[0]
            return
        size = max(1, -(-len(every) // TASKS))  # none may be left to do
        shares = [every[k : k + size] for k in range(0, len(every), size)]
        futures = {
            self.executor.submit(several, [(points[i], waiting[i]) for i in share]): share
            for share in shares
        }
        try:
            for future in as_completed(futures):
                yield from zip(futures[future], future.result(), strict=True)
        finally:
            for future in futures:
                future.cancel()


def _begin(
    runs: _Runs,
    points: list[Array],
    rule: EarlyStop,
    max_evaluations: int,
    finish: Callable[[int, SearchResult], None],
) -> dict[int, SearchResult | None]:
    """Search every start for a while; finish what ended or is hopeless, return the others."""
    limit = min(rule.evaluations, max_evaluations)
    everyone: dict[int, SearchResult | None] = dict.fromkeys(range(len(points)))
    first = dict(runs.searches(f"first {limit}", points, everyone, limit))
    least = min(outcome.cost for outcome in first.values())
    unfinished: dict[int, SearchResult | None] = {}
    for i, outcome in sorted(first.items()):
        if outcome.status != 0 or limit == max_evaluations:
            finish(i, outcome)
        elif outcome.cost > rule.factor * least:
            message = (
                f"stopped early: cost {outcome.cost:.4g} after {outcome.evaluations} evaluations "
                f"is more than {rule.factor:g} times the least of all starts, {least:.4g}"
            )
            finish(i, replace(outcome, status=STOPPED, message=message))
        else:
            unfinished[i] = outcome
    return unfinished


def _search_several(
    problem: FitProblem,
    begun: list[_Begun],
    *,
    limit: int,
    tolerance: float,
    minimise: Minimiser,
) -> list[SearchResult]:
    """Search from starts, or from where earlier searches ended."""
    outcomes = []
    for start, before in begun:
        if before is None:
            outcomes.append(search_or_reason(problem, start, limit, tolerance, minimise))
            continue
        remaining = limit - before.evaluations
        after = search_or_reason(problem, before.values, remaining, tolerance, minimise)
        if after.status == START_FAILED:
            outcomes.append(replace(before, message=f"not pursued: {after.message}"))
        else:
            spent = before.evaluations + after.evaluations
            outcomes.append(replace(after, evaluations=spent))
    return outcomes
