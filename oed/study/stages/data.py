"""The stage ``data``: the FRFs that are fitted, by the noise law, from records or from a file.

Or, of records, the spectra of their runs.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from estimators.fitting.fit_problem import Measured
from estimators.fitting.run_problem import check_model
from estimators.fitting.settled_runs import settled_fit
from estimators.frf.distortion import Distortion
from estimators.frf.file_formats import read_frf, read_records
from estimators.frf.frf_estimate import FrfEstimate, simulate_frf
from estimators.frf.frf_from_records import (
    collected_warnings,
    measured_frf,
    recorded_seconds,
)
from estimators.frf.repeated_visits import merge_visits
from estimators.frf.rigid_body_check import rigid_limit
from estimators.input_output.run_frf import check_rigid_runs
from estimators.input_output.run_spectra import RunSpectra, run_spectra
from oed.study.stage_cache import Stage, dataclass_files
from oed.study.stages.run import MeasuredRun, Run, SimulatedRun, Visits
from robotmodels import ElasticRobot
from robotmodels.common.arrays import IntArray
from robotmodels.common.errors import InvalidInput, naming
from robotmodels.common.fingerprints import file_digest
from robotmodels.common.progress import Progress


@dataclass(frozen=True, eq=False)
class Data:
    """What is fitted, and what its records say beside.

    Attributes
    ----------
    estimate : FrfEstimate or RunSpectra
        FRFs, one for each position; or runs, of each visit to a position.
    distortion : Distortion or None
        Noise and distortion separately; None without repeated periods.
    warnings : tuple of str
        Warnings about the records or FRFs.
    """

    estimate: Measured
    distortion: Distortion | None = None
    warnings: tuple[str, ...] = ()

    @property
    def frf(self) -> FrfEstimate:
        """The FRFs.

        Raises
        ------
        InvalidInput
            If runs are fitted.
        """
        if isinstance(self.estimate, RunSpectra):
            raise InvalidInput("fit: frequency responses are needed; these data are runs (sml)")
        return self.estimate

    @property
    def repetitions(self) -> IntArray:
        """How many experiments each of the positions stands for, (Q,)."""
        if isinstance(self.estimate, RunSpectra):
            return np.ones(len(self.estimate.positions), dtype=np.int64)
        return self.estimate.repetitions

    @property
    def columns(self) -> int:
        """How many runs, or inputs of FRFs, each position has."""
        if isinstance(self.estimate, RunSpectra):
            return int(self.estimate.inputs.shape[1])
        return int(self.estimate.response.shape[3])


def data_by_noise_law(run: SimulatedRun, visits: Visits) -> Stage[Data]:
    """Return FRFs in the positions of a plan, with errors by the noise law."""

    def compute(folder: Path, report: Progress | None) -> Data:
        return Data(
            simulate_frf(
                run.plant,
                visits.positions,
                run.omega,
                run.noise,
                run.rng("data"),
                repetitions=visits.repetitions,
            )
        )

    inputs = {
        "plant": run.plant_digest,
        **visits.key,
        **run.settings("frequencies", "noise", "seed"),
    }
    return run.stages.run("data", inputs, compute, dataclass_files(Data))


def data_from_records(run: Run, records: Path, digest: str) -> Stage[Data]:
    """Return the data of records: spectra of runs, or FRFs, visits of one position averaged."""
    kinds = {True: ("noise", "friction"), False: ("method", "covariance", "structure")}
    settings = run.study.data.model_dump(mode="json")

    def compute(folder: Path, report: Progress | None) -> Data:
        return read_data(run, records, report)

    inputs = {
        "robot": run.robot_digest,
        "records": digest,
        **{key: settings[key] for key in ("delay", "hold", *kinds[run.study.fits_runs])},
    }
    if run.study.data.friction:
        inputs |= {"starts": run.starts.tolist(), **run.prior_key}
    return run.stages.run("data", inputs, compute, dataclass_files(Data))


def read_data(run: Run, records: Path, progress: Progress | None = None) -> Data:
    """Read the data of records as the study asks; friction settles by a search from its starts.

    Raises
    ------
    InvalidInput
        If they are of another robot, or cannot be read so.
    """
    choice = run.study.data
    if run.study.fits_runs:
        with collected_warnings() as warnings, naming(records):
            recorded = read_records(records)
            options: dict[str, Any] = {"hold": choice.hold, "delay": choice.delay}
            if choice.friction:
                options |= {"prior": run.prior, "executor": run.executor, "progress": progress}
                runs = settled_fit(run.robot, recorded, run.starts, choice.noise, **options)[0].data
            else:
                runs = run_spectra(recorded, choice.noise, **options)
            check_model(run.robot, runs)
            runs = runs.without_images(run.robot)
            check_rigid_runs(runs, run.robot)
        return Data(runs, warnings=tuple(warnings))
    measured = measured_frf(
        records,
        choice.method,
        covariance=choice.covariance,
        structure=choice.structure,
        delay=choice.delay,
        hold=choice.hold,
        robot=run.study.robot,
    )
    return Data(measured.estimate, measured.distortion, measured.warnings)


def measured_data(run: MeasuredRun) -> Stage[Data]:
    """Return the FRFs of a study's file, of records or of FRFs.

    Raises
    ------
    InvalidInput
        If they do not have the robot's motors and outputs.
    """
    if run.content == "records":
        return data_from_records(run, run.file, file_digest(run.file))

    def compute(folder: Path, report: Progress | None) -> Data:
        estimate = read_frf(run.file)
        _check_shape(estimate, run.robot, run.file)
        if run.study.data.structure == "diagonal":
            estimate = replace(estimate, covariance=estimate.variance)
        estimate = merge_visits(estimate)
        return Data(estimate, warnings=rigid_limit(estimate, run.robot).messages)

    inputs = {
        "robot": run.robot_digest,
        "frf": file_digest(run.file),
        "structure": run.study.data.structure,
        "checked": 1,
    }
    return run.stages.run("data", inputs, compute, dataclass_files(Data))


@dataclass(frozen=True)
class RecordedTime:
    """How long the measured periods of all runs are together [s]."""

    seconds: float


def recorded_time(run: MeasuredRun) -> float | None:
    """Return how long the runs of a study's records are [s]; None of frequency responses."""
    if run.content != "records":
        return None

    def compute(folder: Path, report: Progress | None) -> RecordedTime:
        return RecordedTime(recorded_seconds(run.file))

    inputs, files = {"records": file_digest(run.file)}, dataclass_files(RecordedTime)
    return run.stages.run("recorded", inputs, compute, files).value.seconds


def _check_shape(estimate: FrfEstimate, robot: ElasticRobot, path: Path) -> None:
    needed = len(robot.output_names), len(robot.motor_names)
    if estimate.response.shape[2:] != needed or estimate.positions.shape[1] != needed[1]:
        raise InvalidInput(
            f"{path}: FRFs of shape {estimate.response.shape[2:]} in positions of "
            f"{estimate.positions.shape[1]} angles; the robot {robot.name!r} has "
            f"{needed[0]} outputs and {needed[1]} motors"
        )
