"""The experiment: what a simulation in closed loop met, and what the data hold beside noise."""

import numpy as np

from oed.study.results import StudyResults
from reports import text
from reports.page_elements import Cell, Column, Number, Section, Table, filled, numbers, table
from robotmodels.common.arrays import Array


def section(results: StudyResults) -> Section | None:
    """Return the section; none where FRFs came with noise by a law, or as such."""
    if results.experiment is None and results.distortion is None and not results.warnings:
        return None
    body = filled(
        "experiment.html.j2",
        results=results,
        peaks=None if results.experiment is None else peak_table(results),
        levels=None if results.distortion is None else level_table(results),
    )
    return Section("experiment", "Experiment", body)


def peak_table(results: StudyResults) -> Table:
    """Return predicted and met peaks of each motor."""
    assert results.experiment is not None
    o = results.experiment.outcome
    columns = (o.predicted_torque, o.peak_torque, o.predicted_speed, o.peak_speed)
    rows: list[list[Cell]] = []
    for i, motor in enumerate(results.robot.motor_names):
        values = [Number(text.significant(float(c[i])), float(c[i])) for c in columns]
        saturated = float(o.saturated[i])
        rows.append(
            [motor, *values, Number(text.percent(saturated) if saturated else "–", saturated)]
        )
    titles = numbers(
        "torque predicted [N m]", "met [N m]", "speed predicted [rad/s]", "met [rad/s]", "saturated"
    )
    caption = (
        "Peaks on the motor shafts: predicted by the linear model, start of each run "
        "included, and met in the measured periods; runs in which the torque was clipped."
    )
    return table("peaks", caption, [Column("motor"), *titles], rows)


def level_table(results: StudyResults) -> Table:
    """Return noise and distortion of each output, medians over positions, lines and inputs."""
    found, size = results.distortion, np.abs(results.estimate.response)
    assert found is not None
    apart = np.sqrt(np.maximum(found.total - found.noise, 0.0))
    rows = []
    for i, output in enumerate(results.robot.output_names):
        scale = float(np.median(size[:, :, i]))
        noise, distortion = (_median(a[:, :, i]) / scale for a in (np.sqrt(found.noise), apart))
        rows.append(
            [output]
            + [
                Number(text.percent(v) if np.isfinite(v) else "–", v)
                for v in (
                    noise,
                    distortion,
                    _ratio(found.odd_level, found.output, i),
                    _ratio(found.even_level, found.output, i),
                )
            ]
        )
    caption = (
        "Noise and distortion over the median element of the row, medians over positions, lines "
        "and inputs; odd and even distortion over the excited motion."
    )
    titles = numbers("noise", "distortion", "odd", "even")
    return table("levels", caption, [Column("output"), *titles], rows)


def _median(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def _ratio(level: Array, output: Array, i: int) -> float:
    if not level.size:
        return float("nan")
    return float(np.sqrt(np.mean(level[..., i] ** 2) / np.mean(output[..., i] ** 2)))
