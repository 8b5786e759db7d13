"""Which visits come next: positions, torques and periods, in an order with free moves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from estimators.fitting.priors import Prior
from oed.campaign.checks import LOW_LEVEL
from oed.campaign.estimate import Estimate
from oed.campaign.outlook import Forecast
from oed.campaign.settings import VisitSettings
from oed.campaign.visit_plan import (
    fair_torques,
    line_grid,
    motion_levels,
    torque_phases,
    visit_plan,
    with_relative_phases,
)
from oed.criteria.targets import TargetCriterion
from oed.design.optimal_spectra import optimal_spectra
from oed.exact.visit_plan import VisitPlan, fastest_visit_plan, visit_plan as plan_within
from oed.experiment.amplitude_scaling import Scaling
from oed.experiment.experiment_plan import FALL, ExperimentPlan
from oed.experiment.moves import move_times
from oed.experiment.multisine import Multisine
from oed.experiment.prepare import move_limits
from oed.experiment.visiting_order import visiting_order
from oed.information_sets.excitations import Excitation, UserSpectrum, VisitTiming, Zippered
from oed.information_sets.experiment_candidates import ExperimentCandidates, experiment_candidates
from robotmodels import ElasticRobot
from robotmodels.collision.free_moves import contacts, free_moves, swing_contact
from robotmodels.collision.surroundings import Surroundings
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import InvalidInput
from robotmodels.exports.robot_files import with_values
from robotmodels.linear.noise import ErrorCovariance, OutputErrors
from robotmodels.linear.response import Elastic

_SAMPLE = 16
"""Positions whose median torques stand for all in a plan."""

_FIRST_SHARE, FEWEST = 0.15, 2
"""Of the expected time, before any fit; visits at least."""

_FIRST_PERIODS = 2

_MOST_VISITS = 10
"""Until plans are made anew by what was measured."""

_COARSE = 1e-2
"""Gap of spectra, which are rounded to runs and periods anyway."""

_FLOOR = 1e-2
"""Power of lines that are not to be shaken, in parts of the largest over their number."""

GAIN = 4.0
"""Times as fast as flat spectra, roughly: what is known weighs so much more beside them."""

_Choice = tuple[Array, Excitation, int]
"""Position, excitation and periods of a visit."""


@dataclass(frozen=True, eq=False)
class Planner:
    """Plans of a campaign's visits.

    Attributes
    ----------
    settings : VisitSettings
        Lines, limits, moves and controller.
    robot : ElasticRobot
        The robot as it is known now.
    positions : ndarray, (Q, n), rad
        Candidates.
    surroundings : Surroundings or None
        What moves must not touch.
    stage : int
        Number of visits before, which phases are drawn by.
    at : ndarray or None, (n,), rad
        Where the robot is.
    """

    settings: VisitSettings
    robot: ElasticRobot
    positions: Array
    surroundings: Surroundings | None
    stage: int
    at: Array | None

    def check(self) -> list[ExperimentPlan]:
        """Return a visit at a low level, in the position nearest to the middle of the ranges."""
        limits = self.robot.position_limits
        middle, width = limits.mean(axis=1), np.ptp(limits, axis=1)
        nearest = np.argsort((((self.positions - middle) / width) ** 2).sum(axis=1))
        return self.plans([(self.positions[nearest[0]], Zippered(), _FIRST_PERIODS)], LOW_LEVEL)

    def expectation(
        self, noise: ComplexArray, prior: Prior, targets: Mapping[str, float]
    ) -> Forecast:
        """Return what flat spectra bring at the guesses.

        Parameters
        ----------
        noise : ndarray of complex, (F, m + n, m + n)
            Covariance of outputs and torques, of one period.
        prior : Prior
            How far the guesses may be off.
        targets : mapping of str to float
            As of `TargetCriterion`.
        """
        candidates = self.candidates(_errors(noise), [_FIRST_PERIODS], self.positions, [Zippered()])
        return Forecast.of(candidates, targets, prior.information(self.robot.parameters.names))

    def first(self, forecast: Forecast, minutes: float) -> list[ExperimentPlan]:
        """Return visits before any fit: flat spectra, D-optimal at the guesses."""
        candidates = forecast.candidates
        expected = min(forecast.relaxed.time, 60 * minutes)
        time = max(_FIRST_SHARE * expected, FEWEST * float(candidates.duration.min()))
        return self.plans(visits_of(plan_within(candidates, time, "D", forecast.information)))

    def forecast(self, latest: Estimate, targets: Mapping[str, float], minutes: float) -> Forecast:
        """Return what visits bring after a fit: designed spectra where that pays, or must.

        Flat ones do for few visits within the `minutes` left.
        """
        information = np.asarray(np.linalg.inv(latest.covariance), dtype=float)
        counts = self.settings.period_counts
        flat = self.candidates(_errors(latest.noise), counts, self.positions, [Zippered()])
        forecast = Forecast.of(flat, targets, information)
        if forecast.relaxed.time < min(_MOST_VISITS * flat.duration.min(), 60 * minutes):
            return forecast
        coloured = self._coloured(forecast, latest.noise, counts)
        return Forecast.of(coloured, targets, information)

    def accuracy(self, forecast: Forecast, minutes: float) -> list[ExperimentPlan]:
        """Return visits that reach the targets in little time; none if the minutes allow none.

        Where the minutes do not suffice, or many visits are needed, those that fit the time of ten
        long ones and bring the targets nearest.
        """
        candidates, targets = forecast.candidates, forecast.targets
        most = min(_MOST_VISITS * float(candidates.duration.max()), 60 * minutes)
        if candidates.duration.min() > most:
            return []
        if forecast.relaxed.time < most:
            plan = fastest_visit_plan(candidates, targets, forecast.information, forecast.relaxed)
            if plan.duration <= most:
                return self.plans(visits_of(plan))
        plan = plan_within(candidates, most, TargetCriterion(targets), forecast.information)
        return self.plans(visits_of(plan))

    def repeated(self, plan: ExperimentPlan) -> list[ExperimentPlan]:
        """Return an earlier visit once more, from where the robot is now."""
        self._check_move(self.at, plan.positions[0])
        return [replace(plan, start=self.at)]

    def _coloured(
        self, flat: Forecast, noise: ComplexArray, periods: list[int]
    ) -> ExperimentCandidates:
        """Return candidates with designed spectra in the positions that flat ones use at best."""
        relaxed = flat.relaxed
        positions = np.unique(relaxed.support % len(self.positions))
        weights = relaxed.weights.reshape(len(periods), -1) * np.array(periods)[:, None]
        speed, swing = motion_levels(self.settings, self.robot)
        design = optimal_spectra(
            self.robot,
            self.positions[positions],
            self.grid.omega,
            _errors(noise),
            self.levels,
            speed=speed,
            swing=swing,
            criterion=TargetCriterion(flat.targets),
            prior=flat.information * (GAIN / weights.sum()),
            tolerance=_COARSE,
        )
        excitations: list[Excitation] = [Zippered(), *design.excitations]
        return self.candidates(_errors(noise), periods, design.positions, excitations)

    @cached_property
    def grid(self) -> Multisine:
        """Lines of every run."""
        return line_grid(self.settings, len(self.robot.motor_names))

    @cached_property
    def levels(self) -> Array:
        """Root mean square torques, the median of some positions, (n,) [N m]."""
        owners = Zippered().owners(self.grid.inputs, len(self.grid.lines))
        each = [
            fair_torques(self.settings, self.robot, q, owners / owners.sum(axis=0))
            for q in self._some
        ]
        return np.asarray(np.median(each, axis=0))

    @cached_property
    def _some(self) -> Array:
        """Some candidates that stand for all."""
        rng = np.random.default_rng([self.settings.seed, self.stage])
        count = min(_SAMPLE, len(self.positions))
        return self.positions[rng.choice(len(self.positions), count, replace=False)]

    @property
    def shortest(self) -> float:
        """Duration of the shortest visit before a fit, its move left out [s]."""
        periods = self.settings.transient_periods + FALL + _FIRST_PERIODS
        return self.settings.settle + periods * self.grid.period

    @cached_property
    def _timing(self) -> VisitTiming:
        settings, moves = self.settings, move_limits(self.settings, self.robot)
        return VisitTiming(
            period=self.grid.period,
            transient=(settings.transient_periods + FALL) * self.grid.period,
            settle=settings.settle,
            move=float(move_times(self._some, self._some, moves).mean()),
        )

    def candidates(
        self,
        noise: OutputErrors,
        periods: Sequence[int],
        positions: Array,
        excitations: Sequence[str | Excitation],
        robots: Sequence[Elastic] = (),
    ) -> ExperimentCandidates:
        """Return visits at typical torques, of the robot or of samples of it."""
        tables = [
            experiment_candidates(
                robot,
                positions,
                excitations,
                self.grid.omega,
                noise,
                torque=self.levels,
                periods=periods,
                timing=self._timing,
            )
            for robot in robots or (self.robot,)
        ]
        return tables[0] if len(tables) == 1 else ExperimentCandidates.of_samples(tables)

    def plans(self, visits: list[_Choice], part: float = 1.0) -> list[ExperimentPlan]:
        """Return plans in order, see `ordered_plans`."""
        return [plan for _, plan in self.ordered_plans(visits, part)]

    def ordered_plans(
        self, visits: list[_Choice], part: float = 1.0
    ) -> list[tuple[str, ExperimentPlan]]:
        """Return the excitations' names and the plans of visits.

        Their order is that of the shortest moves, all of them straight and free.
        """
        at, plans = self.at, list[tuple[str, ExperimentPlan]]()
        for position, excitation, periods in self._ordered(visits):
            self._check_move(at, position)
            power = self._powers(excitation)
            level = fair_torques(self.settings, self.robot, position, power)
            rng = np.random.default_rng([self.settings.seed, self.stage + len(plans), 1])
            torques = torque_phases(self.grid, np.sqrt(2 * power) * level, rng)
            if isinstance(excitation, UserSpectrum):
                torques = with_relative_phases(torques, excitation.matrices)
            runs = excitation.runs(self.grid.inputs)
            scaled = visit_plan(
                self.settings, self.robot, position, torques, periods, at, part, runs
            )
            self._check_swing(position, scaled)
            plans.append((excitation.name, scaled.plan))
            at = position
        return plans

    def _check_swing(self, position: Array, scaled: Scaling) -> None:
        """Refuse a visit in which the excitation would make something touch."""
        pair = swing_contact(self.surroundings, position, *scaled.peaks.swing[0, 2].T)
        if pair is not None:
            raise InvalidInput(
                f"visit to {np.round(position, 3).tolist()}: {pair} would touch within its swing; "
                "it is not offered: state limits.swing, so that candidates have room for it, or "
                "raise candidates.margin"
            )

    def _powers(self, excitation: Excitation) -> Array:
        """Return the share of each motor's power on each line, (F, n); no line is left out."""
        lines = len(self.grid.lines)
        power = np.einsum("fii->fi", excitation.spectrum(self.levels, lines)).real
        power = power / self.levels**2
        power = np.maximum(power, _FLOOR * power.max() / lines)
        return np.asarray(power / power.sum(axis=0))

    def _ordered(self, visits: list[_Choice]) -> list[_Choice]:
        """Return visits in the order of the shortest moves."""
        if not visits:
            return []
        positions = np.array([position for position, _, _ in visits])
        limits = move_limits(self.settings, self.robot)
        free = partial(free_moves, self.surroundings)
        return [visits[i] for i in visiting_order(positions, limits, self.at, free=free).order]

    def _check_move(self, at: Array | None, goal: Array) -> None:
        """Refuse a straight move on which something touches."""
        if at is not None and (pair := contacts(self.surroundings, at, goal)[0]) is not None:
            raise InvalidInput(
                f"moves: no order of the planned positions has free moves, from "
                f"{np.round(at, 3).tolist()} to {np.round(goal, 3).tolist()} {pair} would touch; "
                "add candidates between, or clear the way"
            )


def visits_of(plan: VisitPlan) -> list[_Choice]:
    """Return the visits of a plan."""
    candidates = plan.candidates
    by_name = {one.name: one for one in candidates.excitations}
    return [(candidates.positions[q], by_name[name], count) for q, name, count in plan.visits]


def _errors(noise: ComplexArray) -> ErrorCovariance:
    """Return covariances of `RunSpectra`, of half amplitudes, as those of mean squares."""
    return ErrorCovariance(2 * noise)


def known_now(robot: ElasticRobot, latest: Estimate | None) -> ElasticRobot:
    """Return the robot with the values of an estimate, the guesses before the first."""
    if latest is None:
        return robot
    fitted = with_values(robot, latest.values, None)
    return replace(fitted, file=fitted.file.model_copy(update={"guessed": {}}))
