"""Results of a study as far as it went, and the key figures that every report of it shows."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from estimators.sampling.exported_draws import fit_draws, spread_words
from estimators.structure.power import StructurePower
from estimators.trust.trust import Trust
from estimators.validation.controller_margins import ControllerMargins, controller_margins
from estimators.validation.predict import Prediction
from estimators.validation.predict_tool import ToolPrediction
from oed.experiment.prepare import controller_of
from oed.plan_comparison.plan_comparison import PlanComparison
from oed.study.parts import (
    DesignedPlan,
    Fits,
    MeasuredData,
    MeasuredPlan,
    RunRecord,
    SimulatedData,
    UncertaintyOfResult,
)
from oed.study.settings.study_file import Study
from oed.study.stage_cache import Failure
from oed.study.stages.design_inputs import purpose_of
from oed.study.stages.responses import PredictedResponses
from oed.study.stages.validation import HeldOut
from oed.study.summary import (
    FitSummary,
    PlanSummary,
    UncertaintySummary,
    summarise_fits,
    summarise_plan,
    summarise_uncertainty,
)
from robotmodels import ElasticRobot, linear_feedback
from robotmodels.common.arrays import Array

_MARGIN_POSITIONS, _MARGIN_DRAWS = 6, 40
"""Positions of the plan in which the controller is judged, at most, and draws for its bands."""


@dataclass(frozen=True, eq=False)
class PlannedStudy:
    """Where to measure, and from what that was computed.

    Attributes
    ----------
    study : Study
        Settings of the study.
    robot : ElasticRobot
        Model that was fitted.
    plan : DesignedPlan or MeasuredPlan
        Positions and visits: designed for simulated data, part of measured data.
    run : RunRecord
        Failures, times and versions.
    """

    study: Study
    robot: ElasticRobot
    plan: DesignedPlan | MeasuredPlan
    run: RunRecord

    @property
    def measured(self) -> bool:
        """Whether the data come from files."""
        return isinstance(self.plan, MeasuredPlan)

    @cached_property
    def plan_summary(self) -> PlanSummary:
        """Key figures of the plan."""
        return summarise_plan(self.plan)

    @property
    def powers(self) -> tuple[StructurePower, ...]:
        """What the plan's data will tell of springs that it is to tell apart."""
        return self.plan.powers if isinstance(self.plan, DesignedPlan) else ()

    @cached_property
    def purpose_std(self) -> float | None:
        """Relative standard deviation that the plan leaves to its purpose; None without one.

        The root mean square over the purpose's region, tr(L C)^(1/2) with C that of ln theta.
        """
        if self.study.design.purpose is None:
            return None
        predicted, L = self.plan.predicted, purpose_of(self.study.design.purpose, self.robot).matrix
        shares = np.einsum("kp,pr,kr->k", predicted.directions, L, predicted.directions)
        return float(np.sqrt((shares * predicted.direction_std**2)[shares > 0].sum()))

    def with_failures(self, *failures: Failure) -> Self:
        """Return the results with more failures."""
        return replace(self, run=replace(self.run, failures=self.run.failures + failures))

    def as_loaded(self) -> Self:
        """Return the results as they are when all stages are loaded."""
        return replace(self, run=replace(self.run, loaded=tuple(self.run.seconds)))


@dataclass(frozen=True, eq=False)
class FittedStudy(PlannedStudy):
    """A plan, the data and what was fitted to them.

    Attributes
    ----------
    data : SimulatedData or MeasuredData
        FRFs or runs at the plan's positions.
    fits : Fits
        Fits of all estimators, and the result.
    """

    data: SimulatedData | MeasuredData
    fits: Fits

    @property
    def trust(self) -> Trust:
        """Recommended intervals and the verdict."""
        return self.fits.result.trust

    @cached_property
    def fit_summary(self) -> FitSummary:
        """Key figures of the fits and of the recommended intervals."""
        return summarise_fits(self.fits, self.trust)

    @property
    def truth(self) -> Array:
        """The parameters behind simulated data, (p,) SI; NaN where there is none of that name."""
        parameters = self.robot.parameters
        if not isinstance(self.data, SimulatedData):
            return np.full(len(parameters), np.nan)
        true = self.data.plant.parameters
        values = dict(zip(true.names, true.values, strict=True))
        return np.array([values.get(name, np.nan) for name in parameters.names])


@dataclass(frozen=True, eq=False)
class StudyResults(FittedStudy):
    """All a study computed.

    Attributes
    ----------
    uncertainty : UncertaintyOfResult
        Uncertainty of the result by several methods.
    comparison : PlanComparison or None
        The plan beside alternatives in simulated experiments; None where there is none.
    validation : HeldOut or None
        Predictions of positions that were not fitted; None unless the study asks for them.
    tool : ToolPrediction or None
        Compliance and modes at the end of the last link in the plan's first positions; None
        without a covariance.
    free_modes : Prediction or None
        Modes of the robot with free motors there, (Q, 2, k), of `free_modes`.
    responses : PredictedResponses or None
        How certain the result's FRFs are; None without a covariance, or where the data are runs.
    """

    uncertainty: UncertaintyOfResult
    comparison: PlanComparison | None
    validation: HeldOut | None
    tool: ToolPrediction | None
    free_modes: Prediction | None = None
    responses: PredictedResponses | None = None

    @property
    def trust(self) -> Trust:
        """Recommended intervals and the verdict, refined by posterior and profiles."""
        check = self.uncertainty.cross_check
        return self.fits.result.trust if check is None else check.trust

    @property
    def z_scores(self) -> Array:
        """(ln estimate - ln truth) / standard deviation of Theorem 1, (p,); NaN without either."""
        return np.log(self.fits.result.parameters.values / self.truth) / self.uncertainty.std

    @cached_property
    def posterior_draws(self) -> Array | None:
        """Draws of ln theta, (N, p), of a posterior that converged; None without one."""
        posterior = self.uncertainty.posterior
        return None if posterior is None or not posterior.converged else posterior.draws

    @property
    def spread(self) -> str:
        """What the bands of tool and controller rest on, in words."""
        return spread_words(self.fits.result, self.posterior_draws)

    @cached_property
    def controller(self) -> ControllerMargins | None:
        """Margins of the controller of the simulated experiment there; None without one."""
        settings, best = self.study.data.experiment, self.fits.result
        if settings is None:
            return None
        feedback = linear_feedback(controller_of(settings, self.robot))
        rng = np.random.default_rng(0)
        drawn = fit_draws(best, self.posterior_draws, _MARGIN_DRAWS, rng)
        return controller_margins(best, feedback, self.plan.positions[:_MARGIN_POSITIONS], drawn)

    @cached_property
    def uncertainty_summary(self) -> UncertaintySummary:
        """Key figures of the uncertainty."""
        return summarise_uncertainty(self.uncertainty)
