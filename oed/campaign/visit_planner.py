"""Visits that could be made, and plans of some of them, in an order with free moves."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from oed.campaign.settings import VisitSettings
from oed.campaign.visit_plan import (
    fair_torques,
    line_grid,
    torque_phases,
    visit_plan,
    with_relative_phases,
)
from oed.exact.visit_plan import VisitPlan
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
from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.linear.noise import OutputErrors
from robotmodels.linear.response import Elastic

_SAMPLE = 16
"""Positions whose median torques stand for all in a plan."""

_FLOOR = 1e-2
"""Power of lines that are not to be shaken, in parts of the largest over their number."""

Choice = tuple[Array, Excitation, int]
"""Position, excitation and periods of a visit."""


@dataclass(frozen=True, eq=False)
class VisitPlanner:
    """Visits to candidate positions: what they could be, and how they are run.

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

    def plans(self, visits: list[Choice], part: float = 1.0) -> list[ExperimentPlan]:
        """Return plans in order, see `ordered_plans`."""
        return [plan for _, plan in self.ordered_plans(visits, part)]

    def ordered_plans(
        self, visits: list[Choice], part: float = 1.0
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

    def _ordered(self, visits: list[Choice]) -> list[Choice]:
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
                "add candidates between, or remove the obstacle"
            )


def visits_of(plan: VisitPlan) -> list[Choice]:
    """Return the visits of a plan."""
    candidates = plan.candidates
    by_name = {one.name: one for one in candidates.excitations}
    return [(candidates.positions[q], by_name[name], count) for q, name, count in plan.visits]
