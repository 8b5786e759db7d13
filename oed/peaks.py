"""Peaks of torque, speed and position that the linear model predicts under feedback.

Under the controller u = F_r r - F_y y, a reference with the DFT R gives the torque
U = (I + F_y G_y)^-1 F_r R and the angle Y = G_y U. These are the peaks of the steady state;
the transient that starts an experiment is not in them.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from oed.multisine import Multisine
from oed.plan import ExperimentPlan
from robotmodels.arrays import Array, ComplexArray, read_only
from robotmodels.errors import InvalidInput
from robotmodels.response import Elastic

# Points per period of the highest line at which peaks of speeds and angles are sought.
_POINTS = 24


class SampledController(Protocol):
    """The controller u = F_r r - F_y y, sampled, its torque held over a sample."""

    @property
    def sample_time(self) -> float:
        """Sample time [s]."""
        ...

    def prefilter(self, omega: Array) -> ComplexArray:
        """Return torque per speed reference, F_r (F, n)."""
        ...

    def feedback(self, omega: Array) -> ComplexArray:
        """Return torque per motor angle with opposite sign, F_y (F, n)."""
        ...


@dataclass(frozen=True, eq=False)
class Peaks:
    """Lowest and highest predicted values over all blocks and experiments of each visit.

    Attributes
    ----------
    rest : (V, 3, n) holding torque [N m, motor shaft], zero speed, position [rad, arm side].
    swing : (V, 3, n, 2) lowest and highest deviation of torque, speed [rad/s, motor shaft] and
        position from it.
    """

    rest: Array
    swing: Array

    @property
    def largest(self) -> Array:
        """Largest magnitudes of torque and speed, and of the position's deviation, (V, 3, n)."""
        shift = self.rest.copy()
        shift[:, 2] = 0.0
        return np.asarray(np.abs(shift[..., None] + self.swing).max(axis=-1))


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """The closed loop at a plan's lines.

    Attributes
    ----------
    torque, angle : (Q, F, n, n) motor torque [N m] and angle [rad] per speed reference [rad/s].
    ratios : (n,) gear ratios.
    rest : (V, 3, n) as in `Peaks`.
    """

    torque: ComplexArray
    angle: ComplexArray
    ratios: Array
    rest: Array

    @classmethod
    def of(
        cls,
        plan: ExperimentPlan,
        robot: Elastic,
        controller: SampledController,
        holding: Array | None,
    ) -> "ClosedLoop":
        """Close the loop around the linear models at a plan's positions."""
        sine = plan.multisine
        if not np.isclose(controller.sample_time, sine.sample_time, rtol=1e-9, atol=0):
            raise InvalidInput(
                f"controller: sample time {controller.sample_time:g} s, the plan's signals have "
                f"{sine.sample_time:g} s"
            )
        model = robot.network(plan.positions).linear_model()
        n = len(plan.motors)
        if model.inputs != n:
            raise InvalidInput(f"robot: {model.inputs} motors; the plan has {n}")
        omega, T = sine.omega, sine.sample_time
        angle = model.selector.T @ model.receptances(omega)[0]  # (Q, F, n, n) per torque
        hold = np.sinc(omega * T / (2 * np.pi)) * np.exp(-0.5j * omega * T)
        seen = np.exp(-1j * omega * model.measured.delay) * hold
        F_r, F_y = controller.prefilter(omega), controller.feedback(omega)
        loop = np.eye(n) + F_y[:, :, None] * seen[:, None, None] * angle
        torque = np.linalg.solve(loop, np.broadcast_to(F_r[:, :, None] * np.eye(n), loop.shape))
        held = _holding(robot, plan.positions) if holding is None else np.asarray(holding)
        if held.shape != plan.positions.shape:
            raise InvalidInput(f"holding: shape {held.shape}; {plan.positions.shape} is needed")
        rest = np.stack([held, np.zeros_like(held), plan.positions], axis=1)[plan.visits]
        ratios = model.selector[np.abs(model.selector).argmax(axis=0), np.arange(n)]
        return cls(torque, hold[:, None, None] * angle @ torque, ratios, rest)

    def swing(self, plan: ExperimentPlan, amplitudes: Array, blocks: int | None = None) -> Array:
        """Return lowest and highest deviations, (V, 3, n, 2), with amplitudes (F, n) >= 0.

        Only the first `blocks` blocks count; all of them by default.
        """
        sine = plan.multisine
        share = amplitudes / sine.amplitudes
        swings = []
        for visit, q in enumerate(plan.visits):
            R = plan.scale[visit] * share[..., None] * sine.spectrum(plan.phases[visit, :blocks])
            swings.append(self._swing(sine, R, self.torque[q], self.angle[q]))
        return np.array(swings)

    def _swing(
        self, sine: Multisine, spectrum: ComplexArray, torque: ComplexArray, angle: ComplexArray
    ) -> Array:
        # A held torque has no values but those at the samples; what moves has.
        points = sine.samples * int(np.ceil(_POINTS * sine.lines[-1] / sine.samples))
        Y = angle @ spectrum
        signals = (
            sine.period_of(torque @ spectrum),
            sine.period_of(1j * sine.omega[:, None, None] * Y, points),
            sine.period_of(Y, points) / self.ratios,
        )
        ends = [np.stack([s.min(axis=(0, 1, 2)), s.max(axis=(0, 1, 2))], axis=-1) for s in signals]
        return np.array(ends)


def predicted_peaks(
    plan: ExperimentPlan,
    robot: Elastic,
    controller: SampledController,
    holding: Array | None = None,
) -> Peaks:
    """Return the peaks that the linear model predicts for a plan; arguments as in `oed.scale`.

    Raises
    ------
    InvalidInput : if controller, robot and plan do not fit each other.
    NoEquilibrium : if the springs cannot carry the robot's weight in a position.
    """
    loop = ClosedLoop.of(plan, robot, controller, holding)
    return Peaks(read_only(loop.rest), read_only(loop.swing(plan, plan.multisine.amplitudes)))


def _holding(robot: object, positions: Array) -> Array:
    """Return the motor torques that hold a robot's arm, (Q, n)."""
    # Imported when used: other models need no Pinocchio.
    from robotmodels.elastic import ElasticRobot
    from robotmodels.equilibrium import gravity_torques

    if not isinstance(robot, ElasticRobot):
        raise InvalidInput(
            "holding: the torques that hold the arm, (Q, n), are needed for a model that is not "
            "an ElasticRobot"
        )
    layout, motors = robot.layout, robot.file.motors
    torques = gravity_torques(layout.arm, robot.equilibrium(positions).coordinates)
    shaft = np.array([m.gear_ratio * m.torque_gain for m in motors])
    return np.asarray(torques[:, layout.drives] / shaft)
