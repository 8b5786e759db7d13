"""Monte Carlo comparison of plans: predicted against simulated efficiencies."""

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimators.uncertainty.covariance import Uncertainty
from estimators.validation.monte_carlo import MonteCarlo, monte_carlo
from estimators.validation.simulated_experiment import FrfExperiment
from oed.criteria.criteria import Criterion, objective_of
from oed.information_sets.candidates import Candidates, check_candidates
from oed.information_sets.null_space import unidentifiable
from oed.plan_comparison.plan_comparison import (
    LEVEL,
    PlanComparison,
    PredictedPlan,
    SimulatedPlan,
    UnidentifiedPlan,
    ratio_interval,
)
from robotmodels.common.arrays import Array, IntArray, read_only
from robotmodels.common.errors import InvalidInput, NotIdentifiable, SolverFailed
from robotmodels.common.progress import Progress
from robotmodels.common.symmetric_matrices import scaled_inverse
from robotmodels.linear.derived_models import with_fixed_equilibria
from robotmodels.linear.noise import NoiseLaw
from robotmodels.linear.response import Elastic

_SPARE = 3
"""Experiments beyond the number of parameters, so that a covariance has an inverse."""


def compare_plans(
    model: Elastic,
    info: Candidates,
    positions: Array,
    plans: Mapping[str, IntArray],
    omega: Array,
    noise: NoiseLaw,
    *,
    rng: np.random.Generator,
    runs: int | None = None,
    criterion: str | Criterion = "D",
    executor: Executor | None = None,
    progress: Progress | None = None,
    store: str | Path | None = None,
) -> PlanComparison:
    """Return the efficiencies of plans against the first one, predicted and simulated.

    FRFs of the model, with errors by the noise law, are fitted from the true values by least
    squares with the noise's weights (NLS), `runs` times for each plan.

    Parameters
    ----------
    model : Elastic
        The true one, which is also fitted.
    info : Candidates
        Information of each candidate, at the model's values.
    positions : ndarray, (Q, n)
        Positions of the candidates.
    plans : mapping of str to ndarray of int
        Experiments (Q,) in each candidate, by name; the first plan is compared with the others.
    omega : ndarray
        As in `oed.information`, of one experiment.
    noise : NoiseLaw
        As in `oed.information`, of one experiment.
    rng : Generator
        Source of all errors.
    runs : int, optional
        Experiments simulated for each plan; the larger of 100 and 2 p where None.
    criterion : str or Criterion
        Criterion by which plans are compared.
    executor : Executor, optional
        Takes shares of the runs; in sequence where None.
    progress : Progress, optional
        Called with the runs done and their number.
    store : str or Path, optional
        Folder that keeps finished runs; an interrupted comparison goes on from it.

    Raises
    ------
    InvalidInput
        If there are too few runs for p parameters, or a plan does not fit.
    NotIdentifiable
        If the first plan leaves parameters open.
    SolverFailed
        If too few experiments of a plan can be fitted, naming it.
    """
    check_candidates(info)
    runs = checked_runs(runs, len(info.names))
    series = _Series(model, positions, omega, noise, runs, executor)
    first, *others = [_planned(info, name, counts) for name, counts in plans.items()]
    if isinstance(first, UnidentifiedPlan):
        raise NotIdentifiable(first.unidentified, f"{first.name}: measure elsewhere too")
    generators, total = rng.spawn(len(plans)), runs * sum(map(_is_simulated, (first, *others)))
    fixed: list[bool] = []

    def simulate(k: int, plan: PredictedPlan) -> SimulatedPlan:
        report = None if progress is None else _Shifted(progress, len(fixed) * runs, total)
        file = None if store is None else Path(store) / f"plan_{k:02d}.h5"
        simulation, fixed_equilibria = series.run(plan, generators[k], report, file)
        fixed.append(fixed_equilibria)
        return SimulatedPlan(
            plan.name, plan.support, plan.repetitions, plan.information, plan.predicted, simulation
        )

    optimal = simulate(0, first)
    alternatives = tuple(
        plan if isinstance(plan, UnidentifiedPlan) else simulate(k, plan)
        for k, plan in enumerate(others, start=1)
    )
    return _compared(criterion, optimal, alternatives, all(fixed))


def _is_simulated(plan: PredictedPlan | UnidentifiedPlan) -> bool:
    return isinstance(plan, PredictedPlan)


def checked_runs(runs: int | None, p: int) -> int:
    """Return how many experiments to simulate by each plan for p parameters.

    Raises
    ------
    InvalidInput
        If they are too few for a covariance.
    """
    if runs is None:
        return max(100, 2 * p)
    least = p + _SPARE
    if runs < least:
        raise InvalidInput(f"runs: {runs}; at least {least} are needed for {p} parameters")
    return runs


@dataclass(frozen=True)
class _Shifted:
    """Progress of one of several series, in all of them."""

    progress: Progress
    before: int
    total: int

    def __call__(self, done: int, of: int) -> None:
        self.progress(self.before + done, self.total)


@dataclass(frozen=True, eq=False)
class _Series:
    """Model, noise and number of the repeated experiments, common to all plans."""

    model: Elastic
    positions: Array
    omega: Array
    noise: NoiseLaw
    runs: int
    executor: Executor | None

    def run(
        self,
        trial: PredictedPlan,
        rng: np.random.Generator,
        progress: "_Shifted | None",
        store: Path | None,
    ) -> tuple[MonteCarlo, bool]:
        """Return repeated experiments by a plan, and whether equilibria were fixed."""
        visited = np.asarray(self.positions[trial.support])
        fitted, p = with_fixed_equilibria(self.model, visited), len(self.model.parameters)
        experiment = FrfExperiment(fitted, visited, self.omega, self.noise, trial.repetitions)
        _ = experiment.response  # computed here: the processes of a pool need not repeat it
        simulation = monte_carlo(
            experiment,
            fitted,
            rng=rng,
            runs=self.runs,
            methods=(),
            executor=self.executor,
            progress=progress,
            store=store,
        )
        if len(simulation.estimates) < p + _SPARE:
            raise SolverFailed(
                f"plan {trial.name!r}: {len(simulation.estimates)} of {self.runs} simulated "
                f"experiments could be fitted, {p + _SPARE} are needed; {simulation.failures[0]}"
            )
        return simulation, fitted is not self.model


def _planned(info: Candidates, name: str, counts: IntArray) -> PredictedPlan | UnidentifiedPlan:
    if counts.shape != (len(info),) or not counts.any() or (counts < 0).any():
        raise InvalidInput(
            f"plan {name!r}: experiments of shape {counts.shape}; whole numbers for each of "
            f"{len(info)} candidates are needed, not all zero"
        )
    support = np.flatnonzero(counts)
    total = info.combined(counts.astype(float))
    visited = name, read_only(support), read_only(counts[support])
    if names := unidentifiable(total, info.names):
        return UnidentifiedPlan(*visited, names)
    predicted = Uncertainty(info.names, scaled_inverse(total), "Theorem 1")
    return PredictedPlan(*visited, read_only(total), predicted)


def _compared(
    criterion: str | Criterion,
    optimal: SimulatedPlan,
    alternatives: tuple[SimulatedPlan | UnidentifiedPlan, ...],
    fixed_equilibria: bool,
) -> PlanComparison:
    objective, predicted, simulated = objective_of(criterion, optimal.predicted.names), [], []
    for alternative in alternatives:
        if isinstance(alternative, UnidentifiedPlan):
            predicted.append(0.0)
            simulated.append((0.0, 0.0, 0.0))
            continue
        predicted.append(objective.efficiency(alternative.information, optimal.information))
        simulated.append(
            ratio_interval(objective, alternative.simulation, optimal.simulation, LEVEL)
        )
    efficiencies = np.array([(1.0, 1.0, 1.0), *simulated])
    return PlanComparison(
        criterion=objective.name,
        optimal=optimal,
        alternatives=alternatives,
        predicted=read_only(np.array([1.0, *predicted])),
        simulated=read_only(efficiencies[:, 0]),
        interval=read_only(efficiencies[:, 1:]),
        fixed_equilibria=fixed_equilibria,
    )
