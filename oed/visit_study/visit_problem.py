"""What a study of visits chooses from, and the best of it as it is to be run."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from oed.campaign.visit_plan import motion_levels, visit_spectrum
from oed.campaign.visit_planner import VisitPlanner, visits_of
from oed.criteria.criteria import Criterion
from oed.criteria.targets import TargetCriterion, by_name_or_kind
from oed.design.fastest_design import fastest_design
from oed.design.optimal_spectra import SpectraDesign, optimal_spectra
from oed.exact.plan_score import standard_deviations
from oed.exact.visit_plan import (
    TimeCurve,
    VisitPlan,
    fastest_visit_plan,
    time_curve,
    visit_plan,
)
from oed.experiment.experiment_plan import ExperimentPlan
from oed.experiment.prepare import controller_of
from oed.information_sets.compute import information
from oed.information_sets.excitations import Excitation
from oed.information_sets.experiment_candidates import ExperimentCandidates
from oed.visit_study.study_file import VisitDesignChoice, VisitStudy
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import InvalidInput
from robotmodels.linear.noise import ExcitationNoise, InputOutputNoise
from robotmodels.linear.response import Elastic

_SPECTRA_GAP = 1e-4
"""Of spectra: runs and whole periods cost far more."""

_LEAST_SHARE = 1e-3
"""Of the largest share of a position whose spectra are offered."""

_TRIES, _CLOSE, _CLOSER = 4, 0.9, 1.02
"""Plans to targets at most; targets are reached and little more; by how much closer ones."""

_TIME_GAP = 1e-3
"""Of the least time to targets, before whole visits are searched."""

_MOST_VISITS = 100
"""Of the longest kind: the most time that is planned."""

_CURVE = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Times of the curve where the study names none, in parts of the plan's."""


@dataclass(frozen=True, eq=False)
class StudyVisit:
    """A visit of a plan, with the spectra that its torques will have.

    Attributes
    ----------
    excitation : str
        Name of its excitation.
    plan : ExperimentPlan
        Where to go and what the motors are told.
    spectrum : ndarray of complex, (F, n, n), N^2 m^2
        Phi of all its runs, by the linear loop.
    """

    excitation: str
    plan: ExperimentPlan
    spectrum: ComplexArray


@dataclass(frozen=True, eq=False)
class VisitProblem:
    """A study with its candidates, samples of theta and noise."""

    study: VisitStudy
    planner: VisitPlanner
    robots: tuple[Elastic, ...]
    noise: InputOutputNoise

    @property
    def kind(self) -> str:
        """How samples of theta count."""
        robust = self.study.design.robust
        return "average" if robust is None else robust.kind

    def criterion(self, share: float = 1.0) -> str | Criterion:
        """Return what visits within a time maximise; the accuracy to a share of the targets."""
        design = self.study.design
        if design.targets is None:
            return design.criterion
        closer = {name: share * target for name, target in design.targets.items()}
        return TargetCriterion(closer, kind=self.kind)

    def within(self, table: ExperimentCandidates, time: float) -> VisitPlan:
        """Return the best visits within a time [s]."""
        return visit_plan(table, time, self.criterion(), kind=self._outer_kind)

    @property
    def _outer_kind(self) -> str:
        """How samples count in plans; targets do that by themselves."""
        return "average" if self.study.design.targets else self.kind

    def spectra(self) -> SpectraDesign | None:
        """Return the best spectra over all positions; None where flat ones are asked for."""
        design, planner = self.study.design, self.planner
        if design.spectra == "flat":
            return None
        speed, swing = motion_levels(self.study, planner.robot)
        return optimal_spectra(
            self.robots,
            planner.positions,
            planner.grid.omega,
            self.noise,
            planner.levels,
            speed=speed,
            swing=swing,
            full=design.spectra == "full",
            line_cap=design.line_cap,
            criterion=self.criterion(),
            kind=self._outer_kind,
            tolerance=_SPECTRA_GAP,
        )

    def table(self, spectra: SpectraDesign | None) -> ExperimentCandidates:
        """Return the visits to choose from, with designed spectra in their positions."""
        excitations: list[str | Excitation] = list(self.study.design.excitations)
        positions = self.planner.positions
        if spectra is not None:
            used = np.flatnonzero(spectra.weights > _LEAST_SHARE * spectra.weights.max())
            designed = [spectra.excitations[i] for i in used]
            excitations += [replace(one, name=f"spectra {i + 1}") for i, one in enumerate(designed)]
            positions = spectra.positions[used]
        counts = self.study.period_counts
        return self.planner.candidates(self.noise, counts, positions, excitations, self.robots)

    def reached(
        self, table: ExperimentCandidates, targets: Array
    ) -> tuple[VisitPlan, tuple[StudyVisit, ...], Array]:
        """Return a plan, its visits and their standard deviations.

        Plans are of typical torques, visits of those that limits leave. So the accuracy that plans
        are to reach is set by that of the visits, until these reach the targets and little more.
        """
        share, attempts = 1.0, []
        for _ in range(_TRIES):
            plan = self.plan(table, share)
            visits = self.visits(plan)
            std = self.deviations(visits)
            ratios = over_samples(std, self.kind) / targets
            missed = float(np.max(ratios, initial=0.0, where=~np.isnan(ratios)))
            attempts.append((missed > 1.0, plan.duration, plan, visits, std))
            if missed == 0.0 or _CLOSE <= missed <= 1.0:
                break
            share /= _CLOSER * missed
        _, _, plan, visits, std = min(attempts, key=lambda attempt: attempt[:2])
        return plan, visits, std

    def plan(self, table: ExperimentCandidates, share: float) -> VisitPlan:
        """Return the best visits, to this share of the targets, or refuse with what is feasible."""
        design = self.study.design
        most = _time_allowed(design, table)
        criterion = self.criterion(share)
        if not isinstance(criterion, TargetCriterion):
            return self.within(table, most)
        info = table.information
        needed = fastest_design(info, table.duration, criterion, tolerance=_TIME_GAP).bound
        if needed <= most:
            plan = fastest_visit_plan(table, criterion)
            if plan.duration <= most:
                return plan
        best = self.within(table, most)
        if share < 1.0:  # at typical torques the targets are reached, by these visits nearly so
            return best
        p = len(info.names)
        std = [standard_deviations(one) for one in best.information.reshape(-1, p, p)]
        reached = over_samples(np.array(std), self.kind)
        raise InvalidInput(_out_of_reach(needed, best, reached, design))

    def curve(self, table: ExperimentCandidates, plan: VisitPlan) -> TimeCurve:
        """Return the plans of other times."""
        times = [60 * minutes for minutes in self.study.design.curve]
        times = times or [share * plan.duration for share in _CURVE]
        low, high = float(table.duration.min()), _longest(table)
        times = [min(max(time, low), high) for time in times]
        return time_curve(table, times, self.criterion(), kind=self._outer_kind)

    def visits(self, plan: VisitPlan) -> tuple[StudyVisit, ...]:
        """Return the visits of a plan as they are to be run."""
        robot = self.planner.robot
        controller = controller_of(self.study, robot)
        return tuple(
            StudyVisit(name, one, visit_spectrum(one, robot, controller))
            for name, one in self.planner.ordered_plans(visits_of(plan))
        )

    def deviations(self, visits: Sequence[StudyVisit]) -> Array:
        """Return the standard deviations that visits promise at each sample of theta, (K, p)."""
        rows = []
        for robot in self.robots:
            parts = [one.plan.periods * self._information(robot, one) for one in visits]
            rows.append(standard_deviations(np.sum(parts, axis=0)))
        return np.array(rows)

    def _information(self, robot: Elastic, visit: StudyVisit) -> Array:
        law = ExcitationNoise(visit.spectrum, self.noise)
        omega = visit.plan.multisine.omega
        return np.asarray(information(robot, visit.plan.positions, omega, law).matrices[0])


def over_samples(std: Array, kind: str) -> Array:
    """Return standard deviations (K, p) at worst over samples of theta, or their mean, (p,)."""
    return np.asarray(std.max(axis=0) if kind == "maximin" else np.exp(np.log(std).mean(axis=0)))


def _longest(table: ExperimentCandidates) -> float:
    """Return the longest time that is planned [s]: that of many visits of the longest kind."""
    return _MOST_VISITS * float(table.duration.max())


def _time_allowed(design: VisitDesignChoice, table: ExperimentCandidates) -> float:
    """Return the time of all visits [s].

    Raises
    ------
    InvalidInput
        If the minutes suffice for no visit, or for more than are planned.
    """
    if design.minutes is None:
        return _longest(table)
    time, shortest = 60 * design.minutes, float(table.duration.min())
    if time < shortest:
        raise InvalidInput(
            f"design.minutes: {design.minutes:g} min; the shortest visit takes "
            f"{shortest / 60:.2g} min"
        )
    if time > _longest(table):
        raise InvalidInput(
            f"design.minutes: {design.minutes:g} min; at most {_longest(table) / 60:.3g} are "
            f"planned, {_MOST_VISITS} of the longest visits; a larger most_periods allows more"
        )
    return time


def _out_of_reach(needed: float, best: VisitPlan, std: Array, design: VisitDesignChoice) -> str:
    """Return what is feasible, std (p,), where targets need too long a time [s]."""
    names = best.candidates.information.names
    asked = by_name_or_kind(design.targets or {}, names, "design.targets")
    worst = int(np.nanargmax(std / asked))
    allowed = "and design.minutes allows " if design.minutes else "and visits are planned for "
    minutes = design.minutes or _longest(best.candidates) / 60
    return (
        f"design.targets: {needed / 60:.3g} min of typical torques are needed at least, more in "
        f"whole visits, {allowed}{minutes:.3g}; the best within them is "
        f"{std[worst] / asked[worst]:.2g} times the targets, {names[worst]} at {std[worst]:.2g}"
    )
