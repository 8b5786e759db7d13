"""The page of ``oed frf``: one HTML file."""

from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from estimators.frf.frf_from_records import MeasuredFrf
from estimators.frf.method_comparison import MethodComparison
from reports import text
from reports.figures import excitation_figures, response_panels
from reports.figures.frf_figures import detection_panels
from reports.figures.response_data import ResponseData
from reports.figures.response_panels import lines_drawn
from reports.page_elements import (
    Cell,
    Column,
    Figure,
    Number,
    Section,
    Table,
    figure,
    filled,
    number_cell,
    numbers,
    page,
    page_banner,
    percent_cell,
    table,
)
from reports.summaries.frf_summary import excess, loop_words, ranked, relative_std
from robotmodels.common.arrays import Array
from robotmodels.common.atomic_files import write_text
from robotmodels.common.progress import StageProgress, tell

_DISTORTED = 2.0
"""Total variance over that of noise from which distortion dominates."""


def write_frf_page(
    measurement: MeasuredFrf, source: Path, path: Path, progress: StageProgress | None = None
) -> None:
    """Write FRFs as one HTML file that needs nothing else."""
    title = measurement.robot.name if measurement.robot is not None else source.name
    write_text(
        path,
        page(
            title=title,
            kind="measured frequency responses",
            kicker="Measured frequency responses of an elastic robot",
            lead=(
                "From motor torque to motor acceleration, with standard deviations by noise and "
                "distortion."
            ),
            sections=frf_sections(measurement, source, progress),
            banner=_banner(measurement),
        ),
    )


def _banner(measurement: MeasuredFrf) -> Markup:
    """Return how good the FRFs are, and what would make them better."""
    std = text.percent(float(np.median(relative_std(measurement))))
    verdict = f"Median standard deviation of the frequency responses: {std}"
    warnings, ratio = measurement.warnings, excess(measurement)
    reason = text.sentence(warnings[0]) if warnings else "No warning"
    step = "fit them: oed identify, or a study with data.frf"
    if np.isfinite(ratio) and ratio > _DISTORTED:
        step = (
            "for smaller standard deviations measure more blocks; more periods would not help, as "
            "distortion dominates"
        )
    return page_banner(verdict, "doubtful" if warnings else "sound", reason, next_step=step)


def frf_sections(
    measurement: MeasuredFrf, source: Path, progress: StageProgress | None = None
) -> list[Section]:
    """Return the sections of the page."""
    total, responses, detection = len(measurement.estimate.positions), [], []
    for q in range(total):
        responses.append(_response(measurement, q))
        if (lines := _detection(measurement, q)) is not None:
            detection.append(lines)
        tell(progress, "page", q + 1, total)
    contents: list[tuple[str, str, dict[str, Any]]] = [
        ("summary", "Summary", {"facts": _facts(measurement), "source": source}),
        (
            "responses",
            "Frequency responses",
            {
                "panels": responses,
                "lines": len(lines_drawn(measurement.estimate.response.shape)),
                "embedded": _embedded(measurement),
            },
        ),
        ("levels", "Levels", {"levels": level_table(measurement)}),
        (
            "excitation",
            "Excitation",
            {
                "excitation": excitation_table(measurement),
                "torque_loop": _loops(measurement),
                "run": _first_run(measurement),
            },
        ),
    ]
    if measurement.distortion is not None:
        contents.insert(2, ("distortion", "Distortion", {"panels": detection}))
    if measurement.comparison is not None:
        contents.append(("methods", "Methods", {"methods": method_table(measurement.comparison)}))
    return [
        Section(name, title, filled(f"frf_{name}.html.j2", measurement=measurement, **parts))
        for name, title, parts in contents
    ]


def _facts(measurement: MeasuredFrf) -> dict[str, str]:
    """Return numbers that appear in sentences."""
    r, e = measurement.first, measurement.estimate
    blocks, runs, periods = r.torque.shape[1:4]
    return {
        "positions": text.plural(len(e.positions), "position"),
        "blocks": text.plural(blocks, "block"),
        "runs": text.plural(runs, "run"),
        "periods": text.plural(periods, "period"),
        "period": text.significant(r.samples * r.sample_time, 3) + f"{text.THIN}s",
        "lines": text.plural(len(e.omega), "line"),
        "low": text.hertz(e.omega[0]),
        "high": text.hertz(e.omega[-1]),
        "std": text.percent(float(np.median(relative_std(measurement)))),
        "excess": _ratio(excess(measurement)),
        "missing": text.plural(measurement.missing, "run"),
    }


def _response(measurement: MeasuredFrf, q: int) -> Figure:
    e, d = measurement.estimate, measurement.distortion
    outputs, lines = list(measurement.outputs), lines_drawn(e.response.shape)
    drawing = response_panels.response_panels(
        e.omega[lines],
        e.response[q, lines],
        np.sqrt(e.variance[q, lines]),
        None if measurement.modelled is None else measurement.modelled[q, lines],
        measurement.motors,
        noise=None if d is None else np.sqrt(d.noise[q, lines]),
        distortion=None if d is None else mean_distortion(measurement)[q, lines],
        outputs=outputs,
    )
    alt = (
        f"Magnitudes and phases of the measured frequency responses in position {q + 1}, with "
        "their standard deviations and what of them is noise and distortion"
    )
    wide = len(outputs) > 2
    return figure(f"frf-{q + 1}", drawing, alt, label=_label(measurement, q), wide=wide)


def _embedded(measurement: MeasuredFrf) -> Markup:
    """Return the data with which the page's script enlarges single elements."""
    e, robot = measurement.estimate, measurement.robot
    lines = lines_drawn(e.response.shape)
    model = None if measurement.modelled is None else measurement.modelled[:, lines]
    omega, std = e.omega[lines], np.sqrt(e.variance[:, lines])
    shown = ResponseData(omega, e.response[:, lines], std, e.repetitions, omega, model)
    units = ["rad/s^2"] * len(measurement.outputs) if robot is None else robot.output_units
    ids = [f"frf-{q + 1}" for q in range(len(e.positions))]
    return shown.embedded(ids, measurement.motors, measurement.outputs, units)


def _detection(measurement: MeasuredFrf, q: int) -> Figure | None:
    """Return motion between excited lines; none without detection lines."""
    d, outputs = measurement.distortion, list(measurement.outputs)
    if d is None or not len(d.odd_omega) + len(d.even_omega):
        return None
    alt = f"Motion at excited, odd and even detection lines in position {q + 1}"
    drawing = detection_panels(d, q, outputs)
    wide = len(outputs) > 2
    return figure(f"detection-{q + 1}", drawing, alt, label=_label(measurement, q), wide=wide)


def _label(measurement: MeasuredFrf, q: int) -> str:
    """Return a position's number, its angles, and which experiments are averaged."""
    coordinates = ", ".join(
        text.format_position(measurement.estimate.positions[q], prismatic_joints(measurement))
    )
    label = f"Position {q + 1}: {coordinates}"
    if len(measurement.visits[q]) > 1:
        label += f"; mean of experiments {text.ranges([i + 1 for i in measurement.visits[q]])}"
    return label


def prismatic_joints(measurement: MeasuredFrf) -> list[bool]:
    """Return a mask of the prismatic coordinates; all false without a robot."""
    if measurement.robot is None:
        return [False] * measurement.estimate.positions.shape[1]
    return [
        joint in measurement.robot.elements.prismatic for joint in measurement.robot.motor_joints
    ]


def mean_distortion(measurement: MeasuredFrf) -> Array:
    """Return the part of the FRFs' standard deviations that is distortion, (Q, F, m, n)."""
    d = measurement.distortion
    if d is None:
        return np.full(measurement.estimate.response.shape, np.nan)
    return np.asarray(np.sqrt(np.maximum(d.total - d.noise, 0.0)))


def level_table(measurement: MeasuredFrf) -> Table:
    """Return medians over lines and inputs, for each position and output."""
    e, d = measurement.estimate, measurement.distortion
    size, rows = np.abs(e.response), []
    std, noise = (np.sqrt(v) / size for v in (e.variance, e.variance if d is None else d.noise))
    distortion = mean_distortion(measurement) / size
    for q, i in np.ndindex(e.response.shape[0], e.response.shape[2]):
        row: list[Cell] = [Number(str(q + 1), q + 1), measurement.outputs[i]]
        row.append(_percent(std[q, :, i]))
        row += ["–" if d is None else _percent(noise[q, :, i]), _percent(distortion[q, :, i])]
        if d is None:
            row += ["–", "–"]
        else:
            levels = (d.odd_level, d.even_level)
            row += [_below(level[q, :, i], d.output[q, :, i]) for level in levels]
        rows.append(row)
    columns = [
        *numbers("position"),
        Column("output"),
        *numbers("std [%]", "noise [%]", "distortion [%]", "odd [dB]", "even [dB]"),
    ]
    caption = (
        "Standard deviations relative to the element, medians over lines and inputs; odd and even "
        "distortion relative to the excited motion."
    )
    return table("level-table", caption, columns, rows)


def _first_run(measurement: MeasuredFrf) -> list[Figure]:
    """Return the signals of the first run; none where outputs are not the motors' angles."""
    records, motors = measurement.first, measurement.motors
    if (records.derivatives != 2).any() or records.angle.shape[-1] != len(motors):
        return []
    shown = excitation_figures.run_of(records)
    if not (np.isfinite(shown.torque).all() and np.isfinite(shown.angle).all()):
        return []
    drawing = excitation_figures.excitation(shown, motors, {})
    return [figure(*half) for half in excitation_figures.halves("first-run", drawing)]


def _loops(measurement: MeasuredFrf) -> list[str]:
    """Return the torque loops in words; none where records hold no commands."""
    loop = measurement.torque_loop
    return [] if loop is None else loop_words(loop, measurement.motors)


def excitation_table(measurement: MeasuredFrf) -> Table:
    """Return independent torques and condition number of every line, a column a position."""
    e, rows = measurement.excitation, []
    for f, omega in enumerate(e.omega):
        row: list[Cell] = [number_cell(omega / (2 * np.pi), text.significant)]
        row.append(Number(str(e.rank[:, f].min()), int(e.rank[:, f].min())))
        row += [Number(text.significant(float(c), 3), float(c)) for c in e.condition[:, f]]
        rows.append(row)
    count = len(e.positions)
    columns = numbers(
        "frequency [Hz]", "independent", *(f"condition {q + 1}" for q in range(count))
    )
    caption = (
        "Independent torques above their noise, the fewest of any position, and the condition "
        "number in each position."
    )
    return table("excitation-table", caption, columns, rows)


def method_table(comparison: MethodComparison) -> Table:
    """Return the methods, best first, with relative error and bias, rms over lines."""
    rows = [
        (name.upper(), percent_cell(error), percent_cell(bias))
        for name, error, bias in ranked(comparison)
    ]
    caption = "Relative error and bias, root mean square over lines, best first."
    columns = [Column("method"), *numbers("error [%]", "bias [%]")]
    return table("method-table", caption, columns, rows)


def _percent(values: Array) -> Cell:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return "–"
    median = float(np.median(finite))
    return percent_cell(median)


def _ratio(value: float) -> str:
    return text.significant(value, 2) if np.isfinite(value) else ""


def _below(level: Array, output: Array) -> Cell:
    """Return how far distortion lies below the excited motion, both rms over their lines."""
    if not level.size:
        return "–"
    ratio = float(np.sqrt(np.mean(level**2)) / np.sqrt(np.mean(output**2)))
    if ratio == 0:
        return "in noise"
    decibels = 20 * float(np.log10(ratio))
    return Number(text.fixed(round(decibels) + 0.0, 0), decibels)
