"""From a study file to its results: where to measure, what comes out, how certain it is.

Each function goes one step further than the one before, and stores what it computes: the next, in
the same process or another, goes on from there.
"""

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import TypeVar

from estimators.fitting.fit_problem import Measured
from estimators.fitting.fitted_model import FittedModel
from estimators.sampling.posterior import Posterior
from estimators.structure.choose_structure import choose_structure
from estimators.structure.score_tests import score_tests
from estimators.uncertainty.covariance import covariance
from estimators.validation.held_out_positions import validate
from oed.plan_comparison.plan_comparison import PlanComparison
from oed.study.parts import Fits, RunRecord, Structure, UncertaintyOfResult
from oed.study.results import FittedStudy, PlannedStudy, StudyResults
from oed.study.settings.study_file import Study
from oed.study.sources import MeasuredStudy, SimulatedDesign, SimulatedStudy
from oed.study.stage_cache import Beside, Stage, Stages, versions
from oed.study.stages.assumed_springs import powers_of_alternatives
from oed.study.stages.cross_check import CrossCheckInputs, cross_check, importance
from oed.study.stages.fit import Search, fit
from oed.study.stages.posterior import check_posterior, cost_posterior, posterior, stored_posterior
from oed.study.stages.profiles import profiles
from oed.study.stages.residuals import residuals
from oed.study.stages.responses import responses
from oed.study.stages.result import SelectedFit, result
from oed.study.stages.run import MeasuredRun, SimulatedRun, open_run
from oed.study.stages.tool import tool
from oed.study.stages.uncertainty import uncertainty
from robotmodels.common.arrays import Array, check_level
from robotmodels.common.progress import StageProgress

T = TypeVar("T")


def design_study(
    study: Study,
    progress: StageProgress | None = None,
    *,
    executor: Executor | None = None,
    fresh: bool = False,
) -> PlannedStudy:
    """Compute where to measure; of measured data, how good that was.

    Parameters, errors and what is stored: see `run_study`.
    """
    with open_run(study, progress, executor, fresh) as run:
        check_posterior(run)
        source = MeasuredStudy.of(run) if isinstance(run, MeasuredRun) else SimulatedDesign.of(run)
        return PlannedStudy(study, run.robot, source.plan, _record(run.stages))


def fit_study(
    study: Study,
    progress: StageProgress | None = None,
    *,
    executor: Executor | None = None,
    fresh: bool = False,
) -> FittedStudy:
    """Compute where to measure, take or simulate the data, and fit them.

    Parameters, errors and what is stored: see `run_study`.
    """
    with open_run(study, progress, executor, fresh) as begun:
        source = _source(begun)
        run = source.run
        fits = _Fits.of(source)
        record = _record(run.stages)
        return FittedStudy(study, run.robot, source.plan, record, source.results_data, fits.results)


def structure_study(
    study: Study,
    progress: StageProgress | None = None,
    *,
    executor: Executor | None = None,
    fresh: bool = False,
    level: float = 0.01,
    most: int = 8,
) -> tuple[FittedStudy, Structure]:
    """Compute which springs the data of a study ask for beside those of its robot.

    Parameters, errors and what is stored, as far as the fit: see `run_study`.

    Parameters
    ----------
    level, most : float, int
        As of `estimators.choose_structure`.
    """
    check_level(level, "structure")
    with open_run(study, progress, executor, fresh) as begun:
        source = _source(begun)
        fits = _Fits.of(source)
        record = _record(source.run.stages)
        results = FittedStudy(
            study, source.run.robot, source.plan, record, source.results_data, fits.results
        )
        best = fits.results.result
        choice = choose_structure(best, level=level, most=most)
        out = source.split if isinstance(source, MeasuredStudy) else None
        misfits = None
        if out is not None:
            ends = [best, *(step.fit for step in choice.steps)]
            misfits = tuple(_misfit(end, out.value.held_out) for end in ends)
        powers = powers_of_alternatives(study.design, source.run.robot, best, level)
        return results, Structure(score_tests(best), choice, misfits, powers)


def _misfit(fit: FittedModel, held_out: Measured) -> float:
    """Return the squared misfit of a fit per datum of positions that it has not seen."""
    return validate(fit.model, fit.parameters.values, held_out, covariance(fit)).misfit


def run_study(
    study: Study,
    progress: StageProgress | None = None,
    *,
    executor: Executor | None = None,
    fresh: bool = False,
) -> StudyResults:
    """Compute a study, stage by stage; the same seed gives the same results.

    Stages are stored in the folder ``stages`` of the study's output: what an earlier run computed
    from the same settings and data is not computed again, and an interrupted run goes on.

    Stages after the fit may fail without cost to it: the results have the others, and
    `run.failures` with the reasons.

    Parameters
    ----------
    study : Study
        A study, see `oed.study.settings.study_file.load_study`.
    progress : StageProgress, optional
        Told how far each stage is.
    executor : Executor, optional
        Runs information matrices, simulations, fits and ensembles in parallel.
    fresh : bool
        Compute every stage again.

    Raises
    ------
    IdentificationError
        Where the study cannot be computed, naming what is at fault.
    """
    with open_run(study, progress, executor, fresh) as begun:
        source = _source(begun)
        with source.run.beside("comparison", source.comparison) as compared:
            return _results(source, compared)


def _results(
    source: SimulatedStudy | MeasuredStudy, compared: Beside[Stage[PlanComparison] | None]
) -> StudyResults:
    """Run the stages from the fits on: other processes draw samples, predict and compare plans."""
    run, plan = source.run, source.plan
    fits = _Fits.of(source)
    best, attempt = fits.result, run.stages.attempt
    theorem1 = attempt("uncertainty", lambda: uncertainty(run, best))
    with run.beside("posterior", lambda: posterior(run, best)) as sampled:
        unexplained = attempt("residuals", lambda: residuals(run, best))
        weighted = attempt("importance", lambda: importance(run, best))
        drawn = sampled.result()
    with (
        run.beside("tool", lambda: tool(run, best, theorem1, drawn, plan.positions)) as predicted,
        run.beside(
            "responses", lambda: responses(run, source.data, best, theorem1, drawn)
        ) as certain,
    ):
        by_cost = attempt("cost-posterior", lambda: cost_posterior(run, best, _value(unexplained)))
        curves = attempt("profiles", lambda: profiles(run, best, theorem1))
        tools, bands = predicted.result(), certain.result()
    methods = CrossCheckInputs(theorem1, drawn, by_cost, curves, compared.result(), weighted)
    check = attempt("cross-check", lambda: cross_check(run, best, methods, fits.searches))
    held_out = attempt("validation", lambda: source.validation(best, theorem1))
    names = run.robot.parameters.names
    return StudyResults(
        run.study,
        run.robot,
        plan,
        _record(run.stages),
        source.results_data,
        replace(fits.results, stored=_value(unexplained)),
        UncertaintyOfResult(
            names,
            _value(theorem1),
            _value(methods.posterior),
            _value(check),
            methods.profile_likelihoods,
        ),
        _value(methods.comparison),
        _value(held_out),
        None if tools is None else tools.value.tool,
        None if tools is None else tools.value.free_modes,
        _value(bands),
    )


def _source(run: SimulatedRun | MeasuredRun) -> SimulatedStudy | MeasuredStudy:
    """Run the stages up to the data."""
    check_posterior(run)
    return MeasuredStudy.of(run) if isinstance(run, MeasuredRun) else SimulatedStudy.of(run)


def _record(stages: Stages) -> RunRecord:
    return RunRecord(tuple(stages.failures), stages.seconds, stages.loaded, versions())


@dataclass(frozen=True, eq=False)
class _Fits:
    """The stages that fit, finished."""

    starts: Array
    searches: Mapping[str, Stage[Search]]
    result: Stage[SelectedFit]
    posterior: Posterior | None

    @classmethod
    def of(cls, source: SimulatedStudy | MeasuredStudy) -> "_Fits":
        """Run the stages."""
        run, data = source.run, source.data
        starts = run.starts
        searches = {
            estimator.name: fit(run, estimator, data, starts) for estimator in run.study.estimators
        }
        best = result(run, data, searches, starts)
        return cls(starts, searches, best, stored_posterior(run, best))

    @property
    def results(self) -> Fits:
        """The fits."""
        searches = {name: stage.value for name, stage in self.searches.items()}
        best = self.result.value
        return Fits(self.starts, searches, best.fit, best.origin, self.posterior)


def _value(stage: Stage[T] | None) -> T | None:
    return None if stage is None else stage.value
