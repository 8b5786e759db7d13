"""A robot as a plan drives it: Coulomb friction of its motors as dampers at the plan's speeds.

What moves the arm is the torque less friction, so planned spectra are of that. To speeds of many
lines friction is a damper of coulomb sqrt(2 / pi) / rms (Booton 1954), for which the controller has
to be told more, most where the excitation is slow.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from oed.campaign.settings import VisitSettings
from oed.experiment.amplitude_scaling import Scaling
from oed.experiment.controller_files import write_controller_files
from oed.experiment.experiment_plan import ExperimentPlan
from oed.experiment.prepare import controller_of, within_limits
from oed.experiment.trajectory_check import BeyondLimit
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.description.friction import at_speeds
from robotmodels.simulation.controller import Controller
from robotmodels.simulation.loop_noise import LoopTransfer, closed_loop

_STEPS = 12
_ATTEMPTS = 8
_FARTHEST = 1.5
"""Ratio to a limit that is no mere transient."""
_BELOW = 0.995
"""Of a limit, to which amplitudes are lowered that exceed it."""
_SETTLED = 2e-4
"""Relative change of amplitudes; what files lead to may be beyond limits by 1e-3."""
_OF_MARGIN = 0.1
_SLOWEST = 1e-2
"""Of the speed without friction, where friction would hold a motor."""


def driven(robot: ElasticRobot, speeds: Array) -> ElasticRobot:
    """Return the robot whose motors have dampers in place of friction, at rms speeds (n,)."""
    counted = at_speeds(robot.file, np.maximum(speeds, 1e-6))
    motors = [
        motor.model_copy(
            update={
                "viscous": motor.viscous + motor.equivalent,
                "coulomb": 0.0,
                "coulomb_speed": None,
            }
        )
        for motor in counted.motors
    ]
    return replace(robot, file=robot.file.model_copy(update={"motors": motors}))


def driven_by(plan: ExperimentPlan, robot: ElasticRobot, controller: Controller) -> ElasticRobot:
    """Return the robot as the first visit of a plan drives it; itself where nothing rubs.

    Speeds fall from those without friction until dampers and speeds belong to each other.
    """
    if not any(motor.coulomb for motor in robot.file.motors):
        return robot
    omega, R = plan.multisine.omega, plan.amplitudes(0)
    slow = 0.0 if plan.carrier is None else _carrier_speeds(plan, robot, controller)
    now, least = robot, np.zeros(len(plan.motors))
    for _ in range(_STEPS):
        loop = closed_loop(now.network(plan.visited[:1]), omega, controller)
        speeds = np.hypot(rms_speeds(loop.angle[0] @ R, omega), slow)
        least = least if least.any() else _SLOWEST * speeds
        now = driven(robot, np.maximum(speeds, least))
    return now


def as_driven(
    settings: VisitSettings, scaled: Scaling, robot: ElasticRobot, controller: Controller
) -> Scaling:
    """Return the plan with the largest amplitudes at the dampers of the speeds that it leads to.

    The larger the speeds, the smaller the dampers, so amplitudes and dampers follow in turns, until
    what is left is small beside the margin.
    """
    settled = max(_SETTLED, _OF_MARGIN * settings.limits.margin)
    for _ in range(_STEPS):
        before = scaled.plan.scale[0]
        rubbing = driven_by(scaled.plan, robot, controller)
        scaled = within_limits(settings, scaled.plan, rubbing, controller)
        if abs(scaled.plan.scale[0] / before - 1) <= settled:
            break
    return scaled


def write_visit_files(
    plan: ExperimentPlan, folder: Path, settings: VisitSettings, robot: ElasticRobot
) -> ExperimentPlan:
    """Write the files of one visit, checked with friction as the visit drives it.

    Amplitudes are such that periods stay inside the limits. Where a run begins transients add to
    that, so amplitudes are lowered until all samples of its files do.

    Returns
    -------
    ExperimentPlan
        The plan of the files.

    Raises
    ------
    InvalidInput
        As `write_controller_files`.
    """
    for attempt in range(_ATTEMPTS):
        rubbing = driven_by(plan, robot, controller_of(settings, robot))
        try:
            write_controller_files(plan, folder, settings.files, settings, rubbing)
        except BeyondLimit as error:
            if not 1 < error.ratio <= _FARTHEST or attempt + 1 == _ATTEMPTS:  # or it is NaN
                raise
            plan = plan.rescaled(np.asarray(_BELOW / error.ratio))
        else:
            break
    return plan


def rms_speeds(angles: ComplexArray, omega: Array) -> Array:
    """Return root mean squares (n,) of speeds from amplitudes of angles, (F, n, E), over runs."""
    power = (np.abs(omega[:, None, None] * angles) ** 2).sum(axis=0) / 2
    return np.asarray(np.sqrt(power.mean(axis=1)))


def net_torques(
    loop: LoopTransfer, omega: Array, robot: ElasticRobot, rubbing: ElasticRobot
) -> ComplexArray:
    """Return torques less friction per reference, (F, n, n), of the loop of a driven robot.

    Dampers that responses of `robot` count, by its `coulomb_speed`, are no friction here.
    """
    dampers = _dampers(rubbing) - _dampers(robot)
    friction = 1j * omega[:, None, None] * dampers[:, None] * loop.angle[0]
    return np.asarray(loop.torque[0] - friction)


def _dampers(robot: ElasticRobot) -> Array:
    return np.array([motor.viscous + motor.equivalent for motor in robot.file.motors])


def _carrier_speeds(plan: ExperimentPlan, robot: ElasticRobot, controller: Controller) -> Array:
    """Return root mean square speeds of a carrier, (n,), which its loop leads to."""
    assert plan.carrier is not None
    omega = plan.carrier.grid(plan.multisine).omega
    loop = closed_loop(robot.network(plan.visited[:1]), omega, controller)
    reference = plan.carrier.spectrum(0, plan.multisine.samples) * (2 / plan.multisine.samples)
    return rms_speeds(loop.angle[0] @ reference, omega)
