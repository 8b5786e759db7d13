"""Peaks of torque, speed and position that the linear model predicts under feedback.

A reference with the DFT R gives the torque U = (I + F_y G_y)^-1 F_r R and the angle Y = G_y U.
These make the peaks of the steady state; the start from rest is followed sample by sample, as a
motor that hardly works in the steady state can meet its largest torque in the transient.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from oed.experiment.experiment_plan import ExperimentPlan
from oed.experiment.limits import UNITS
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
START = 2.0
"""So long is the start of a run followed [s], in whole periods."""
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

    def extremes(
        self,
        plan: ExperimentPlan,
        amplitudes: Array,
        blocks: int | None = None,
        done: Callable[[], object] | None = None,
    ) -> Array:
        """Return lowest and highest deviations, (V, 7, n, 2), with amplitudes (F, n) >= 0.

        They are those of `oed.experiment.limits.UNITS`. Only the first `blocks` blocks count, all
        of them by default; `done` is called after each visit.
        """
        sine = plan.multisine
        share = (amplitudes / sine.amplitudes)[..., None]
        extremes = []
        for visit in range(len(plan.visits)):
            spectrum = sine.spectrum(plan.phases[visit, :blocks])[..., : plan.runs]
            extremes.append(self.reach(plan, visit, plan.scale[visit] * share * spectrum))
            if done is not None:
                done()
        return np.array(extremes)

    def reach(self, plan: ExperimentPlan, visit: int, spectrum: ComplexArray) -> Array:
        """Return lowest and highest deviations, (7, n, 2), by references of a spectrum."""
        steady, start = self.steady(plan, visit, spectrum), self.start(plan, visit, spectrum)
        lowest = np.minimum(steady[..., 0], start[..., 0])
        highest = np.maximum(steady[..., 1], start[..., 1])
        ends = np.stack([lowest, highest], axis=-1)
        largest = np.stack([self.rms_torque(plan, visit, spectrum), *commanded(plan, spectrum)])
        return np.concatenate([ends, ends[2:], np.stack([-largest, largest], axis=-1)])

    def rms_torque(self, plan: ExperimentPlan, visit: int, spectrum: ComplexArray) -> Array:
        """Return root mean squares (n,) of a period's torques, the largest of all runs."""
        U = self.torque[plan.visits[visit]] @ spectrum / plan.multisine.samples
        mean_square = 2 * (np.abs(U) ** 2).sum(axis=1)  # (B, n, E)
        return np.asarray(np.sqrt(mean_square.max(axis=(0, 2))))

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
        """Return the extremes (3, n, 2) of the first periods, from rest, and of the last fall."""
        planned = plan.periods + plan.transient_periods
        periods = min(planned, int(np.ceil(START / plan.multisine.period)))
        references = plan.multisine.period_of(spectrum)
        runs = references.reshape(-1, *references.shape[-2:])
        swing = self.starts[plan.visits[visit]].swing(plan.played(runs, periods))
        swing[2] = np.sort(swing[2] / self.ratios[:, None], axis=-1)
        return np.asarray(swing)


def carrier_extremes(
    plan: ExperimentPlan, robot: Elastic, controller: Controller, holding: Array | None
) -> Array:
    """Return deviations that the carrier alone leads to, (V, 7, n, 2); zeros without one."""
    carrier = plan.carrier
    if carrier is None:
        return np.zeros((len(plan.visits), len(UNITS), len(plan.motors), 2))
    phases = np.zeros((len(plan.visits), 1, 1, len(plan.motors)))
    alone = replace(plan, multisine=carrier.grid(plan.multisine), phases=phases, carrier=None)
    loop = PlannedLoop.of(alone, robot, controller, holding)
    spectra = [carrier.spectrum(q, plan.multisine.samples)[None] for q in plan.visits]
    return np.array([loop.reach(alone, visit, R) for visit, R in enumerate(spectra)])


def commanded(plan: ExperimentPlan, spectrum: ComplexArray) -> tuple[Array, Array]:
    """Return largest speeds and accelerations of references, (n,) each, from rest to rest.

    Parameters
    ----------
    spectrum : ndarray of complex, (B, F, n, E)
        DFTs of the references.
    """
    speeds = plan.played(plan.multisine.period_of(spectrum), 2)
    steps = np.diff(speeds, axis=-2, prepend=0, append=0) / plan.multisine.sample_time
    fastest, quickest = (np.abs(x).max(axis=(0, 1, 2)) for x in (speeds, steps))
    return np.asarray(fastest), np.asarray(quickest)


def predicted_peaks(
    plan: ExperimentPlan,
    robot: Elastic,
    controller: Controller,
    holding: Array | None = None,
) -> Peaks:
    """Return the peaks that the linear model predicts for a plan; arguments as in `oed.scale`.

    Those of a carrier and of the excitation are added, as if they came at once.

    Raises
    ------
    InvalidInput
        If controller, robot and plan do not fit each other.
    NoEquilibrium
        If the springs cannot carry the robot's weight in a position.
    """
    loop = PlannedLoop.of(plan, robot, controller, holding)
    swing = loop.extremes(plan, plan.multisine.amplitudes)
    swing += carrier_extremes(plan, robot, controller, holding)
    return Peaks(read_only(loop.operating_point), read_only(swing[:, :3]))


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
