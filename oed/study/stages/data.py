"""The stage ``data``: the FRFs that are fitted, by the noise law, from records or from a file."""

from dataclasses import dataclass, replace
from pathlib import Path

from estimators.frf.distortion import Distortion
from estimators.frf.file_formats import read_frf
from estimators.frf.frf_estimate import FrfEstimate, simulate_frf
from estimators.frf.frf_from_records import measured_frf
from estimators.frf.repeated_visits import merge_visits
from estimators.frf.rigid_body_check import rigid_limit
from oed.study.stage_cache import Stage, dataclass_files
from oed.study.stages.run import MeasuredRun, Run, SimulatedRun, Visits
from robotmodels import ElasticRobot
from robotmodels.common.errors import InvalidInput
from robotmodels.common.fingerprints import file_digest
from robotmodels.common.progress import Progress


@dataclass(frozen=True, eq=False)
class Data:
    """FRFs to fit, and what their records say beside them.

    Attributes
    ----------
    estimate : FrfEstimate
        FRFs, one for each position.
    distortion : Distortion or None
        Noise and distortion separately; None without repeated periods.
    warnings : tuple of str
        Warnings about the records or FRFs.
    """

    estimate: FrfEstimate
    distortion: Distortion | None = None
    warnings: tuple[str, ...] = ()


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


def frf_of(run: Run, records: Path) -> Data:
    """Estimate FRFs from records as the study asks, visits of one position averaged."""
    choice = run.study.data
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


def _check_shape(estimate: FrfEstimate, robot: ElasticRobot, path: Path) -> None:
    needed = len(robot.output_names), len(robot.motor_names)
    if estimate.response.shape[2:] != needed or estimate.positions.shape[1] != needed[1]:
        raise InvalidInput(
            f"{path}: FRFs of shape {estimate.response.shape[2:]} in positions of "
            f"{estimate.positions.shape[1]} angles; the robot {robot.name!r} has "
            f"{needed[0]} outputs and {needed[1]} motors"
        )
