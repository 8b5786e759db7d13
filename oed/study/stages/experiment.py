"""The stage ``experiment``: the plan carried out in a simulation in closed loop."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from oed.experiment.experiment_file import ExcitationSettings
from oed.experiment.prepare import prepare_in
from oed.experiment.run_experiment import Outcome, run_experiment
from oed.study.stage_cache import Files, Stage
from oed.study.stages.run import SimulatedRun, Visits
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.dataclass_files import read_dataclass, write_dataclass
from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import Progress


@dataclass(frozen=True, eq=False)
class SimulatedExperiment:
    """A simulated experiment.

    Attributes
    ----------
    records : Path
        File of its records.
    outcome : Outcome
        Peaks and saturation in the simulation.
    limit : str
        The limit that sets the amplitudes, in words.
    """

    records: Path
    outcome: Outcome
    limit: str


def experiment(
    run: SimulatedRun, excitation: ExcitationSettings, visits: Visits
) -> Stage[SimulatedExperiment]:
    """Return the plan's experiments in the order of visits, simulated in closed loop."""

    def compute(folder: Path, report: Progress | None) -> SimulatedExperiment:
        positions, repetitions, rng = visits.positions, visits.repetitions, run.rng("data")
        return simulate_experiment(run, excitation, positions, repetitions, rng, folder, report)

    inputs = {
        "robot": run.robot_digest,
        "plant": run.plant_digest,
        **visits.key,
        "experiment": excitation.model_dump(mode="json"),
        **run.settings("seed"),
    }
    return run.stages.run("experiment", inputs, compute, Files(_save, _load))


def runs_of_block(run: SimulatedRun) -> int:
    """Return how many runs a block has.

    Raises
    ------
    InvalidInput
        If FRFs need more, or there are more than motors.
    """
    excitation, motors = run.study.data.experiment, len(run.robot.motor_names)
    runs = motors if excitation is None else excitation.runs or motors
    if runs > motors:
        raise InvalidInput(f"data.experiment.runs: {runs}; a block has 1 to {motors}")
    if runs < motors and not run.study.fits_runs:
        raise InvalidInput(
            f"data.experiment.runs: {runs}; FRFs need {motors}, as many as motors: leave it out, "
            "or fit runs (residual sml)"
        )
    return runs


def simulate_experiment(
    run: SimulatedRun,
    excitation: ExcitationSettings,
    positions: Array,
    repetitions: IntArray,
    rng: np.random.Generator,
    folder: Path,
    report: Progress | None,
) -> SimulatedExperiment:
    """Simulate an experiment in positions (Q, n); records.h5 is written to `folder`."""
    prepared = prepare_in(excitation, run.robot, positions, repetitions, rng)
    # Its progress is that of the stage, whatever it calls itself.
    progress = None if report is None else partial(_ignoring_names, report)
    outcome = run_experiment(prepared, folder, progress, run.executor, run.plant)
    return SimulatedExperiment(folder / "records.h5", outcome, str(prepared.scaling.binding))


def _ignoring_names(report: Progress, stage: str, done: int, total: int) -> None:
    report(done, total)


def _save(value: SimulatedExperiment, folder: Path) -> None:
    write_dataclass(folder / "outcome.h5", value.outcome)
    (folder / "limit.txt").write_text(value.limit, encoding="utf-8")


def _load(folder: Path) -> SimulatedExperiment:
    return SimulatedExperiment(
        folder / "records.h5",
        read_dataclass(folder / "outcome.h5", Outcome),
        (folder / "limit.txt").read_text(encoding="utf-8"),
    )
