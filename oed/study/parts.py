"""The parts of a study's results: its plan, its data, its fits, their uncertainty, its run."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimators.fitting.least_squares import Fit
from estimators.fitting.run_fit import RunFit
from estimators.sampling.posterior import Posterior
from estimators.sampling.profile_likelihood import Profile
from estimators.structure.choose_structure import StructureChoice
from estimators.structure.power import StructurePower
from estimators.structure.score_table import ScoreTable
from estimators.uncertainty.covariance import Uncertainty
from estimators.uncertainty.identifiability import Identifiability, fit_information, identifiability
from estimators.uncertainty.residual_analysis import ResidualAnalysis
from estimators.uncertainty.standardised_residuals import standardised_residuals
from estimators.validation.cross_check import CrossCheck
from oed.candidates.screening import ScreenedCandidates
from oed.design.design import Design
from oed.design.robust_design import RobustDesign
from oed.exact.exact_design import ExactDesign
from oed.exact.nested_plans import NestedPlans, nested_plans
from oed.experiment.visiting_order import VisitingOrder
from oed.study.stage_cache import Failure
from oed.study.stages.data import Data
from oed.study.stages.experiment import SimulatedExperiment
from oed.study.stages.fit import Search
from oed.study.stages.information import Information
from oed.study.stages.residuals import FitResiduals, analysed
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array, IntArray


@dataclass(frozen=True, eq=False)
class _Plan:
    """Positions, visits and their information.

    Attributes
    ----------
    information : Information
        Information of the candidates; with measured data these are the measured positions.
    design : Design
        Relaxed optimum.
    exact : ExactDesign
        Integer plan; with measured data what was measured.
    used : ndarray of int, (Q,)
        Indices of the candidates that the plan measures in, in the order of visits.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    runs_per_visit : int
        Excitations of one visit: usually one for each motor, in every block of a simulation.
    visit_share : float
        Part of the information of a run for each motor that a visit has: its runs over the motors.
    """

    information: Information
    design: Design
    exact: ExactDesign
    used: IntArray
    omega: Array
    runs_per_visit: int
    visit_share: float

    @property
    def positions(self) -> Array:
        """Positions that are measured in, (Q, n), in the order of visits."""
        return np.asarray(self.information.positions[self.used])

    @property
    def visits(self) -> int:
        """Experiments in all: visits to a position, each with its runs."""
        return int(self.exact.repetitions.sum())

    @property
    def runs(self) -> int:
        """Runs of all visits."""
        return self.visits * self.runs_per_visit

    @cached_property
    def predicted(self) -> Identifiability:
        """Standard deviations and open combinations by the plan's information."""
        counts = self.exact.repetitions[self.used]
        matrices = self.information.take(self.used)
        total = sum(n * matrix for n, matrix in zip(counts, matrices, strict=True))
        return identifiability(self.visit_share * total, self.information.names)

    @cached_property
    def nested(self) -> NestedPlans:
        """The plan's visits, the most informative first, and its accuracy after each."""
        visit = self.visit_share * np.asarray(self.information.take(self.used))
        return nested_plans(visit, self.exact.repetitions[self.used])


@dataclass(frozen=True, eq=False)
class DesignedPlan(_Plan):
    """A plan that the study chose.

    Attributes
    ----------
    candidates : ScreenedCandidates
        Feasible candidates, and the reasons for removing others.
    robust : RobustDesign or None
        Efficiency of a robust design at each sample of theta; None where it is for one theta.
    order : VisitingOrder or None
        Order of the plan's support, to shorten the moves; None where the study says nothing of
        them.
    powers : tuple of StructurePower
        What the plan's data will tell of springs that it is to tell apart.
    """

    candidates: ScreenedCandidates
    robust: RobustDesign | None
    order: VisitingOrder | None
    powers: tuple[StructurePower, ...] = ()


@dataclass(frozen=True, eq=False)
class MeasuredPlan(_Plan):
    """The positions of measured data, as a plan."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedData(Data):
    """Data of a simulation.

    Attributes
    ----------
    plant : ElasticRobot
        Robot that was simulated.
    experiment : SimulatedExperiment or None
        Simulation in closed loop; None where the noise law made the data.
    """

    plant: ElasticRobot
    experiment: SimulatedExperiment | None


@dataclass(frozen=True, eq=False)
class MeasuredData(Data):
    """Data from files.

    Attributes
    ----------
    recorded : float or None, s
        Measured periods of all runs together; None where the file has no runs.
    """

    recorded: float | None = None


@dataclass(frozen=True, eq=False)
class Fits:
    """Fits of the data.

    Attributes
    ----------
    starts : ndarray, (starts, p)
        Perturbed start values in SI units.
    searches : mapping of str to Search
        The fits of each estimator, by name.
    result : Fit or RunFit
        The study's result, see `oed.study.stages.result.SelectedFit`.
    origin : str
        Where the search for `result` began, for people.
    posterior : Posterior or None
        That an earlier run sampled about `result`, if it converged.
    stored : FitResiduals or None
        Residuals and information, where a stage has them.
    """

    starts: Array
    searches: Mapping[str, Search]
    result: Fit | RunFit
    origin: str
    posterior: Posterior | None = None
    stored: FitResiduals | None = None

    @cached_property
    def residuals(self) -> ResidualAnalysis:
        """What the result leaves unexplained."""
        return self.stored.analysis if self.stored else analysed(self.result)

    @cached_property
    def standardised(self) -> Array:
        """Residuals over their standard deviations, see `standardised_residuals`."""
        return self.stored.standardised if self.stored else standardised_residuals(self.result)

    def best_cost(self, name: str) -> float:
        """Return the best cost of an estimator; the result's where that is the same cost."""
        search = self.searches[name]
        same = search.is_likelihood and not self.result.logarithmic
        return min(search.runs[0].cost, self.result.cost if same else np.inf)

    @cached_property
    def information(self) -> Array:
        """Information of the data on ln theta at the result, (p, p)."""
        return self.stored.information if self.stored else fit_information(self.result)

    @cached_property
    def identifiability(self) -> Identifiability:
        """Which combinations of parameters the data tell least."""
        return identifiability(self.information, self.result.parameters.names)


@dataclass(frozen=True, eq=False)
class Structure:
    """Springs selected by the data.

    Attributes
    ----------
    scores : ScoreTable
        Score tests of the study's result: springs, numbers of the robot file, lines.
    choice : StructureChoice
        Springs chosen, step by step.
    held_out : tuple of float, or None
        Squared misfit per datum in positions held out, one is expected: of the study's result, then
        after each step; None where the study holds none out.
    powers : tuple of StructurePower
        What data like these tell of each spring that the study's design is to tell apart.
    """

    scores: ScoreTable
    choice: StructureChoice
    held_out: tuple[float, ...] | None
    powers: tuple[StructurePower, ...] = ()


@dataclass(frozen=True, eq=False)
class UncertaintyOfResult:
    """Uncertainty of the result by several methods; None where one failed.

    Attributes
    ----------
    names : tuple of str
        The p parameters.
    theorem1 : Uncertainty or None
        By Theorem 1.
    posterior : Posterior or None
        Sample of the posterior.
    cross_check : CrossCheck or None
        All methods side by side, with verdicts.
    profiles : tuple of Profile
        Profile likelihoods of the least certain parameters, with curves.
    """

    names: tuple[str, ...]
    theorem1: Uncertainty | None
    posterior: Posterior | None
    cross_check: CrossCheck | None
    profiles: tuple[Profile, ...] = ()

    @property
    def std(self) -> Array:
        """Standard deviations by Theorem 1, (p,); NaN where there are none."""
        return self._std(self.theorem1)

    @cached_property
    def sampled_std(self) -> Array:
        """Standard deviations of the posterior, (p,); NaN where there are none."""
        return self._std(None if self.posterior is None else self.posterior.uncertainty())

    def _std(self, uncertainty: Uncertainty | None) -> Array:
        return np.full(len(self.names), np.nan) if uncertainty is None else uncertainty.std


@dataclass(frozen=True, eq=False)
class RunRecord:
    """Record of a computation: failures, times and versions.

    Attributes
    ----------
    failures : tuple of Failure
        What came after the fit and could not be computed, with the reasons.
    seconds : dict of str to float
        Time per stage, when it was computed.
    loaded : tuple of str
        Stages that earlier runs had computed.
    versions : dict of str to str
        Versions of Python and of the packages that computed.
    """

    failures: tuple[Failure, ...]
    seconds: dict[str, float]
    loaded: tuple[str, ...]
    versions: dict[str, str]

    @property
    def reasons(self) -> dict[str, str]:
        """Reason of each failure, by the name of what failed."""
        return {failure.name: failure.reason for failure in self.failures}

    @property
    def total_seconds(self) -> float:
        """Sum of the times of all stages, some of which ran side by side."""
        return sum(self.seconds.values())
