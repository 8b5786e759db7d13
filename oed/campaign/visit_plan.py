"""From the torques that a visit is to have to a plan within all limits.

Under feedback a controller is told speeds, and the torques that they lead to depend on the robot:
references R = F_r^-1 (I + F_y G_y) U of the present model give the torques U, near enough.
"""

from dataclasses import replace

import numpy as np
from scipy.optimize import nnls

from oed.campaign.driven_robot import as_driven, driven, driven_by, net_torques, rms_speeds
from oed.campaign.settings import VisitSettings
from oed.candidates.screening import usable
from oed.experiment.amplitude_scaling import Scaling, fair_amplitudes
from oed.experiment.carrier import Carrier, carrier_line
from oed.experiment.draw_plan import reduced_crest
from oed.experiment.experiment_plan import ExperimentPlan
from oed.experiment.limits import UNITS, beside_carrier, room
from oed.experiment.loop_settings import per_motor
from oed.experiment.multisine import Multisine
from oed.experiment.prepare import (
    carrier_of,
    controller_of,
    friction_of,
    gear_ratios,
    limits_of,
    move_limits,
    planned_multisine,
    within_limits,
)
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array, BoolArray, ComplexArray
from robotmodels.common.errors import NoEquilibrium
from robotmodels.elastic.rigid_pose import holding_torques
from robotmodels.simulation.controller import Controller
from robotmodels.simulation.loop_noise import LoopTransfer, closed_loop

_CLIPPINGS = 100
_LEAST = 1e-2
"""Of a reference's power that its own torque alone would take: none is silent."""

CREST = 3.3
"""Largest over root mean square value of many lines in random phases, 5 % above the median."""


def line_grid(settings: VisitSettings, motors: int) -> Multisine:
    """Return the lines of all visits, the same for the same seed: detection lines are drawn."""
    return planned_multisine(settings, motors, np.random.default_rng(settings.seed))


def usable_positions(settings: VisitSettings, robot: ElasticRobot, positions: Array) -> Array:
    """Return the positions that the springs bear, and in which limits leave torque to excite.

    All of them where none does: planning says why.
    """
    borne = _borne(robot, positions)
    positions = positions[borne] if borne.any() else positions
    liftable = _liftable(settings, robot, positions)
    return positions[liftable] if liftable.any() else positions


def _borne(robot: ElasticRobot, positions: Array) -> BoolArray:
    """Return whether there is an equilibrium; at a poor estimate a spring may give way."""
    try:
        robot.equilibrium(positions)
    except NoEquilibrium:
        if len(positions) == 1:
            return np.zeros(1, dtype=bool)
        return np.concatenate([_borne(robot, half) for half in np.array_split(positions, 2)])
    return np.ones(len(positions), dtype=bool)


def _liftable(settings: VisitSettings, robot: ElasticRobot, positions: Array) -> BoolArray:
    """Return whether gravity and friction leave torque to excite."""
    limits, margin = limits_of(settings, robot), settings.limits.margin
    limiting = [limit for limit in (limits.torque, limits.rms_torque) if limit is not None]
    if not limiting:
        return np.ones(len(positions), dtype=bool)
    free = (1 - margin) * np.min(limiting, axis=0) - friction_of(settings, robot)
    if not (free > 0).all():
        return np.zeros(len(positions), dtype=bool)
    return usable(robot, positions, torque_limits=free)


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
        Naming the motor whose limit is used up by gravity and friction, or by the carrier.
    """
    motors, n = tuple(robot.motor_names), len(robot.motor_names)
    here = [f"at {np.round(position, 3).tolist()}"]
    hold = holding_torques(robot, robot.equilibrium(position[None]).coordinates)
    point = np.stack([hold, np.zeros((1, n)), position[None]], axis=1)
    friction = friction_of(settings, robot)
    limits = replace(limits_of(settings, robot), positions=None)  # candidates lie inside
    free = room(limits.bounds(motors), point, friction, motors, here) * (1 - settings.limits.margin)
    grid, controller = line_grid(settings, n), controller_of(settings, robot)
    network, ratios = robot.network(position[None]), gear_ratios(robot)
    carrier = _carrier(settings, controller, robot, position, grid)
    if carrier is not None:
        omega = carrier.grid(grid).omega
        responses = _responses(closed_loop(network, omega, controller), omega, ratios)[:, 0]
        taken = np.abs(responses @ (carrier.amplitudes * np.exp(1j * carrier.phases))[0])
        free = beside_carrier(free, np.stack([taken, taken], axis=-1)[None], motors, here)
    loop = closed_loop(network, grid.omega, controller)
    per_torque = _responses(loop, grid.omega, ratios) @ np.linalg.inv(loop.torque[0])
    rms = np.sqrt(np.einsum("kfji,fi->kji", np.abs(per_torque) ** 2, power))
    rms[[name != "rms_torque" for name in UNITS]] *= CREST
    return np.asarray(fair_amplitudes((rms / free[0].min(axis=-1)[..., None]).reshape(-1, n)))


def _carrier(
    settings: VisitSettings,
    controller: Controller,
    robot: ElasticRobot,
    position: Array,
    grid: Multisine,
) -> Carrier | None:
    periods = settings.transient_periods
    return carrier_of(settings, controller, robot, position[None], grid, periods)


def _responses(loop: LoopTransfer, omega: Array, ratios: Array) -> ComplexArray:
    """Return the amplitudes of the limited quantities per reference, (quantities, F, n, n)."""
    omega = omega[:, None, None]
    torque, angle = loop.torque[0], loop.angle[0]
    position = angle / ratios[:, None]
    command = np.broadcast_to(np.eye(len(ratios)), torque.shape)
    return np.stack([torque, omega * angle, position, position, torque, command, omega * command])


def motion_levels(settings: VisitSettings, robot: ElasticRobot) -> tuple[Array, Array]:
    """Return root mean square speed and swing of motor shafts that limits have room for.

    They are (n,) [rad/s, rad], as of `oed.optimal_spectra`, beside the carrier; infinite where
    there is no limit.
    """
    motors, slow = tuple(robot.motor_names), settings.carrier
    taken, omega = np.zeros(len(motors)), 1.0
    if slow is not None:
        grid = line_grid(settings, len(motors))
        taken = per_motor("carrier.speed", slow.speed, motors)
        omega = 2 * np.pi * carrier_line(slow.frequency, grid) / grid.period
    ratios, levels = np.abs(gear_ratios(robot)), []
    for name, sides in (("speed", np.ones(len(motors))), ("swing", ratios)):
        choice = getattr(settings.limits, name)
        limit = np.inf if choice is None else per_motor(f"limits.{name}", choice, motors)
        used = taken if name == "speed" else taken / omega
        levels.append((limit * sides - used) / CREST)
    return levels[0], levels[1]


def visit_spectrum(
    plan: ExperimentPlan, robot: ElasticRobot, controller: Controller
) -> ComplexArray:
    """Return Phi of the first visit's torques less friction by the loop, (F, n, n) [N^2 m^2]."""
    omega, rubbing = plan.multisine.omega, driven_by(plan, robot, controller)
    loop = closed_loop(rubbing.network(plan.visited[:1]), omega, controller)
    U = net_torques(loop, omega, robot, rubbing) @ plan.amplitudes(0) / np.sqrt(2)
    return np.asarray(U @ np.conj(np.swapaxes(U, 1, 2)))


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
    """Return a plan of one run whose torques less friction are in the ratios of `torques` (F, n).

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
        Friction is taken for what it is near these amplitudes; for a part of them it is left out.
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
    rubbing = robot if part < 1 else _driven_by(torques, runs, position, grid, robot, controller)
    loop = closed_loop(rubbing.network(position[None]), grid.omega, controller)
    net = net_torques(loop, grid.omega, robot, rubbing)
    if runs > 1:
        R = _orthogonal(net, torques)
    else:
        R = np.asarray(np.linalg.solve(net, torques[..., None])[..., 0], dtype=complex)
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
        settle=settings.settle,
    )
    plan = replace(plan, carrier=_carrier(settings, controller, robot, position, grid))
    scaled = within_limits(settings, plan, rubbing, controller)
    if rubbing is not robot:
        scaled = as_driven(settings, scaled, robot, controller)
    slow = plan.carrier and plan.carrier.scaled(part)
    return replace(scaled, plan=replace(scaled.plan.rescaled(np.asarray(part)), carrier=slow))


def _driven_by(
    torques: ComplexArray,
    runs: int,
    position: Array,
    grid: Multisine,
    robot: ElasticRobot,
    controller: Controller,
) -> ElasticRobot:
    """Return the robot as torques (F, n) less friction drive it, which alone tell the speeds."""
    if not any(motor.coulomb for motor in robot.file.motors):
        return robot
    loop = closed_loop(robot.network(position[None]), grid.omega, controller)
    angles = loop.angle[0] @ np.linalg.solve(loop.torque[0], torques[..., None])
    return driven(robot, rms_speeds(angles, grid.omega) / np.sqrt(runs))


def _orthogonal(loop: ComplexArray, torques: ComplexArray) -> ComplexArray:
    """Return references (F, n) of orthogonal runs, whose torques have these powers or nearly so.

    Each reference moves all torques, so powers |R|^2 >= 0 are those nearest to |F_r|^2 |R|^2 =
    |U|^2, at least a little of each.
    """
    pairs = zip(np.abs(loop) ** 2, np.abs(torques) ** 2, strict=True)
    power = np.array([nnls(gain / wish[:, None], np.ones(len(wish)))[0] for gain, wish in pairs])
    alone = np.abs(torques / np.einsum("fii->fi", loop)) ** 2
    size = np.sqrt(np.maximum(power, _LEAST * alone))
    return np.asarray(size * np.exp(1j * np.angle(torques)))
