"""The stages of a study that give its data: simulated, from records or from FRFs."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from estimators.frf.distortion import Distortion
from estimators.frf.file_formats import read_frf
from estimators.frf.frf_estimate import FrfEstimate, simulate_frf
from estimators.frf.frf_from_records import measured_frf
from estimators.frf.repeated_visits import merge_visits
from oed.experiment.prepare import prepare_in
from oed.experiment.run_experiment import Outcome, run_experiment
from oed.study.stages.context import Run
from oed.study.stages.design_stages import Information, Plan
from oed.study.stages.serialisation import dataclass_files, read_dataclass, write_dataclass
from oed.study.stages.stage_cache import Files, Stage
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.common.fingerprints import file_digest
from robotmodels.common.progress import Progress


@dataclass(frozen=True, eq=False)
class Data:
    """What is fitted, and what is known of how it was measured.

    Attributes
    ----------
    estimate : FrfEstimate
        FRFs, one for each position.
    distortion : Distortion or None
        Noise and distortion apart; None without repeated periods.
    warnings : tuple of str
        What a user should know of the records.
    """

    estimate: FrfEstimate
    distortion: Distortion | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class SimulatedExperiment:
    """A simulated experiment.

    Attributes
    ----------
    records : Path
        File of its records.
    outcome : Outcome
        What the simulation met.
    limit : str
        The limit that sets the amplitudes, in words.
    """

    records: Path
    outcome: Outcome
    limit: str


def noisy_frf(run: Run, info: Stage[Information], plan: Stage[Plan]) -> Stage[Data]:
    """Return FRFs in the plan's positions, in the order of visits, with errors by the noise law."""

    def compute(folder: Path, report: Progress | None) -> Data:
        used = plan.value.used
        return Data(
            simulate_frf(
                run.plant,
                info.value.positions[used],
                run.omega,
                run.noise,
                run.rng("data"),
                repetitions=plan.value.exact.repetitions[used],
            )
        )

    inputs = {
        "plant": run.plant_digest,
        "information": info.digest,
        "design": plan.digest,
        "visits": plan.value.used.tolist(),
        **run.settings("frequencies", "noise", "seed"),
    }
    return run.stages.run("data", inputs, compute, dataclass_files(Data))


def experiment(run: Run, info: Stage[Information], plan: Stage[Plan]) -> Stage[SimulatedExperiment]:
    """Return the plan's experiments in the order of visits, simulated in closed loop."""
    shaking = run.study.data.experiment
    assert shaking is not None

    def compute(folder: Path, report: Progress | None) -> SimulatedExperiment:
        used = plan.value.used
        positions, repetitions = info.value.positions[used], plan.value.exact.repetitions[used]
        return shaken(run, positions, repetitions, run.rng("data"), folder, report)

    inputs = {
        "robot": run.robot_digest,
        "plant": run.plant_digest,
        "information": info.digest,
        "design": plan.digest,
        "visits": plan.value.used.tolist(),
        "experiment": shaking.model_dump(mode="json"),
        **run.settings("seed"),
    }
    return run.stages.run("experiment", inputs, compute, Files(_save_experiment, _load_experiment))


def shaken(
    run: Run,
    positions: Array,
    repetitions: IntArray,
    rng: np.random.Generator,
    folder: Path,
    report: Progress | None,
) -> SimulatedExperiment:
    """Simulate the study's experiment in positions (Q, n); records.h5 is written to `folder`."""
    shaking = run.study.data.experiment
    assert shaking is not None
    prepared = prepare_in(shaking, run.robot, positions, repetitions, rng)
    # Its progress is that of the stage, whatever it calls itself.
    progress = None if report is None else partial(_ignoring_names, report)
    outcome = run_experiment(prepared, folder, progress, run.executor, run.plant)
    return SimulatedExperiment(folder / "records.h5", outcome, str(prepared.scaling.binding))


def frf_of(run: Run, records: Path) -> Data:
    """Estimate FRFs from records as the study asks, visits of one position averaged."""
    choice = run.study.data
    found = measured_frf(
        records,
        choice.method,
        covariance=choice.covariance,
        structure=choice.structure,
        delay=choice.delay,
        hold=choice.hold,
        robot=run.study.robot,
    )
    return Data(found.estimate, found.distortion, found.warnings)


def frf_from_records(run: Run, records: Path, digest: str) -> Stage[Data]:
    """Return FRFs estimated from records, visits of one position averaged."""
    choice = run.study.data

    def compute(folder: Path, report: Progress | None) -> Data:
        return frf_of(run, records)

    inputs = {
        "robot": run.robot_digest,
        "records": digest,
        **{k: getattr(choice, k) for k in ("method", "covariance", "delay", "hold", "structure")},
    }
    return run.stages.run("data", inputs, compute, dataclass_files(Data))


def frf_from_file(run: Run, path: Path) -> Stage[Data]:
    """Return measured FRFs.

    Raises
    ------
    InvalidInput
        If they do not have the robot's motors and outputs.
    """

    def compute(folder: Path, report: Progress | None) -> Data:
        estimate = read_frf(path)
        _check_shape(estimate, run.robot, path)
        if run.study.data.structure == "diagonal":
            estimate = replace(estimate, covariance=estimate.variance)
        return Data(merge_visits(estimate))

    inputs = {
        "robot": run.robot_digest,
        "frf": file_digest(path),
        "structure": run.study.data.structure,
    }
    return run.stages.run("data", inputs, compute, dataclass_files(Data))


def _check_shape(estimate: FrfEstimate, robot: ElasticRobot, path: Path) -> None:
    needed = len(robot.output_names), len(robot.motor_names)
    if estimate.response.shape[2:] != needed or estimate.positions.shape[1] != needed[1]:
        raise InvalidInput(
            f"{path}: FRFs of shape {estimate.response.shape[2:]} in positions of "
            f"{estimate.positions.shape[1]} angles; the robot {robot.name!r} has "
            f"{needed[0]} outputs and {needed[1]} motors"
        )


def _ignoring_names(report: Progress, stage: str, done: int, total: int) -> None:
    report(done, total)


def _save_experiment(value: SimulatedExperiment, folder: Path) -> None:
    write_dataclass(folder / "outcome.h5", value.outcome)
    (folder / "limit.txt").write_text(value.limit, encoding="utf-8")


def _load_experiment(folder: Path) -> SimulatedExperiment:
    return SimulatedExperiment(
        folder / "records.h5",
        read_dataclass(folder / "outcome.h5", Outcome),
        (folder / "limit.txt").read_text(encoding="utf-8"),
    )
