"""What a study computed, as far as it went: a plan, a fit, a result with its uncertainty."""

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
from oed.exact import ExactDesign
from oed.information_set import InformationSet
from oed.relaxed import Design
from oed.screening import ScreenedCandidates
from oed.study_data import SimulatedExperiment
from oed.study_file import Study
from oed.study_fits import Search
from oed.study_published import Published
from oed.study_run import truth_of
from robotmodels import ElasticRobot
from robotmodels.arrays import Array, IntArray


@dataclass(frozen=True, eq=False)
class PlannedStudy:
    """Where to measure, and from what that was computed.

    Attributes
    ----------
    study, robot : what was asked.
    plant : the robot behind simulated data; None where data were measured.
    candidates : that the robot can take and why others were left out; None where data were
        measured.
    information, design, exact : candidates, relaxed optimum, integer plan. With measured data the
        candidates are the measured positions and the plan is what was measured.
    omega : (F,) of the data, or of the design where there are none yet [rad/s].
    seconds : time per stage, when it was computed.
    kept : stages that earlier runs had computed.
    versions : of Python and of the packages that computed.
    """

    study: Study
    robot: ElasticRobot
    plant: ElasticRobot | None
    candidates: ScreenedCandidates | None
    information: InformationSet
    design: Design
    exact: ExactDesign
    omega: Array
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


@dataclass(frozen=True, eq=False)
class FittedStudy(PlannedStudy):
    """A plan, the data and what was fitted to them.

    Attributes
    ----------
    estimate : FRFs at the plan's positions.
    distortion : noise and distortion of records, or None.
    warnings : about the data.
    experiment : what a simulation in closed loop met, or None.
    starts : (starts, p) perturbed start values in SI units.
    searches : the fits of each estimator, by name.
    fit : the study's result: the estimator that the study names, or else NLS with optimal weights
        (the likelihood of the stated noise), best of all.
    fit_origin : where the search for `fit` began, for people.
    published : the estimators beside those of [WM]; None unless the study asks for it.
    """

    estimate: FrfEstimate
    distortion: Distortion | None
    warnings: tuple[str, ...]
    experiment: SimulatedExperiment | None
    starts: Array
    searches: dict[str, Search]
    fit: Fit
    fit_origin: str
    published: Published | None

    @cached_property
    def residuals(self) -> ResidualAnalysis:
        """What the fit leaves unexplained."""
        return residual_analysis(self.fit)

    @cached_property
    def identifiability(self) -> Identifiability:
        """Which combinations of parameters the data tell least."""
        return identifiability(fit_information(self.fit), self.fit.parameters.names)


@dataclass(frozen=True, eq=False)
class StudyResults(FittedStudy):
    """All a study computed.

    Attributes
    ----------
    theorem1, posterior : uncertainty of the fit, two ways.
    """

    theorem1: Uncertainty
    posterior: Posterior

    @property
    def z_scores(self) -> Array:
        """(ln estimate - ln truth) / standard deviation of Theorem 1, (p,); NaN without truth."""
        return np.log(self.fit.parameters.values / self.truth) / self.theorem1.std

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
