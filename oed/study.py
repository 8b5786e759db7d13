"""From a study file to its results: where to measure, what comes out, how certain it is."""

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimators.covariance import Uncertainty, covariance
from estimators.cross_check import CrossCheck, cross_check
from estimators.distortion import Distortion
from estimators.frf_estimate import FrfEstimate
from estimators.identifiability import Identifiability, fit_information, identifiability
from estimators.least_squares import Fit
from estimators.posterior import Posterior
from estimators.residual_analysis import ResidualAnalysis, residual_analysis
from oed import (
    study_data,
    study_design,
    study_fits,
    study_measured,
    study_published,
    study_uncertainty,
)
from oed.exact import ExactDesign
from oed.fingerprint import file_digest
from oed.information_set import InformationSet
from oed.relaxed import Design
from oed.screening import ScreenedCandidates
from oed.stages import Progress, Stage, open_stages, versions
from oed.study_data import Data, SimulatedExperiment
from oed.study_design import Plan
from oed.study_file import Study
from oed.study_fits import Search, start_number
from oed.study_published import Published
from oed.study_run import Run, truth_of
from robotmodels import ElasticRobot, load_robot
from robotmodels.arrays import Array, IntArray

__all__ = ["Progress", "Search", "StudyResults", "run_study", "start_number"]


@dataclass(frozen=True, eq=False)
class StudyResults:
    """All a study computed, and from what.

    Attributes
    ----------
    study, robot : what was asked.
    plant : the robot behind simulated data; None where data were measured.
    candidates : that the robot can take and why others were left out; None where data were
        measured.
    omega : (F,) of the data [rad/s].
    information, design, exact : candidates, relaxed optimum, integer plan. With measured data the
        candidates are the measured positions and the plan is what was measured.
    estimate : FRFs at the plan's positions.
    distortion : noise and distortion of records, per visit, or None.
    warnings : about the data.
    experiment : what a simulation in closed loop met, or None.
    starts : (starts, p) perturbed start values in SI units.
    searches : the fits of each estimator, by name.
    fit : the study's result: the estimator that the study names, or else NLS with optimal weights
        (the likelihood of the stated noise), best of all.
    fit_origin : where the search for `fit` began, for people.
    theorem1, posterior : its uncertainty, two ways.
    published : the estimators beside those of [WM]; None unless the study asks for it.
    seconds : time per stage, when it was computed.
    kept : stages that earlier runs had computed.
    versions : of Python and of the packages that computed.
    """

    study: Study
    robot: ElasticRobot
    plant: ElasticRobot | None
    candidates: ScreenedCandidates | None
    omega: Array
    information: InformationSet
    design: Design
    exact: ExactDesign
    estimate: FrfEstimate
    distortion: Distortion | None
    warnings: tuple[str, ...]
    experiment: SimulatedExperiment | None
    starts: Array
    searches: dict[str, Search]
    fit: Fit
    fit_origin: str
    theorem1: Uncertainty
    posterior: Posterior
    published: Published | None
    seconds: dict[str, float]
    kept: tuple[str, ...]
    versions: dict[str, str]

    @property
    def used(self) -> IntArray:
        """Indices of the candidates that the plan measures in."""
        return self.exact.support

    @property
    def truth(self) -> Array:
        """The parameters behind simulated data, (p,) SI; NaN where there is none of that name."""
        return truth_of(self.robot, self.plant)

    @property
    def z_scores(self) -> Array:
        """(ln estimate - ln truth) / standard deviation of Theorem 1, (p,); NaN without truth."""
        return np.log(self.fit.parameters.values / self.truth) / self.theorem1.std

    @cached_property
    def residuals(self) -> ResidualAnalysis:
        """What the fit leaves unexplained."""
        return residual_analysis(self.fit)

    @cached_property
    def identifiability(self) -> Identifiability:
        """Which combinations of parameters the data tell least."""
        return identifiability(fit_information(self.fit), self.fit.parameters.names)

    @cached_property
    def cross_check(self) -> CrossCheck:
        """All uncertainties of the fit side by side, with verdicts."""
        same = (self.fit.residual, "optimal", "all")
        runs = [
            run
            for search in self.searches.values()
            for run in search.runs
            if (search.estimator.residual, search.weights, search.estimator.positions) == same
        ]
        return cross_check(
            self.fit,
            theorem1=self.theorem1,
            empirical=covariance(self.fit, "empirical"),
            posterior=self.posterior,
            multistart=runs,
        )


def run_study(
    study: Study,
    progress: Progress | None = None,
    *,
    executor: Executor | None = None,
    fresh: bool = False,
) -> StudyResults:
    """Compute a study, stage by stage; the same seed gives the same results.

    Stages are kept in the folder ``stages`` of the study's output: what an earlier run computed
    from the same settings and data is not computed again, and an interrupted run goes on.

    Parameters
    ----------
    study : a study, see `oed.study_file.load_study`.
    progress : told how far each stage is.
    executor : runs information matrices, simulations, fits and ensembles in parallel.
    fresh : compute every stage again.

    Raises
    ------
    IdentificationError : where the study cannot be computed, naming what is at fault.
    """
    robot = load_robot(study.robot)
    plant = robot if study.truth is None else load_robot(study.truth)
    with open_stages(study.output / "stages", progress, fresh) as stages:
        run = Run(study, robot, plant, stages, executor)
        source = _measured(run) if study.data.measured else _simulated(run)
        return _results(run, source)


@dataclass(frozen=True, eq=False)
class _Source:
    """Where to measure and what was measured."""

    information: Stage[InformationSet]
    plan: Stage[Plan]
    data: Stage[Data]
    candidates: ScreenedCandidates | None = None
    experiment: SimulatedExperiment | None = None


def _simulated(run: Run) -> _Source:
    """Design the experiments and simulate them."""
    found = study_design.candidates(run)
    info = study_design.candidate_information(run, found)
    plan = study_design.plan(run, info)
    if run.study.data.experiment is None:
        return _Source(info, plan, study_data.noisy_frf(run, info, plan), found.value)
    shaken = study_data.experiment(run, info, plan)
    data = study_data.frf_from_records(run, shaken.value.records, shaken.digest)
    return _Source(info, plan, data, found.value, shaken.value)


def _measured(run: Run) -> _Source:
    """Take the data from files; where they were measured is the plan."""
    choice = run.study.data
    if choice.records is not None:
        data = study_data.frf_from_records(run, choice.records, file_digest(choice.records))
    else:
        assert choice.frf is not None
        data = study_data.frf_from_file(run, choice.frf)
    info = study_measured.measured_information(run, data)
    return _Source(info, study_measured.measured_plan(run, info, data), data)


def _results(run: Run, source: _Source) -> StudyResults:
    """Fit the data and judge the result."""
    starts = study_fits.starts_of(run)
    info, data = source.information.value, source.data
    searches: Mapping[str, Stage[Search]] = {
        estimator.name: study_fits.search(run, estimator, data, info, starts)
        for estimator in run.study.fit.used
    }
    result = study_fits.chosen(run, data, searches, starts)
    theorem1 = study_uncertainty.theorem1(run, result)
    posterior = study_uncertainty.posterior(run, result)
    compared = None
    if run.study.compare_with is not None:
        compared = study_published.compared(run, data, searches, starts)
    return StudyResults(
        study=run.study,
        robot=run.robot,
        plant=None if run.study.data.measured else run.plant,
        candidates=source.candidates,
        omega=data.value.estimate.omega,
        information=info,
        design=source.plan.value.design,
        exact=source.plan.value.exact,
        estimate=data.value.estimate,
        distortion=data.value.distortion,
        warnings=data.value.warnings,
        experiment=source.experiment,
        starts=starts,
        searches={name: stage.value for name, stage in searches.items()},
        fit=result.value.fit,
        fit_origin=result.value.origin,
        theorem1=theorem1.value,
        posterior=posterior.value,
        published=compared,
        seconds=run.stages.seconds,
        kept=run.stages.kept,
        versions=versions(),
    )
