"""Peaks of torque, speed and position that the linear model predicts under feedback.

A reference with the DFT R gives the torque U = (I + F_y G_y)^-1 F_r R and the angle Y = G_y U.
These make the peaks of the steady state; the start from rest is followed sample by sample, as a
motor that hardly works in the steady state can meet its largest torque in the transient.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from oed.experiment.experiment_plan import ExperimentPlan
from robotmodels.common.arrays import Array, ComplexArray, read_only
from robotmodels.common.deprecation import renamed_attributes
from robotmodels.common.errors import InvalidInput
from robotmodels.elastic.rigid_pose import holding_torques
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.linear.linear_model import LinearModel
from robotmodels.linear.response import Elastic
from robotmodels.simulation.controller import Controller
from robotmodels.simulation.discrete_loop import SampledLoop, sampled_loop
from robotmodels.simulation.loop_noise import closed_loop

# Points per period of the highest line at which peaks of speeds and angles are sought.
_POINTS = 24
# So long is the start of a run followed [s], in whole periods.
_START = 2.0
# Poles at one belong to motors without position loop or integral part, computed to rounding.
_LARGEST_POLE = 1 + 1e-6


@renamed_attributes("0.2", rest="operating_point")
@dataclass(frozen=True, eq=False)
class Peaks:
    """Lowest and highest predicted values over all blocks and runs of each visit.

    Attributes
    ----------
    operating_point : ndarray, (V, 3, n)
        Holding torque [N m, motor shaft], zero speed, position [rad, arm side].
    swing : ndarray, (V, 3, n, 2)
        Lowest and highest deviation of torque, speed [rad/s, motor shaft] and position from the
        operating point.
    """

    operating_point: Array
    swing: Array

    @property
    def largest(self) -> Array:
        """Largest magnitudes of torque and speed, and of the position's deviation, (V, 3, n)."""
        shift = self.operating_point.copy()
        shift[:, 2] = 0.0
        return np.asarray(np.abs(shift[..., None] + self.swing).max(axis=-1))


@dataclass(frozen=True, eq=False)
class PlannedLoop:
    """The closed loop at a plan's lines.

    Attributes
    ----------
    torque, angle : ndarray of complex, (Q, F, n, n)
        Motor torque [N m] and angle [rad] per speed reference [rad/s].
    ratios : ndarray, (n,)
        Gear ratios.
    operating_point : ndarray, (V, 3, n)
        As in `Peaks`.
    starts : tuple of SampledLoop
        The loop sample by sample, for each position.
    """

    torque: ComplexArray
    angle: ComplexArray
    ratios: Array
    operating_point: Array
    starts: tuple[SampledLoop, ...]

    @classmethod
    def of(
        cls,
        plan: ExperimentPlan,
        robot: Elastic,
        controller: Controller,
        holding: Array | None,
    ) -> "PlannedLoop":
        """Close the loop around the linear models at a plan's positions."""
        sine = plan.multisine
        if not np.isclose(controller.sample_time, sine.sample_time, rtol=1e-9, atol=0):
            raise InvalidInput(
                f"controller: sample time {controller.sample_time:g} s, the plan's signals have "
                f"{sine.sample_time:g} s"
            )
        network = robot.network(plan.positions)
        selector = network.selector
        n = len(plan.motors)
        if selector.shape[1] != n:
            raise InvalidInput(f"robot: {selector.shape[1]} motors; the plan has {n}")
        loop = closed_loop(network, sine.omega, controller)
        torques = _holding(robot, plan.positions) if holding is None else np.asarray(holding)
        if torques.shape != plan.positions.shape:
            raise InvalidInput(f"holding: shape {torques.shape}; {plan.positions.shape} is needed")
        operating_point = np.stack([torques, np.zeros_like(torques), plan.positions], axis=1)[
            plan.visits
        ]
        ratios = selector[np.abs(selector).argmax(axis=0), np.arange(n)]
        model = network.linear_model()
        starts = tuple(
            _stable(model.at(q), controller, f"position {q + 1}")
            for q in range(len(plan.positions))
        )
        return cls(loop.torque, loop.angle, ratios, operating_point, starts)

    def swing(
        self,
        plan: ExperimentPlan,
        amplitudes: Array,
        blocks: int | None = None,
        done: Callable[[], object] | None = None,
    ) -> Array:
        """Return lowest and highest deviations, (V, 3, n, 2), with amplitudes (F, n) >= 0.

        Only the first `blocks` blocks count, all of them by default; `done` is called after each
        visit.
        """
        sine = plan.multisine
        share = (amplitudes / sine.amplitudes)[..., None]
        swings = []
        for visit in range(len(plan.visits)):
            spectrum = sine.spectrum(plan.phases[visit, :blocks])[..., : plan.runs]
            R = plan.scale[visit] * share * spectrum
            steady, start = self.steady(plan, visit, R), self.start(plan, visit, R)
            lowest = np.minimum(steady[..., 0], start[..., 0])
            highest = np.maximum(steady[..., 1], start[..., 1])
            swings.append(np.stack([lowest, highest], axis=-1))
            if done is not None:
                done()
        return np.array(swings)

    def steady(self, plan: ExperimentPlan, visit: int, spectrum: ComplexArray) -> Array:
        """Return the extremes (3, n, 2) that references of a (B, F, n, E) spectrum settle to."""
        sine, q = plan.multisine, plan.visits[visit]
        # A zero-order hold torque has only its sample values; motion varies between them.
        points = sine.samples * int(np.ceil(_POINTS * sine.lines[-1] / sine.samples))
        Y = self.angle[q] @ spectrum
        signals = (
            sine.period_of(self.torque[q] @ spectrum),
            sine.period_of(1j * sine.omega[:, None, None] * Y, points),
            sine.period_of(Y, points) / self.ratios,
        )
        ends = [np.stack([s.min(axis=(0, 1, 2)), s.max(axis=(0, 1, 2))], axis=-1) for s in signals]
        return np.array(ends)

    def start(self, plan: ExperimentPlan, visit: int, spectrum: ComplexArray) -> Array:
        """Return the extremes (3, n, 2) of the first periods, from rest."""
        planned = plan.periods + plan.transient_periods
        periods = min(planned, int(np.ceil(_START / plan.multisine.period)))
        references = plan.multisine.period_of(spectrum)
        runs = references.reshape(-1, *references.shape[-2:])
        signals = np.tile(runs, (1, periods, 1))
        signals[:, : plan.multisine.samples] *= plan.envelope[:, None]
        swing = self.starts[plan.visits[visit]].swing(signals)
        swing[2] = np.sort(swing[2] / self.ratios[:, None], axis=-1)
        return np.asarray(swing)


def predicted_peaks(
    plan: ExperimentPlan,
    robot: Elastic,
    controller: Controller,
    holding: Array | None = None,
) -> Peaks:
    """Return the peaks that the linear model predicts for a plan; arguments as in `oed.scale`.

    Raises
    ------
    InvalidInput
        If controller, robot and plan do not fit each other.
    NoEquilibrium
        If the springs cannot carry the robot's weight in a position.
    """
    loop = PlannedLoop.of(plan, robot, controller, holding)
    return Peaks(
        read_only(loop.operating_point), read_only(loop.swing(plan, plan.multisine.amplitudes))
    )


def _stable(model: LinearModel, controller: Controller, where: str) -> SampledLoop:
    """Return the closed loop around one linear model.

    Raises
    ------
    InvalidInput
        Naming `where`, if it is unstable.
    """
    loop = sampled_loop(model, controller)
    if not loop.largest_pole <= _LARGEST_POLE:
        raise InvalidInput(
            f"controller: its loop is unstable in {where} (a pole of magnitude "
            f"{loop.largest_pole:.4g}); smaller gains, or a shorter sample time, are needed"
        )
    return loop


def _holding(robot: object, positions: Array) -> Array:
    """Return the motor torques that hold a robot's arm, (Q, n)."""
    if not isinstance(robot, ElasticRobot):
        raise InvalidInput(
            "holding: the torques that hold the arm, (Q, n), are needed for a model that is not "
            "an ElasticRobot"
        )
    return holding_torques(robot, robot.equilibrium(positions).coordinates)
