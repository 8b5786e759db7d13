"""Which visits come next: positions, torques and periods, in an order with free moves."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from estimators.fitting.priors import Prior
from oed.campaign.checks import LOW_LEVEL
from oed.campaign.estimate import Estimate
from oed.campaign.outlook import Forecast
from oed.campaign.visit_plan import motion_levels
from oed.campaign.visit_planner import VisitPlanner, visits_of
from oed.criteria.targets import TargetCriterion
from oed.design.optimal_spectra import optimal_spectra
from oed.exact.visit_plan import fastest_visit_plan, visit_plan as plan_within
from oed.experiment.experiment_plan import FALL, ExperimentPlan
from oed.information_sets.excitations import Excitation, Zippered
from oed.information_sets.experiment_candidates import ExperimentCandidates
from robotmodels import ElasticRobot
from robotmodels.common.arrays import ComplexArray
from robotmodels.exports.robot_files import with_friction, with_values
from robotmodels.linear.noise import ErrorCovariance

_FIRST_SHARE, FEWEST = 0.15, 2
"""Of the expected time, before any fit; visits at least."""

_FIRST_PERIODS = 2

_MOST_VISITS = 10
"""Until plans are made anew by what was measured."""

_COARSE = 1e-2
"""Gap of spectra, which are rounded to runs and periods anyway."""

GAIN = 4.0
"""Times as fast as flat spectra, roughly: what is known weighs so much more beside them."""


class Planner(VisitPlanner):
    """Plans of a campaign's visits, see `VisitPlanner`."""

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

    @property
    def shortest(self) -> float:
        """Duration of the shortest visit before a fit, its move left out [s]."""
        periods = self.settings.transient_periods + FALL + _FIRST_PERIODS
        return self.settings.settle + periods * self.grid.period


def _errors(noise: ComplexArray) -> ErrorCovariance:
    """Return covariances of `RunSpectra`, of half amplitudes, as those of mean squares."""
    return ErrorCovariance(2 * noise)


def known_now(robot: ElasticRobot, latest: Estimate | None) -> ElasticRobot:
    """Return the robot with the values of an estimate, the guesses before the first.

    Its friction, beside which limits have room, is the highest of a visit and two standard
    deviations more.
    """
    if latest is None:
        return robot
    fitted = with_values(robot, latest.values, None)
    if not latest.friction:
        return fitted
    return with_friction(fitted, np.array([one.highest + 2 * one.std for one in latest.friction]))
