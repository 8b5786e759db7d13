"""The experiments: what a simulation in closed loop met, and what the data hold beside noise."""

import numpy as np

from estimators.frf.distortion import Distortion
from estimators.frf.frf_estimate import FrfEstimate
from oed.experiment.loop_settings import per_motor
from oed.experiment.run_experiment import Outcome
from oed.study.parts import SimulatedData
from oed.study.results import StudyResults
from oed.study.stages.experiment import SimulatedExperiment
from reports import text
from reports.figures import excitation_figures
from reports.figures.excitation_figures import run_of
from reports.page_elements import (
    Cell,
    Column,
    Figure,
    Number,
    Section,
    Table,
    figure,
    filled,
    in_unit,
    percent_cell,
    table,
)
from robotmodels.common.arrays import Array
from robotmodels.records.records import iterate_records


def section(results: StudyResults) -> Section | None:
    """Return the section; none where FRFs came with noise by a law, or as such."""
    data = results.data
    experiment = data.experiment if isinstance(data, SimulatedData) else None
    if experiment is None and data.distortion is None and not data.warnings:
        return None
    motors, outputs = results.robot.motor_names, results.robot.output_names
    body = filled(
        "experiment.html.j2",
        experiment=experiment,
        warnings=data.warnings,
        peaks=None if experiment is None else peak_table(experiment.outcome, motors),
        levels=None if data.distortion is None else level_table(data.distortion, data.frf, outputs),
        excitation=excitation(results, experiment),
    )
    return Section("experiment", "Experiments", body)


def excitation(results: StudyResults, experiment: SimulatedExperiment | None) -> list[Figure]:
    """Return the first run of the first visit against its limits; none without its records."""
    settings = results.study.data.experiment
    if experiment is None or settings is None or not experiment.records.exists():
        return []
    records = next(iterate_records(experiment.records))
    if records.angle.shape[-1] < len(results.robot.motor_names) or (records.derivatives != 2).any():
        return []
    limits = {
        name: per_motor(name, value, results.robot.motor_names)
        for name in ("torque", "speed", "swing")
        if (value := getattr(settings.limits, name)) is not None
    }
    if "swing" in limits:  # of the arm side; angles are those of the shafts
        limits["swing"] = limits["swing"] * np.array(
            [m.gear_ratio for m in results.robot.file.motors]
        )
    drawing = excitation_figures.excitation(run_of(records), results.robot.motor_names, limits)
    return [figure(*half) for half in excitation_figures.halves("excitation", drawing)]


def peak_table(o: Outcome, motors: tuple[str, ...]) -> Table:
    """Return predicted and met peaks of each motor."""
    columns = (o.predicted_torque, o.peak_torque, o.predicted_speed, o.peak_speed)
    rows: list[list[Cell]] = []
    for i, motor in enumerate(motors):
        values = [Number(text.significant(float(c[i])), float(c[i])) for c in columns]
        saturated = float(o.saturated[i])
        rows.append([motor, *values, percent_cell(saturated)])
    titles = [
        *in_unit("N m", "predicted torque", "peak torque"),
        *in_unit("rad/s", "predicted speed", "peak speed"),
        *in_unit("%", "saturated"),
    ]
    caption = (
        "Peaks on the motor shafts: predicted by the linear model, including the start of each "
        "run, and simulated in the measured periods; share of runs with saturated torque."
    )
    return table("peaks", caption, [Column("motor"), *titles], rows)


def level_table(distortion: Distortion, estimate: FrfEstimate, outputs: tuple[str, ...]) -> Table:
    """Return noise and distortion of each output, medians over positions, lines and inputs."""
    size, noise = np.abs(estimate.response), np.sqrt(distortion.noise)
    beside = np.sqrt(np.maximum(distortion.total - distortion.noise, 0.0))
    rows = []
    for i, output in enumerate(outputs):
        scale = float(np.median(size[:, :, i]))
        rows.append(
            [output]
            + [
                percent_cell(v)
                for v in (
                    _median(noise[:, :, i]) / scale,
                    _median(beside[:, :, i]) / scale,
                    _ratio(distortion.odd_level, distortion.output, i),
                    _ratio(distortion.even_level, distortion.output, i),
                )
            ]
        )
    caption = (
        "Noise and distortion over the median element of the row, medians over positions, lines "
        "and inputs; odd and even distortion over the excited motion."
    )
    titles = in_unit("%", "noise", "distortion", "odd", "even")
    return table("levels", caption, [Column("output"), *titles], rows)


def _median(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else float("nan")


def _ratio(level: Array, output: Array, i: int) -> float:
    if not level.size:
        return float("nan")
    return float(np.sqrt(np.mean(level[..., i] ** 2) / np.mean(output[..., i] ** 2)))
