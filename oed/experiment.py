"""From an experiment file to records: plan, amplitudes inside limits, simulation."""

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from oed.experiment_file import Experiment, per_motor, planned_positions
from oed.multisine import Multisine, band_multisine
from oed.peaks import Peaks
from oed.plan import ExperimentPlan, experiment_plan
from oed.scaling import Binding, Limits, Scaling, scale
from robotmodels import ElasticRobot, load_robot
from robotmodels.arrays import Array, read_only
from robotmodels.controller import Controller, default_controller
from robotmodels.errors import InvalidInput
from robotmodels.plant import Imperfections, simulate
from robotmodels.records import Records, save_records

Progress = Callable[[str, int, int], None]
"""Called with the stage's name, the steps done and the steps in all (0: not known yet)."""


@dataclass(frozen=True)
class SwingBinding(Binding):
    """The swing around a position that a visit meets first; `limit` is its size."""

    def __str__(self) -> str:
        return (
            f"swing of motor {self.motor!r} around position {self.position} meets its limit "
            f"{self.limit:.4g} rad"
        )


@dataclass(frozen=True, eq=False)
class Prepared:
    """An experiment that is ready to be run.

    Attributes
    ----------
    experiment : its file.
    robot : the robot.
    controller : that moves it.
    scaling : the plan inside its limits, predicted peaks, and the limit that each visit meets.
    imperfections : of the simulated robot.
    rng : what is left of the seed's random numbers, for the simulation.
    """

    experiment: Experiment
    robot: ElasticRobot
    controller: Controller
    scaling: Scaling
    imperfections: Imperfections
    rng: np.random.Generator

    @property
    def plan(self) -> ExperimentPlan:
        """The scaled plan."""
        return self.scaling.plan


@dataclass(frozen=True, eq=False)
class Outcome:
    """What the simulation met.

    Attributes
    ----------
    peak_torque, peak_speed : (n,) largest magnitudes over all records, motor shaft [N m, rad/s].
    predicted_torque, predicted_speed : (n,) by the linear model.
    saturated : (n,) part of the experiments in which the torque met its limit.
    seconds : that the simulation took.
    """

    peak_torque: Array
    peak_speed: Array
    predicted_torque: Array
    predicted_speed: Array
    saturated: Array
    seconds: float


def prepare(experiment: Experiment, progress: Progress | None = None) -> Prepared:
    """Draw the plan of an experiment and scale it; the same seed gives the same plan.

    Raises
    ------
    InvalidInput : naming the key whose value does not fit the robot, or the limit without room.
    NoEquilibrium : if the springs cannot carry the robot's weight in a position.
    """
    robot = load_robot(experiment.robot)
    motors = tuple(robot.motor_names)
    positions, repetitions = planned_positions(experiment, robot.name)
    if positions.shape[1] != len(motors):
        raise InvalidInput(
            f"positions: {positions.shape[1]} angles each; {len(motors)} are needed, one per motor "
            f"({', '.join(motors)})"
        )
    rng = np.random.default_rng(experiment.seed)
    moves = experiment.moves
    plan = experiment_plan(
        robot,
        positions,
        _multisine(experiment, len(motors), rng),
        blocks=experiment.blocks,
        periods=experiment.periods,
        transient_periods=experiment.transient_periods,
        speed=per_motor("moves.speed", moves.speed, motors),
        acceleration=per_motor("moves.acceleration", moves.acceleration, motors),
        rng=rng,
        repetitions=repetitions,
        crest_iterations=experiment.multisine.crest_iterations,
        progress=None if progress is None else partial(progress, "plan"),
    )
    controller = _controller(experiment, robot)
    imperfections = _imperfections(experiment, motors)
    scaling = _scaled(experiment, plan, robot, controller, progress)
    return Prepared(experiment, robot, controller, scaling, imperfections, rng)


def run_experiment(
    prepared: Prepared,
    folder: Path,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> Outcome:
    """Write plan.yaml and plan.h5, simulate, and write records.h5 into `folder`.

    The records have one entry per visit, in the plan's order: a position that is visited twice
    appears twice, each time with phases of its own.

    Raises
    ------
    InvalidInput, SolverFailed : as `robotmodels.plant.simulate`.
    """
    plan = prepared.plan
    plan.save(folder / "plan.yaml")
    begun = time.perf_counter()
    parts = simulate(
        prepared.robot,
        plan.visited,
        plan.signals,
        prepared.controller,
        lines=plan.multisine.lines,
        detection=plan.multisine.detection,
        imperfections=prepared.imperfections,
        rng=prepared.rng,
        periods=plan.periods,
        transient=plan.transient_periods,
        executor=executor,
        progress=None if progress is None else partial(progress, "simulation"),
    )
    seen = _Seen(len(plan.motors))
    save_records(folder / "records.h5", seen.watch(parts))
    largest = prepared.scaling.peaks.largest.max(axis=0)
    return Outcome(
        peak_torque=seen.torque,
        peak_speed=seen.speed,
        predicted_torque=largest[0],
        predicted_speed=largest[1],
        saturated=seen.limited / max(seen.experiments, 1),
        seconds=time.perf_counter() - begun,
    )


class _Seen:
    """Peaks of records that pass by on their way to the file."""

    def __init__(self, motors: int) -> None:
        self.torque, self.speed, self.limited = np.zeros((3, motors))
        self.experiments = 0

    def watch(self, parts: Iterator[Records]) -> Iterator[Records]:
        for part in parts:
            speed = np.diff(part.angle, axis=4) / part.sample_time
            self.torque = np.maximum(self.torque, np.abs(part.torque).max(axis=(0, 1, 2, 3, 4)))
            self.speed = np.maximum(self.speed, np.abs(speed).max(axis=(0, 1, 2, 3, 4)))
            met = part.saturated.any(axis=3)
            self.limited = self.limited + met.sum(axis=(0, 1, 2))
            self.experiments += int(np.prod(met.shape[:3]))
            yield part


def _multisine(experiment: Experiment, motors: int, rng: np.random.Generator) -> Multisine:
    choice = experiment.multisine
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


def _controller(experiment: Experiment, robot: ElasticRobot) -> Controller:
    choice, sample_time = experiment.controller, experiment.multisine.sample_time
    if choice is None:
        return default_controller(robot, sample_time)
    gains = {
        name: per_motor(f"controller.{name}", getattr(choice, name), tuple(robot.motor_names))
        for name in ("speed_gain", "integral_time", "position_gain", "filter_time")
    }
    return Controller(sample_time=sample_time, **gains)


def _imperfections(experiment: Experiment, motors: tuple[str, ...]) -> Imperfections:
    choice = experiment.imperfections
    lists = {
        name: per_motor(f"imperfections.{name}", value, motors)
        for name in ("backlash", "angle_noise", "torque_disturbance", "torque_limit")
        if (value := getattr(choice, name)) is not None
    }
    return Imperfections(
        friction=choice.friction,
        nonlinear_gears=choice.nonlinear_gears,
        quantisation=choice.quantisation,
        **lists,
    )


def _scaled(
    experiment: Experiment,
    plan: ExperimentPlan,
    robot: ElasticRobot,
    controller: Controller,
    progress: Progress | None,
) -> Scaling:
    choice, motors = experiment.limits, plan.motors
    given = {
        name: per_motor(f"limits.{name}", value, motors)
        for name in ("torque", "speed")
        if (value := getattr(choice, name)) is not None
    }
    scaling = scale(
        plan,
        robot,
        controller,
        Limits(positions=robot.position_limits, **given),
        balance=choice.balance,
        margin=choice.margin,
        progress=None if progress is None else partial(progress, "amplitudes"),
    )
    if choice.swing is None:
        return scaling
    return within_swing(
        scaling, (1 - choice.margin) * per_motor("limits.swing", choice.swing, motors)
    )


def within_swing(scaling: Scaling, swing: Array) -> Scaling:
    """Return the plan with smaller amplitudes, where needed for each motor's swing.

    Parameters
    ----------
    scaling : a plan inside its other limits, with one factor for all visits.
    swing : (n,) largest deviation from the position, arm side [rad].
    """
    peaks = scaling.peaks
    shift = np.abs(peaks.swing[:, 2]).max(axis=-1)  # (V, n)
    allowed = swing / np.maximum(shift, np.finfo(float).tiny)
    factor = float(allowed.min())
    bindings = tuple(
        _tighter(binding, allowed[v], swing, scaling.plan)
        for v, binding in enumerate(scaling.bindings)
    )
    if factor >= 1:
        return replace(scaling, bindings=bindings)
    return Scaling(
        scaling.plan.rescaled(np.asarray(factor)),
        Peaks(peaks.rest, read_only(peaks.swing * factor)),
        tuple(replace(b, factor=b.factor / factor) for b in bindings),
    )


def _tighter(binding: Binding, allowed: Array, swing: Array, plan: ExperimentPlan) -> Binding:
    """Return the limit of a visit that is met first, the swing's or the one found before."""
    motor = int(np.argmin(allowed))
    if allowed[motor] >= binding.factor:
        return binding
    return SwingBinding(
        visit=binding.visit,
        position=binding.position,
        motor=plan.motors[motor],
        quantity="swing",
        limit=float(swing[motor]),
        factor=float(allowed[motor]),
    )
