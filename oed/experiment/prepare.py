"""From an experiment file to a plan whose amplitudes lie inside limits."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from oed.experiment.amplitude_scaling import Scaling, scale
from oed.experiment.carrier import Carrier, carrier_in
from oed.experiment.draw_plan import experiment_plan
from oed.experiment.experiment_file import ExcitationSettings, Experiment, planned_positions
from oed.experiment.experiment_plan import ExperimentPlan
from oed.experiment.limits import Limits
from oed.experiment.loop_settings import LIMITS, LoopSettings, per_motor
from oed.experiment.moves import MoveLimits
from oed.experiment.multisine import Multisine, band_multisine
from oed.experiment.workcell_settings import surroundings_of
from robotmodels import ElasticRobot, load_robot
from robotmodels.collision.free_moves import contacts, swing_contact
from robotmodels.collision.surroundings import Surroundings
from robotmodels.common.arrays import Array, IntArray, check_memory
from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import StageProgress
from robotmodels.description.friction import shaft_friction
from robotmodels.simulation.controller import Controller, default_controller
from robotmodels.simulation.imperfections import Imperfections

_TIME_CONSTANTS = 10.0
"""Of the position loop, after which a carrier is taken for settled: 5e-5 of its start are left."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """An experiment that is ready to be run.

    Attributes
    ----------
    robot : ElasticRobot
        The robot that the plan was made for.
    controller : Controller
        Controller that moves it.
    scaling : Scaling
        The plan inside its limits, predicted peaks, and the limit that each visit meets.
    imperfections : Imperfections
        Imperfections of the simulated robot.
    rng : Generator
        Generator of the seed's further random numbers, for the simulation.
    """

    robot: ElasticRobot
    controller: Controller
    scaling: Scaling
    imperfections: Imperfections
    rng: np.random.Generator

    @property
    def plan(self) -> ExperimentPlan:
        """The scaled plan."""
        return self.scaling.plan


def prepare(experiment: Experiment, progress: StageProgress | None = None) -> Prepared:
    """Draw the plan of an experiment and scale it; the same seed gives the same plan.

    Raises
    ------
    InvalidInput
        Naming the key whose value does not fit the robot, the limit without room, or what touches.
    NoEquilibrium
        If the springs cannot carry the robot's weight in a position.
    """
    robot = load_robot(experiment.robot)
    positions, repetitions = planned_positions(experiment, robot.name)
    rng = np.random.default_rng(experiment.seed)
    prepared = prepare_in(experiment, robot, positions, repetitions, rng, progress)
    _check_contacts(prepared, surroundings_of(experiment.workcell, robot))
    return prepared


def _check_contacts(prepared: Prepared, surroundings: Surroundings | None) -> None:
    """Refuse moves and swings on which something would touch."""
    plan, start = prepared.plan, prepared.plan.positions[0]
    for visit, goal in enumerate(plan.visited):
        pair, way = contacts(surroundings, start, goal)[0], "on the path there"
        if pair is None:
            swing = prepared.scaling.peaks.swing[visit, 2]
            pair, way = swing_contact(surroundings, goal, *swing.T), "within its swing"
        if pair is not None:
            raise InvalidInput(
                f"position {plan.visits[visit] + 1}: {pair} would touch {way}; another position, "
                "another order, or a smaller limits.swing, is needed"
            )
        start = goal


def prepare_in(
    settings: ExcitationSettings,
    robot: ElasticRobot,
    positions: Array,
    repetitions: IntArray,
    rng: np.random.Generator,
    progress: StageProgress | None = None,
) -> Prepared:
    """Draw a plan for positions (Q, n) and repetitions (Q,) and scale it.

    Raises
    ------
    InvalidInput, NoEquilibrium
        As `prepare`.
    """
    motors = tuple(robot.motor_names)
    if positions.shape[1] != len(motors):
        raise InvalidInput(
            f"positions: {positions.shape[1]} angles each; {len(motors)} are needed, one per motor "
            f"({', '.join(motors)})"
        )
    _check_memory(settings, repetitions, len(motors))
    moves = settings.moves
    plan = experiment_plan(
        robot,
        positions,
        planned_multisine(settings, len(motors), rng),
        blocks=settings.blocks,
        periods=settings.periods,
        transient_periods=settings.transient_periods,
        ramp=settings.ramp and settings.transient_periods > 0,
        speed=per_motor("moves.speed", moves.speed, motors),
        acceleration=per_motor("moves.acceleration", moves.acceleration, motors),
        rng=rng,
        repetitions=repetitions,
        runs=settings.runs,
        crest_iterations=settings.multisine.crest_iterations,
        progress=None if progress is None else partial(progress, "plan"),
    )
    controller = controller_of(settings, robot)
    slow = carrier_of(
        settings, controller, robot, positions, plan.multisine, settings.transient_periods
    )
    plan = replace(plan, settle=settings.settle, carrier=slow)
    imperfections = imperfections_of(settings, robot)
    scaling = within_limits(
        settings, plan, robot, controller, balance=settings.limits.balance, progress=progress
    )
    return Prepared(robot, controller, scaling, imperfections, rng)


def _check_memory(settings: ExcitationSettings, repetitions: IntArray, motors: int) -> None:
    """Refuse signals that do not fit into memory: those of all visits, and records of one."""
    period = 8.0 * settings.blocks * motors**2 * settings.multisine.samples
    signals = period * float(repetitions.sum())
    records = 2 * period * (settings.periods + settings.transient_periods)
    check_memory(
        signals + records, "multisine.period over sample_time, blocks, periods and repetitions"
    )


def planned_multisine(settings: LoopSettings, motors: int, rng: np.random.Generator) -> Multisine:
    """Return the lines of the settings and their amplitudes; `rng` draws detection lines."""
    choice = settings.multisine
    low, high = choice.band
    middle = 2 * np.pi * np.sqrt(low * high)
    return band_multisine(
        choice.samples,
        choice.sample_time,
        (2 * np.pi * low, 2 * np.pi * high),
        inputs=motors,
        count=choice.count,
        spacing=choice.spacing,
        odd=choice.odd,
        detection_group=choice.detection,
        amplitude=lambda omega: (omega / middle) ** choice.slope,
        rng=rng,
    )


def move_limits(settings: LoopSettings, robot: ElasticRobot) -> MoveLimits:
    """Return what moves between positions must respect."""
    motors = tuple(robot.motor_names)
    speed = per_motor("moves.speed", settings.moves.speed, motors)
    acceleration = per_motor("moves.acceleration", settings.moves.acceleration, motors)
    return MoveLimits(motors, robot.position_limits, speed, acceleration)


def gear_ratios(robot: ElasticRobot) -> Array:
    """Return motor angles per arm angle, (n,)."""
    return np.array([motor.gear_ratio for motor in robot.file.motors])


def controller_of(settings: LoopSettings, robot: ElasticRobot) -> Controller:
    """Return the controller of the settings, the default one where they have none."""
    choice, sample_time = settings.controller, settings.multisine.sample_time
    if choice is None:
        return default_controller(robot, sample_time)
    gains = {
        name: per_motor(f"controller.{name}", getattr(choice, name), tuple(robot.motor_names))
        for name in ("speed_gain", "integral_time", "position_gain", "filter_time")
    }
    return Controller(sample_time=sample_time, **gains)


def carrier_of(
    settings: LoopSettings,
    controller: Controller,
    robot: ElasticRobot,
    positions: Array,
    grid: Multisine,
    transient_periods: int,
) -> Carrier | None:
    """Return the carrier of the settings under a multisine; None where they have none.

    Raises
    ------
    InvalidInput
        As `carrier_in`; or if it does not settle before it is measured: what its start leaves dies
        out with the position loop.
    """
    choice = settings.carrier
    if choice is None:
        return None
    speed = per_motor("carrier.speed", choice.speed, tuple(robot.motor_names))
    gains = controller.position_gain[controller.position_gain > 0]
    settling = _TIME_CONSTANTS / gains.min(initial=np.inf)
    if transient_periods * grid.period < settling:
        needed = int(np.ceil(settling / grid.period))
        raise InvalidInput(
            f"transient_periods: {transient_periods} of {grid.period:g} s; a carrier takes "
            f"{settling:.3g} s to settle by a position gain of {gains.min():g} 1/s, so {needed} "
            "are needed"
        )
    return carrier_in(robot, positions, controller, speed, choice.frequency, grid)


def imperfections_of(settings: LoopSettings, robot: ElasticRobot) -> Imperfections:
    """Return the imperfections of the settings, per motor and output."""
    choice, motors = settings.imperfections, robot.motor_names
    lists = {
        name: per_motor(f"imperfections.{name}", value, motors)
        for name in ("backlash", "angle_noise", "torque_disturbance", "torque_limit")
        if (value := getattr(choice, name)) is not None
    }
    return Imperfections(
        friction=choice.friction,
        nonlinear_gears=choice.nonlinear_gears,
        quantisation=choice.quantisation,
        output_noise=per_motor(
            "imperfections.output_noise", choice.output_noise, robot.output_names, "output"
        ),
        **lists,
    )


def within_limits(
    settings: LoopSettings,
    plan: ExperimentPlan,
    robot: ElasticRobot,
    controller: Controller,
    *,
    balance: bool = False,
    progress: StageProgress | None = None,
) -> Scaling:
    """Return the plan with the largest amplitudes that the limits of the settings allow.

    Raises
    ------
    InvalidInput, NoEquilibrium
        As `oed.scale`.
    """
    choice = settings.limits
    return scale(
        plan,
        robot,
        controller,
        limits_of(settings, robot),
        balance=balance,
        margin=choice.margin,
        friction=friction_of(settings, robot),
        progress=None if progress is None else partial(progress, "amplitudes"),
    )


def friction_of(settings: LoopSettings, robot: ElasticRobot) -> Array:
    """Return the motors' Coulomb friction, (n,) [N m], as the settings have it."""
    return settings.friction_factor * shaft_friction(robot.file)


def limits_of(settings: LoopSettings, robot: ElasticRobot) -> Limits:
    """Return the limits of the settings with the robot's of positions, per motor."""
    motors, choice = tuple(robot.motor_names), settings.limits
    limits = {
        name: per_motor(f"limits.{name}", value, motors)
        for name in LIMITS
        if (value := getattr(choice, name)) is not None
    }
    return Limits(positions=robot.position_limits, **limits)
