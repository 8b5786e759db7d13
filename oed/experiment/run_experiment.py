"""The simulation of a planned experiment: visit by visit, from where an earlier run was stopped."""

import time
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from oed.experiment.prepare import Prepared
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array
from robotmodels.common.checkpoint_file import CheckpointFile
from robotmodels.common.fingerprints import fingerprint
from robotmodels.common.progress import Progress, StageProgress
from robotmodels.library.robot_digest import robot_digest
from robotmodels.records.records import Records, iterate_records, save_records, write_records
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


def run_experiment(
    prepared: Prepared,
    folder: Path,
    progress: StageProgress | None = None,
    executor: Executor | None = None,
    plant: ElasticRobot | None = None,
) -> Outcome:
    """Write plan.yaml and plan.h5, simulate, and write records.h5 into `folder`.

    The records have one entry per visit, in the plan's order: a position that is visited twice
    appears twice, each time with phases of its own. Visits are written as they end, so that an
    interrupted run of the same plan goes on with the next.

    Parameters
    ----------
    plant : ElasticRobot, optional
        Robot to simulate in place of the one that the plan was made for.

    Raises
    ------
    InvalidInput, SolverFailed
        As `robotmodels.simulation.simulate.simulate`.
    """
    plan = prepared.plan
    plan.save(folder / "plan.yaml")
    begun = time.perf_counter()
    report = None if progress is None else partial(progress, "simulation")
    files = _simulated_visits(prepared, folder, report, executor, plant)
    seen = _Seen(len(plan.motors))
    save_records(folder / "records.h5", seen.watch(_records(files)))
    for file in files:
        file.unlink()
    largest = prepared.scaling.peaks.largest.max(axis=0)
    return Outcome(
        peak_torque=seen.torque,
        peak_speed=seen.speed,
        predicted_torque=largest[0],
        predicted_speed=largest[1],
        saturated=seen.limited / max(seen.experiments, 1),
        seconds=time.perf_counter() - begun,
    )


def _simulated_visits(
    prepared: Prepared,
    folder: Path,
    progress: Progress | None,
    executor: Executor | None,
    plant: ElasticRobot | None,
) -> list[Path]:
    """Simulate the visits that have no file yet; return the files of all."""
    plan, blocks = prepared.plan, prepared.plan.blocks
    visits, signals = plan.visited, plan.signals
    simulated = prepared.robot if plant is None else plant
    files = [folder / f"visit_{v:05d}.h5" for v in range(len(visits))]
    told = _fingerprint(prepared, simulated)
    for v, file in enumerate(files):
        visit = CheckpointFile(file, told, "visit", "a visit of another experiment")
        if file.exists():
            with visit.reading():
                prepared.rng.spawn(blocks)  # the random numbers of the blocks it holds
            continue
        records = simulate(
            simulated,
            visits[v : v + 1],
            signals[v : v + 1],
            prepared.controller,
            lines=plan.multisine.lines,
            detection=plan.multisine.detection,
            imperfections=prepared.imperfections,
            rng=prepared.rng,
            periods=plan.periods,
            transient=plan.transient_periods,
            executor=executor,
            progress=None
            if progress is None
            else _after(progress, v * blocks, len(files) * blocks),
        )
        with visit.writing() as unfinished:
            write_records(unfinished, records, str(file))
    return files


def _fingerprint(prepared: Prepared, plant: ElasticRobot) -> str:
    """Return what tells the visits of one experiment from those of another."""
    seeds: Any = prepared.rng.bit_generator.seed_seq
    given = (
        (prepared.plan, prepared.controller, prepared.imperfections),
        (robot_digest(plant), plant.parameters.values),
        (seeds.entropy, seeds.spawn_key, seeds.n_children_spawned),
    )
    return fingerprint(given)


def _after(progress: Progress, before: int, total: int) -> Progress:
    return lambda done, _: progress(before + done, total)


def _records(files: list[Path]) -> Iterator[Records]:
    for file in files:
        yield from iterate_records(file)


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
