"""From the torques that a visit is to have to a plan within all limits.

Under feedback a controller is told speeds, and the torques that they lead to depend on the robot:
references R = F_r^-1 (I + F_y G_y) U of the present model give the torques U, near enough.
"""

from dataclasses import replace

import numpy as np

from oed.campaign.settings import VisitSettings
from oed.experiment.amplitude_scaling import Scaling, fair_amplitudes
from oed.experiment.draw_plan import reduced_crest
from oed.experiment.experiment_file import per_motor
from oed.experiment.experiment_plan import ExperimentPlan
from oed.experiment.multisine import Multisine
from oed.experiment.prepare import (
    controller_of,
    move_limits,
    planned_multisine,
    within_limits,
)
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import InvalidInput
from robotmodels.description.friction import shaft_friction
from robotmodels.elastic.rigid_pose import holding_torques
from robotmodels.linear.response import frequency_response
from robotmodels.simulation.loop_noise import closed_loop

_CLIPPINGS = 100
CREST = 3.3
"""Largest over root mean square value of many lines in random phases, 5 % above the median."""


def line_grid(settings: VisitSettings, motors: int) -> Multisine:
    """Return the lines of all visits, the same for the same seed: detection lines are drawn."""
    return planned_multisine(settings, motors, np.random.default_rng(settings.seed))


def fair_torques(
    settings: VisitSettings, robot: ElasticRobot, position: Array, power: Array
) -> Array:
    """Return the root mean square torque of each motor, (n,) [N m], that limits have room for.

    Peaks are taken for 3.3 times root mean squares, powers of motors add up.

    Parameters
    ----------
    power : ndarray, (F, n)
        Share of each motor's power on each line; columns sum to one.

    Raises
    ------
    InvalidInput
        Naming the motor whose torque limit is used up by gravity and friction.
    """
    motors, limits = tuple(robot.motor_names), settings.limits
    omega = line_grid(settings, len(motors)).omega[:, None, None]
    G = frequency_response(robot, position[None], omega.ravel())[0]
    ratios = np.array([abs(motor.gear_ratio) for motor in robot.file.motors])
    rows = []
    if limits.torque is not None:
        limit = per_motor("limits.torque", limits.torque, motors)
        gravity = holding_torques(robot, robot.equilibrium(position[None]).coordinates)[0]
        friction = settings.imperfections.friction * shaft_friction(robot.file)
        room = limit - np.abs(gravity) - friction
        if not (room > 0).all():
            i = int(room.argmin())
            raise InvalidInput(
                f"limits.torque: motor {motors[i]!r} needs {limit[i] - room[i]:.4g} N m against "
                f"gravity and friction at {np.round(position, 3).tolist()}; its limit is "
                f"{limit[i]:.4g} N m"
            )
        rows.append(np.diag(1 / room))
    for name, order, sides in (("speed", 1, np.ones(len(motors))), ("swing", 2, ratios)):
        if (choice := getattr(limits, name)) is not None:
            limit = per_motor(f"limits.{name}", choice, motors) * sides
            square = np.einsum("fji,fi->ji", np.abs(G / omega**order) ** 2, power)
            rows.append(np.sqrt(square) / limit[:, None])
    return np.asarray(fair_amplitudes(CREST * np.vstack(rows))) * (1 - limits.margin)


def torque_phases(grid: Multisine, amplitude: Array, rng: np.random.Generator) -> ComplexArray:
    """Return torques (F, n) of these amplitudes, in random phases that keep peaks low."""
    tiny = 1e-9 * amplitude.max()  # what has no amplitude has no crest factor
    sine = grid.with_amplitudes(np.maximum(amplitude, tiny))
    phases = rng.uniform(0, 2 * np.pi, (1, *amplitude.shape))
    lowered = reduced_crest(sine, phases, _CLIPPINGS)[0]
    return np.asarray(amplitude * np.exp(1j * lowered))


def with_relative_phases(torques: ComplexArray, spectrum: ComplexArray) -> ComplexArray:
    """Return torques (F, n) whose phases between motors are those of Phi, (F, n, n), of one run.

    Torques stay as they are where Phi leaves motors independent.
    """
    off = np.abs(spectrum) * ~np.eye(spectrum.shape[1], dtype=bool)
    if off.max() <= 1e-9 * np.abs(spectrum).max():
        return torques
    first = np.linalg.eigh(spectrum)[1][..., -1]
    common = np.exp(1j * np.angle(torques[:, :1]))
    return np.asarray(np.abs(torques) * common * np.exp(1j * np.angle(first)))


def visit_plan(
    settings: VisitSettings,
    robot: ElasticRobot,
    position: Array,
    torques: ComplexArray,
    periods: int,
    start: Array | None,
    part: float = 1.0,
    runs: int = 1,
) -> Scaling:
    """Return a plan of one run whose torques are in the ratios of `torques` (F, n).

    Of several orthogonal ones their powers are, summed over the runs.

    Parameters
    ----------
    settings : VisitSettings
        Lines, limits, moves and controller.
    robot : ElasticRobot
        The robot as it is known now.
    position : ndarray, (n,), rad
        Where to go.
    torques : ndarray of complex, (F, n), N m
        Amplitude and phase of each line; the common factor is the largest that the limits allow.
    periods : int
        To measure.
    start : ndarray or None, (n,), rad
        Where the robot is before.
    part : float
        Part of the largest amplitude to take.
    runs : int
        One, or orthogonal ones, at most as many as motors.

    Raises
    ------
    InvalidInput
        Naming motor and limit without room, or the controller that is unstable there.
    NoEquilibrium
        If the springs cannot carry the robot's weight.
    """
    grid = line_grid(settings, len(robot.motor_names))
    controller = controller_of(settings, robot)
    loop = closed_loop(robot.network(position[None]), grid.omega, controller)
    inverse = np.linalg.inv(loop.torque[0])
    R = np.einsum("fij,fj->fi", inverse, torques)
    if runs > 1:
        power = np.einsum("fij,fj->fi", np.abs(inverse) ** 2, np.abs(torques) ** 2)
        R = np.sqrt(power) * np.exp(1j * np.angle(torques))
    plan = ExperimentPlan(
        robot=robot.name,
        positions=position[None],
        repetitions=np.ones(1, dtype=np.int64),
        multisine=grid.with_amplitudes(np.abs(R)),
        phases=np.angle(R)[None, None],
        periods=periods,
        transient_periods=settings.transient_periods,
        moves=move_limits(settings, robot),
        scale=np.ones(1),
        start=start,
        ramp=True,
        runs=runs,
    )
    scaled = within_limits(settings, plan, robot, controller)
    return replace(scaled, plan=scaled.plan.rescaled(np.asarray(part)))
