"""Where the data of a study come from: its stages up to the data, and what they alone can tell.

A study is a `SimulatedStudy`, which chooses its positions and simulates its data, or a
`MeasuredStudy`, whose data and positions are in a file.
"""

from dataclasses import dataclass, replace
from pathlib import Path

from estimators.uncertainty.covariance import Uncertainty
from oed.candidates.screening import ScreenedCandidates
from oed.information_sets.information_set import InformationSet
from oed.plan_comparison.plan_comparison import PlanComparison
from oed.study.parts import DesignedPlan, MeasuredData, MeasuredPlan, SimulatedData
from oed.study.stage_cache import Stage
from oed.study.stages.assumed_springs import AssumedSprings, assumed_springs
from oed.study.stages.candidates import candidates
from oed.study.stages.comparison import check_comparison, comparison
from oed.study.stages.data import (
    Data,
    data_by_noise_law,
    data_from_records,
    measured_data,
    recorded_time,
)
from oed.study.stages.design import StudyDesign, design, measured_design, visits
from oed.study.stages.experiment import SimulatedExperiment, experiment, runs_of_block
from oed.study.stages.few_data import warn_of_few_frequencies, warn_of_weak_combinations
from oed.study.stages.information import (
    Information,
    information,
    measured_information,
    sampled_information,
    structure_information,
)
from oed.study.stages.result import SelectedFit
from oed.study.stages.run import MeasuredRun, SimulatedRun
from oed.study.stages.uncertainty import needed
from oed.study.stages.validation import HeldOut, Split, measured_validation, split, validation
from robotmodels import Records, at_recorded_speeds


@dataclass(frozen=True, eq=False)
class SimulatedDesign:
    """The stages that say where to measure, finished."""

    run: SimulatedRun
    candidates: Stage[ScreenedCandidates]
    information: Stage[Information]
    design: Stage[StudyDesign]
    assumed: Stage[AssumedSprings] | None

    @classmethod
    def of(cls, run: SimulatedRun) -> "SimulatedDesign":
        """Run the stages, after a check of those that come late.

        Raises
        ------
        InvalidInput
            If plans cannot be compared as the study asks, or FRFs need more runs.
        """
        check_comparison(run)
        warn_of_few_frequencies(run, run.omega, runs_of_block(run))
        screened = candidates(run)
        info = information(run, screened)
        samples = sampled_information(run, screened)
        about = structure_information(run, screened) or info
        plan = design(run, about, samples)
        share = runs_of_block(run) / len(run.robot.motor_names)
        assumed = assumed_springs(run, visits(info, plan), share)
        return cls(run, screened, info, plan, assumed)

    @property
    def plan(self) -> DesignedPlan:
        """The plan."""
        stage, excitation = self.design.value, self.run.study.data.experiment
        blocks = 1 if excitation is None else excitation.blocks
        motors, runs = len(self.run.robot.motor_names), runs_of_block(self.run)
        return DesignedPlan(
            information=self.information.value,
            design=stage.design,
            exact=stage.exact,
            used=stage.used,
            omega=self.run.omega,
            runs_per_visit=blocks * runs,
            visit_share=runs / motors,
            candidates=self.candidates.value,
            robust=stage.robust,
            order=stage.order,
            powers=() if self.assumed is None else self.assumed.value.powers,
        )


@dataclass(frozen=True, eq=False)
class SimulatedStudy(SimulatedDesign):
    """The stages up to the data, finished."""

    experiment: Stage[SimulatedExperiment] | None
    data: Stage[Data]

    @classmethod
    def of(cls, run: SimulatedRun) -> "SimulatedStudy":
        """Run the stages."""
        before = SimulatedDesign.of(run)
        warn_of_weak_combinations(before.plan.predicted)
        asked, excitation = visits(before.information, before.design), run.study.data.experiment
        simulated = None if excitation is None else experiment(run, excitation, asked)
        if simulated is None:
            data = data_by_noise_law(run, asked)
        else:
            run = _at_simulated_speeds(run, simulated.value.records)
            data = data_from_records(run, simulated.value.records, simulated.digest)
        finished = before.candidates, before.information, before.design, before.assumed
        return cls(run, *finished, simulated, data)

    @property
    def results_data(self) -> SimulatedData:
        """The data."""
        data, simulated = self.data.value, self.experiment
        return SimulatedData(
            estimate=data.estimate,
            distortion=data.distortion,
            warnings=data.warnings,
            plant=self.run.plant,
            experiment=None if simulated is None else simulated.value,
        )

    def comparison(self) -> Stage[PlanComparison] | None:
        """Return the plan beside alternatives; None where the study does not ask for it."""
        if not self.run.study.compares:
            return None
        return comparison(self.run, self.information, self.design)

    def validation(
        self, result: Stage[SelectedFit], theorem1: Stage[Uncertainty] | None
    ) -> Stage[HeldOut] | None:
        """Return predictions of candidates that the plan leaves out; None if not asked for."""
        choice = self.run.study.validation
        if choice is None or choice.count is None:
            return None
        plan = self.information, self.design
        return validation(self.run, choice.count, *plan, result, needed(theorem1))


def _at_simulated_speeds(run: SimulatedRun, records: Path) -> SimulatedRun:
    """Return the run whose robot counts Coulomb friction as dampers, if the study asks for it."""
    if run.study.data.coulomb_speeds != "data":
        return run
    return replace(run, robot=at_recorded_speeds(run.robot, Records.load(records)))


@dataclass(frozen=True, eq=False)
class MeasuredStudy:
    """The stages up to the data, finished; `data` are those that are fitted."""

    run: MeasuredRun
    split: Stage[Split] | None
    data: Stage[Data]
    information: Stage[InformationSet]
    design: Stage[StudyDesign]

    @classmethod
    def of(cls, run: MeasuredRun) -> "MeasuredStudy":
        """Run the stages."""
        data, choice = measured_data(run), run.study.validation
        parts = None if choice is None else split(run, choice, data)
        if parts is not None:
            data = Stage(data.name, parts.value.fitted, parts.digest, parts.seconds, parts.loaded)
        warn_of_few_frequencies(run, data.value.estimate.omega, data.value.columns)
        info = measured_information(run, data)
        study = cls(run, parts, data, info, measured_design(run, info, data))
        warn_of_weak_combinations(study.plan.predicted)
        return study

    @property
    def plan(self) -> MeasuredPlan:
        """The positions of the data."""
        stage = self.design.value
        return MeasuredPlan(
            information=self.information.value,
            design=stage.design,
            exact=stage.exact,
            used=stage.used,
            omega=self.data.value.estimate.omega,
            runs_per_visit=self.data.value.columns,
            visit_share=1.0,
        )

    @property
    def results_data(self) -> MeasuredData:
        """The data."""
        data = self.data.value
        seconds = recorded_time(self.run)
        return MeasuredData(data.estimate, data.distortion, data.warnings, seconds)

    def comparison(self) -> Stage[PlanComparison] | None:
        """Return None: plans are compared where data are simulated."""
        return None

    def validation(
        self, result: Stage[SelectedFit], theorem1: Stage[Uncertainty] | None
    ) -> Stage[HeldOut] | None:
        """Return predictions in the validation positions; None if not asked for."""
        if self.split is None:
            return None
        return measured_validation(self.run, self.split, result, needed(theorem1))
