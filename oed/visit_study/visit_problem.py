"""What a study of visits chooses from, and the best of it as it is to be run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from oed.campaign.visit_plan import motion_levels, visit_spectrum
from oed.campaign.visit_planner import VisitPlanner, visits_of
from oed.criteria.criteria import Criterion
from oed.criteria.targets import TargetCriterion
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

_HOPELESS = 6.0
"""Times the time allowed: visits as written never have so much more information than planned."""

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


class _Attempt(NamedTuple):
    """A plan as written: by how much it misses the targets, its time, and as of `plan`."""

    missed: float
    duration: float
    excess: float
    plan: VisitPlan
    visits: tuple[StudyVisit, ...]
    std: Array


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
        targets = self.study.design.targets
        return self.study.design.criterion if targets is None else self.targeted(targets, share)

    def targeted(self, targets: Mapping[str, float], share: float) -> TargetCriterion:
        """Return the accuracy to a share of targets."""
        closer = {name: share * target for name, target in targets.items()}
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
        share, attempts = 1.0, list[_Attempt]()
        for _ in range(_TRIES):
            plan, excess = self.plan(table, share)
            if excess > _HOPELESS:
                refusal = self._out_of_reach(table, share, self.planned(plan), targets)
                raise InvalidInput(refusal)
            visits = self.visits(plan)
            std = self.deviations(visits)
            missed = _largest(over_samples(std, self.kind) / targets)
            attempts.append(_Attempt(max(missed, 1.0), plan.duration, excess, plan, visits, std))
            if missed == 0.0 or _CLOSE <= missed <= 1.0 or (excess and len(attempts) > 1):
                break
            share = _largest(self.planned(plan) / targets) / (_CLOSER * missed)
        best = min(attempts, key=lambda attempt: attempt[:2])
        if best.missed > 1.0 and best.excess:
            overall = over_samples(best.std, self.kind)
            raise InvalidInput(self._out_of_reach(table, share, overall, targets))
        return best.plan, best.visits, best.std

    def planned(self, plan: VisitPlan) -> Array:
        """Return the standard deviations of a plan at typical torques, over samples, (p,)."""
        p = len(plan.candidates.information.names)
        parts = [standard_deviations(one) for one in plan.information.reshape(-1, p, p)]
        return over_samples(np.array(parts), self.kind)

    def plan(self, table: ExperimentCandidates, share: float) -> tuple[VisitPlan, float]:
        """Return the best visits to this share of the targets, and zero.

        Where they take too long, the best within the time, and how many times that is needed.
        """
        most = _time_allowed(self.study.design, table)
        criterion = self.criterion(share)
        if not isinstance(criterion, TargetCriterion):
            return self.within(table, most), 0.0
        needed = self._needed(table, criterion)
        if needed <= most:
            plan = fastest_visit_plan(table, criterion)
            if plan.duration <= most:
                return plan, 0.0
        return self.within(table, most), max(needed / most, 1.0)

    def _needed(self, table: ExperimentCandidates, criterion: TargetCriterion) -> float:
        """Return a time that no visits to targets go below [s]."""
        info = table.information
        return fastest_design(info, table.duration, criterion, tolerance=_TIME_GAP).bound

    def _out_of_reach(
        self, table: ExperimentCandidates, share: float, std: Array, targets: Array
    ) -> str:
        """Return what is feasible, std (p,), where targets need too long a time."""
        design = self.study.design
        needed = self._needed(table, self.targeted(design.targets or {}, share)) / 60
        names, worst = table.information.names, int(np.nanargmax(std / targets))
        allowed = "and design.minutes allows " if design.minutes else "and visits are planned for "
        minutes = design.minutes or _longest(table) / 60
        return (
            f"design.targets: about {needed:.3g} min are needed, {allowed}{minutes:.3g}; the best "
            f"within them is {_largest(std / targets):.2g} times the targets, {names[worst]} at "
            f"{std[worst]:.2g}"
        )

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
        """Return the standard deviations predicted for visits at each sample of theta, (K, p)."""
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


def _largest(ratios: Array) -> float:
    """Return the largest of some ratios; zero where none is a number."""
    return float(np.max(ratios, initial=0.0, where=~np.isnan(ratios)))
