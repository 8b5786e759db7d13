"""What a study computed, as far as it went: a plan, a fit, a result with its uncertainty."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimators.fitting.least_squares import Fit
from estimators.frf.distortion import Distortion
from estimators.frf.frf_estimate import FrfEstimate
from estimators.sampling.posterior import Posterior
from estimators.trust.trust import Trust
from estimators.uncertainty.covariance import Uncertainty
from estimators.uncertainty.identifiability import Identifiability, fit_information, identifiability
from estimators.uncertainty.residual_analysis import LAGS, ResidualAnalysis, residual_analysis
from estimators.validation.cross_check import CrossCheck
from oed.candidates.screening import ScreenedCandidates
from oed.design.design import Design
from oed.design.robust_design import RobustDesign
from oed.exact.exact_design import ExactDesign
from oed.experiment.visiting_order import VisitingOrder
from oed.plan_comparison.plan_comparison import PlanComparison
from oed.study.settings.study_file import Study
from oed.study.stages.context import truth_of
from oed.study.stages.data_stages import SimulatedExperiment
from oed.study.stages.design_stages import Information, visited
from oed.study.stages.fit_stages import Search
from oed.study.stages.stage_cache import Failure
from oed.study.stages.validation_stages import HeldOut
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array, IntArray


@dataclass(frozen=True, eq=False)
class PlannedStudy:
    """Where to measure, and from what that was computed.

    Attributes
    ----------
    study : Study
        Settings of the study.
    robot : ElasticRobot
        Model that was fitted.
    plant : ElasticRobot or None
        The robot behind simulated data; None where data were measured.
    candidates : ScreenedCandidates or None
        Candidates that the robot can take and why others were left out; None where data were
        measured.
    information : Information
        Information of the candidates; with measured data these are the measured positions.
    design : Design
        Relaxed optimum.
    exact : ExactDesign
        Integer plan; with measured data what was measured.
    robust : RobustDesign or None
        What a robust design keeps at each sample of theta; None where it is for one theta.
    order : VisitingOrder or None
        Order of the plan's support, to shorten the moves; None where the study says nothing of
        them.
    omega : ndarray, (F,), rad/s
        Angular frequencies of the data, or of the design where there are none yet.
    failures : tuple of Failure
        What came after the fit and could not be computed, with the reasons.
    seconds : dict of str to float
        Time per stage, when it was computed.
    kept : tuple of str
        Stages that earlier runs had computed.
    versions : dict of str to str
        Versions of Python and of the packages that computed.
    """

    study: Study
    robot: ElasticRobot
    plant: ElasticRobot | None
    candidates: ScreenedCandidates | None
    information: Information
    design: Design
    exact: ExactDesign
    robust: RobustDesign | None
    order: VisitingOrder | None
    omega: Array
    failures: tuple[Failure, ...]
    seconds: dict[str, float]
    kept: tuple[str, ...]
    versions: dict[str, str]

    @property
    def used(self) -> IntArray:
        """Indices of the candidates that the plan measures in, in the order of visits."""
        return visited(self.exact, self.order)

    @property
    def visits(self) -> int:
        """Experiments in all: visits to a position, each with its runs."""
        return int(self.exact.repetitions.sum())

    @property
    def runs_per_visit(self) -> int:
        """Excitations of one visit: one for each motor, in every block of a simulation."""
        simulated = self.study.data.experiment
        blocks = 1 if simulated is None else simulated.blocks
        return blocks * len(self.robot.motor_names)

    @cached_property
    def promise(self) -> Identifiability:
        """What the plan's own information promises: standard deviations, open combinations."""
        counts = self.exact.repetitions[self.used]
        matrices = self.information.take(self.used)
        total = sum(n * matrix for n, matrix in zip(counts, matrices, strict=True))
        return identifiability(total, self.robot.parameters.names)

    @property
    def truth(self) -> Array:
        """The parameters behind simulated data, (p,) SI; NaN where there is none of that name."""
        return truth_of(self.robot, self.plant)


@dataclass(frozen=True, eq=False)
class FittedStudy(PlannedStudy):
    """A plan, the data and what was fitted to them.

    Attributes
    ----------
    estimate : FrfEstimate
        FRFs at the plan's positions.
    distortion : Distortion or None
        Noise and distortion of records, or None.
    warnings : tuple of str
        Warnings about the data.
    experiment : SimulatedExperiment or None
        What a simulation in closed loop met, or None.
    starts : ndarray, (starts, p)
        Perturbed start values in SI units.
    searches : dict of str to Search
        The fits of each estimator, by name.
    fit : Fit
        The study's result: the estimator that the study names, or else NLS with optimal weights
        (the likelihood of the stated noise), best of all.
    fit_origin : str
        Where the search for `fit` began, for people.
    """

    estimate: FrfEstimate
    distortion: Distortion | None
    warnings: tuple[str, ...]
    experiment: SimulatedExperiment | None
    starts: Array
    searches: dict[str, Search]
    fit: Fit
    fit_origin: str

    @cached_property
    def residuals(self) -> ResidualAnalysis:
        """What the fit leaves unexplained."""
        return residual_analysis(self.fit, min(LAGS, len(self.omega) - 1))

    @property
    def trust(self) -> Trust:
        """Recommended intervals and the verdict."""
        return self.fit.trust

    @cached_property
    def identifiability(self) -> Identifiability:
        """Which combinations of parameters the data tell least."""
        return identifiability(fit_information(self.fit), self.fit.parameters.names)


@dataclass(frozen=True, eq=False)
class StudyResults(FittedStudy):
    """All a study computed.

    Attributes
    ----------
    theorem1 : Uncertainty or None
        Uncertainty of the fit by Theorem 1; None where that failed.
    posterior : Posterior or None
        Sample of the posterior; None where that failed.
    cross_check : CrossCheck or None
        All that is known of it side by side, with verdicts; None where that failed.
    held_out : HeldOut or None
        Validation in positions that were not fitted; None unless the study asks for it.
    comparison : PlanComparison or None
        The plan beside rivals in simulated experiments; None where there is none.
    """

    theorem1: Uncertainty | None
    posterior: Posterior | None
    cross_check: CrossCheck | None
    held_out: HeldOut | None
    comparison: PlanComparison | None

    @property
    def trust(self) -> Trust:
        """Recommended intervals and the verdict, refined by posterior and profiles."""
        return self.fit.trust if self.cross_check is None else self.cross_check.trust

    @property
    def std(self) -> Array:
        """Standard deviations by Theorem 1, (p,); NaN where there are none."""
        return _std(self.theorem1, len(self.fit.parameters))

    @property
    def sampled_std(self) -> Array:
        """Standard deviations of the posterior, (p,); NaN where there are none."""
        sampled = None if self.posterior is None else self.posterior.uncertainty()
        return _std(sampled, len(self.fit.parameters))

    @property
    def z_scores(self) -> Array:
        """(ln estimate - ln truth) / standard deviation of Theorem 1, (p,); NaN without either."""
        return np.log(self.fit.parameters.values / self.truth) / self.std


def _std(uncertainty: Uncertainty | None, p: int) -> Array:
    return np.full(p, np.nan) if uncertainty is None else uncertainty.std
