"""From a study file to its results: where to measure, what comes out, how certain it is.

Each function goes one step further than the one before, and keeps what it computes: the next, in
the same process or another, goes on from there.
"""

from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TypeVar

from estimators.uncertainty.covariance import Uncertainty
from oed.candidates.screening import ScreenedCandidates
from oed.study.results import FittedStudy, PlannedStudy, StudyResults
from oed.study.settings.study_file import Study
from oed.study.stages import (
    data_stages as study_data,
    design_stages as study_design,
    fit_stages as study_fits,
    measured_design_stages as study_measured,
    uncertainty_stages as study_uncertainty,
    validation_stages as study_validation,
)
from oed.study.stages.comparison_stage import check_comparison, compared
from oed.study.stages.context import Run
from oed.study.stages.data_stages import Data, SimulatedExperiment
from oed.study.stages.design_stages import Information, Plan
from oed.study.stages.fit_stages import Chosen, Search
from oed.study.stages.stage_cache import Stage, open_stages, versions
from oed.study.stages.validation_stages import Split, split_data
from robotmodels import load_robot
from robotmodels.common.arrays import Array
from robotmodels.common.fingerprints import file_digest
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

    Parameters, errors and what is kept: see `run_study`.
    """
    with _opened(study, progress, executor, fresh) as run:
        return PlannedStudy(**_planned(run, _plan(run)))


def fit_study(
    study: Study,
    progress: StageProgress | None = None,
    *,
    executor: Executor | None = None,
    fresh: bool = False,
) -> FittedStudy:
    """Compute where to measure, take or simulate the data, and fit them.

    Parameters, errors and what is kept: see `run_study`.
    """
    with _opened(study, progress, executor, fresh) as run:
        source = _source(run)
        fitted = _fitted(run, source, _fits(run, source))
        return FittedStudy(**_planned(run, source), **fitted)


def run_study(
    study: Study,
    progress: StageProgress | None = None,
    *,
    executor: Executor | None = None,
    fresh: bool = False,
) -> StudyResults:
    """Compute a study, stage by stage; the same seed gives the same results.

    Stages are kept in the folder ``stages`` of the study's output: what an earlier run computed
    from the same settings and data is not computed again, and an interrupted run goes on.

    What comes after the fit may fail without cost to it: the results have the rest, and
    `failures` with the reasons.

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
    with _opened(study, progress, executor, fresh) as run:
        source = _source(run)
        fits = _fits(run, source)
        fitted = _fitted(run, source, fits)
        judged = _judged(run, source, fits)
        # Last: it says what all stages took.
        return StudyResults(**_planned(run, source), **fitted, **judged)


@contextmanager
def _opened(
    study: Study, progress: StageProgress | None, executor: Executor | None, fresh: bool
) -> Iterator[Run]:
    robot = load_robot(study.robot)
    plant = robot if study.truth is None else load_robot(study.truth)
    with open_stages(study.output / "stages", progress, fresh) as stages:
        run = Run(study, robot, plant, stages, executor)
        study_uncertainty.check_posterior(run)
        check_comparison(run)
        yield run


@dataclass(frozen=True, eq=False)
class _Planned:
    """Where to measure."""

    information: Stage[Information]
    plan: Stage[Plan]
    omega: Array
    candidates: ScreenedCandidates | None = None


@dataclass(frozen=True, eq=False)
class _Source(_Planned):
    """Where to measure and what was measured."""

    data: Stage[Data] = field(kw_only=True)
    experiment: SimulatedExperiment | None = None
    split: Stage[Split] | None = None


@dataclass(frozen=True, eq=False)
class _Fits:
    """What was fitted."""

    starts: Array
    searches: Mapping[str, Stage[Search]]
    result: Stage[Chosen]


def _plan(run: Run) -> _Planned:
    if run.study.data.measured:
        return _measured(run)
    found = study_design.candidates(run)
    info = study_design.candidate_information(run, found)
    plan = study_design.plan(run, info, study_design.sampled_information(run, found))
    return _Planned(info, plan, run.omega, found.value)


def _source(run: Run) -> _Source:
    return _measured(run) if run.study.data.measured else _simulated(run)


def _simulated(run: Run) -> _Source:
    """Design the experiments and simulate them."""
    planned = _plan(run)
    info, plan, shaken = planned.information, planned.plan, None
    if run.study.data.experiment is None:
        data = study_data.noisy_frf(run, info, plan)
    else:
        shaken = study_data.experiment(run, info, plan)
        data = study_data.frf_from_records(run, shaken.value.records, shaken.digest)
    omega, experiment = data.value.estimate.omega, None if shaken is None else shaken.value
    return _Source(info, plan, omega, planned.candidates, data=data, experiment=experiment)


def _measured(run: Run) -> _Source:
    """Take the data from files; where they were measured is the plan."""
    choice = run.study.data
    if choice.records is not None:
        data = study_data.frf_from_records(run, choice.records, file_digest(choice.records))
    else:
        assert choice.frf is not None
        data = study_data.frf_from_file(run, choice.frf)
    split = None if run.study.validation is None else split_data(run, data)
    if split is not None:
        data = Stage(data.name, split.value.fitted, split.digest, split.seconds, split.kept)
    info = study_measured.measured_information(run, data)
    plan = study_measured.measured_plan(run, info, data)
    return _Source(info, plan, data.value.estimate.omega, data=data, split=split)


def _fits(run: Run, source: _Source) -> _Fits:
    starts = study_fits.starts_of(run)
    searches = {
        estimator.name: study_fits.search(
            run,
            estimator,
            source.data,
            source.information.value,
            source.plan.value.used,
            starts,
        )
        for estimator in run.study.fit.used
    }
    return _Fits(starts, searches, study_fits.chosen(run, source.data, searches, starts))


def _planned(run: Run, planned: _Planned) -> dict[str, Any]:
    """Return the fields of a `PlannedStudy`."""
    return {
        "study": run.study,
        "robot": run.robot,
        "plant": None if run.study.data.measured else run.plant,
        "candidates": planned.candidates,
        "information": planned.information.value,
        "design": planned.plan.value.design,
        "exact": planned.plan.value.exact,
        "robust": planned.plan.value.robust,
        "order": planned.plan.value.order,
        "omega": planned.omega,
        "failures": tuple(run.stages.failures),
        "seconds": run.stages.seconds,
        "kept": run.stages.kept,
        "versions": versions(),
    }


def _fitted(run: Run, source: _Source, fits: _Fits) -> dict[str, Any]:
    """Return the fields that a `FittedStudy` has besides."""
    data = source.data.value
    return {
        "estimate": data.estimate,
        "distortion": data.distortion,
        "warnings": data.warnings,
        "experiment": source.experiment,
        "starts": fits.starts,
        "searches": {name: stage.value for name, stage in fits.searches.items()},
        "fit": fits.result.value.fit,
        "fit_origin": fits.result.value.origin,
    }


def _judged(run: Run, source: _Source, fits: _Fits) -> dict[str, Any]:
    """Return the fields that `StudyResults` has besides: how far to trust plan and fit."""
    attempt, result = run.stages.attempt, fits.result
    comparison = None
    if run.study.compares:
        comparison = attempt("comparison", lambda: compared(run, source.information, source.plan))
    covariances = attempt("uncertainty", lambda: study_uncertainty.theorem1(run, result))
    known = study_uncertainty.Known(
        covariances,
        attempt("posterior", lambda: study_uncertainty.posterior(run, result)),
        attempt("own-cost", lambda: study_uncertainty.own_cost(run, result)),
        attempt("profiles", lambda: study_uncertainty.profiles(run, result, covariances)),
        comparison,
    )
    checked = attempt(
        "cross-check", lambda: study_uncertainty.checked(run, result, known, fits.searches)
    )
    held_out = attempt("validation", lambda: _held_out(run, source, fits, covariances))
    return {
        "theorem1": _value(covariances),
        "posterior": _value(known.posterior),
        "cross_check": _value(checked),
        "held_out": _value(held_out),
        "comparison": _value(comparison),
    }


def _value(stage: Stage[T] | None) -> T | None:
    return None if stage is None else stage.value


def _held_out(
    run: Run,
    source: _Source,
    fits: _Fits,
    covariances: Stage[Uncertainty] | None,
) -> Stage[study_validation.HeldOut] | None:
    if run.study.validation is None:
        return None
    known = study_uncertainty.needed(covariances)
    if source.split is not None:
        return study_validation.held_back(run, source.split, fits.result, known)
    return study_validation.held_out(run, source.information, source.plan, fits.result, known)
