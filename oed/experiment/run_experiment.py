"""A plan carried out on a plant: visit by visit, from where an earlier run was stopped."""

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from oed.experiment.experiment_plan import ExperimentPlan
from oed.experiment.prepare import Prepared
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.checkpoint_file import CheckpointFile
from robotmodels.common.fingerprints import fingerprint
from robotmodels.common.progress import Progress, StageProgress
from robotmodels.library.robot_digest import robot_digest
from robotmodels.records.records import Records, iterate_records, save_records, write_records
from robotmodels.simulation.controller import Controller
from robotmodels.simulation.imperfections import Imperfections
from robotmodels.simulation.simulate import simulate


@dataclass(frozen=True, eq=False)
class Outcome:
    """What the simulation met.

    Attributes
    ----------
    peak_torque, peak_speed : ndarray, (n,)
        Largest magnitudes over all records, motor shaft [N m, rad/s].
    predicted_torque, predicted_speed : ndarray, (n,)
        By the linear model.
    saturated : ndarray, (n,)
        Part of the experiments in which the torque met its limit.
    seconds : float
        Seconds that the simulation took.
    """

    peak_torque: Array
    peak_speed: Array
    predicted_torque: Array
    predicted_speed: Array
    saturated: Array
    seconds: float


@runtime_checkable
class Plant(Protocol):
    """Whatever turns an experiment plan into records: a simulation, a robot, a folder of files."""

    @property
    def settings(self) -> object:
        """Plain data and arrays that records depend on beside the plan.

        An interrupted run goes on where they are the same.
        """

    def measure(
        self, plan: ExperimentPlan, visit: int, progress: Progress | None = None
    ) -> Records:
        """Return the records of one visit, (1, B, E, P, N, n), whatever was measured before.

        `progress` is called with blocks done and their number.
        """


@dataclass(frozen=True, eq=False)
class SimulatedPlant:
    """A robot simulated in closed loop, see `robotmodels.simulation.simulate.simulate`."""

    robot: ElasticRobot
    controller: Controller
    imperfections: Imperfections
    rng: np.random.Generator
    executor: Executor | None = None

    @property
    def settings(self) -> object:
        """Robot, controller, imperfections and seed."""
        seeds: Any = self.rng.bit_generator.seed_seq
        return (
            (self.controller, self.imperfections),
            (robot_digest(self.robot), self.robot.parameters.values),
            (seeds.entropy, seeds.spawn_key, seeds.n_children_spawned),
        )

    def measure(
        self, plan: ExperimentPlan, visit: int, progress: Progress | None = None
    ) -> Records:
        """Simulate one visit, with an independent stream of random numbers.

        Raises
        ------
        InvalidInput, SolverFailed
            As `robotmodels.simulation.simulate.simulate`.
        """
        seeds: Any = self.rng.bit_generator.seed_seq
        seed = np.random.SeedSequence(
            seeds.entropy,
            spawn_key=seeds.spawn_key,
            pool_size=seeds.pool_size,
            n_children_spawned=seeds.n_children_spawned + visit * plan.blocks,
        )
        (records,) = simulate(
            self.robot,
            plan.visited[visit : visit + 1],
            plan.reference(visit)[None],
            self.controller,
            lines=plan.multisine.lines,
            detection=plan.multisine.detection,
            imperfections=self.imperfections,
            rng=np.random.Generator(type(self.rng.bit_generator)(seed)),
            periods=plan.periods,
            transient=plan.transient_periods,
            envelope=plan.envelope,
            executor=self.executor,
            progress=progress,
        )
        return records


def run_plan(
    plan: ExperimentPlan,
    plant: Plant,
    folder: Path,
    progress: Progress | None = None,
    watch: Callable[[Iterator[Records]], Iterator[Records]] = iter,
) -> Path:
    """Carry out a plan: write plan.yaml, plan.h5 and records.h5 into `folder`.

    The records have one entry per visit, in the plan's order: a position that is visited twice
    appears twice, each time with different phases. Visits are written as they end, so that an
    interrupted run of the same plan goes on with the next.

    Parameters
    ----------
    plan : ExperimentPlan
        The plan, its amplitudes inside the limits.
    plant : Plant
        What the plan is carried out on.
    folder : Path
        Folder that exists.
    progress : Progress, optional
        Called with the number of blocks done and their total.
    watch : callable, optional
        Passes on the records of all visits on their way to the file.

    Returns
    -------
    Path
        The file of the records.

    Raises
    ------
    InvalidInput
        If there are files of another plan or plant; and what the plant raises.
    """
    plan.save(folder / "plan.yaml")
    files = [folder / f"visit_{v:05d}.h5" for v in range(len(plan.visited))]
    recognised = fingerprint((plan, plant.settings))
    for v, file in enumerate(files):
        visit = CheckpointFile(file, recognised, "visit", "a visit of another experiment")
        if file.exists():
            with visit.reading():
                continue
        done, total = v * plan.blocks, len(files) * plan.blocks
        after = None if progress is None else _after(progress, done, total)
        records = plant.measure(plan, v, after)
        with visit.writing() as unfinished:
            write_records(unfinished, [records], str(file))
    save_records(folder / "records.h5", watch(_records(files)))
    for file in files:
        file.unlink()
    return folder / "records.h5"


def run_experiment(
    prepared: Prepared,
    folder: Path,
    progress: StageProgress | None = None,
    executor: Executor | None = None,
    plant: ElasticRobot | None = None,
) -> Outcome:
    """Carry out a prepared experiment in simulation, see `run_plan`, and tell what it met.

    Parameters
    ----------
    plant : ElasticRobot, optional
        Robot to simulate instead of the one that the plan was made for.

    Raises
    ------
    InvalidInput, SolverFailed
        As `robotmodels.simulation.simulate.simulate`.
    """
    plan, begun = prepared.plan, time.perf_counter()
    simulated = SimulatedPlant(
        prepared.robot if plant is None else plant,
        prepared.controller,
        prepared.imperfections,
        prepared.rng,
        executor,
    )
    seen = _Seen(simulated.robot.encoders)
    report = None if progress is None else partial(progress, "simulation")
    run_plan(plan, simulated, folder, report, seen.watch)
    largest = prepared.scaling.peaks.largest.max(axis=0)
    return Outcome(
        peak_torque=seen.torque,
        peak_speed=seen.speed,
        predicted_torque=largest[0],
        predicted_speed=largest[1],
        saturated=seen.limited / max(seen.experiments, 1),
        seconds=time.perf_counter() - begun,
    )


def _after(progress: Progress, before: int, total: int) -> Progress:
    return lambda done, _: progress(before + done, total)


def _records(files: list[Path]) -> Iterator[Records]:
    for file in files:
        yield from iterate_records(file)


class _Seen:
    """Peaks of records that pass by on their way to the file."""

    def __init__(self, encoders: IntArray) -> None:
        """Watch records of a robot whose motors' encoders are these outputs; -1 of none."""
        self.encoders = encoders
        self.torque, self.speed, self.limited = np.zeros((3, len(encoders)))
        self.speed[encoders < 0] = np.nan
        self.experiments = 0

    def watch(self, parts: Iterator[Records]) -> Iterator[Records]:
        for part in parts:
            angle = part.angle[..., self.encoders]
            speed = np.diff(angle, axis=4) / part.sample_time
            self.torque = np.maximum(self.torque, np.abs(part.torque).max(axis=(0, 1, 2, 3, 4)))
            self.speed = np.maximum(self.speed, np.abs(speed).max(axis=(0, 1, 2, 3, 4)))
            met = part.saturated.any(axis=3)
            self.limited = self.limited + met.sum(axis=(0, 1, 2))
            self.experiments += int(np.prod(met.shape[:3]))
            yield part
