"""What ``oed predict`` and ``oed margins`` say: tables for a terminal, JSON, and CSV for others."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimators.validation.margin_bands import MarginBand, Suggestion
from estimators.validation.predict import Prediction
from estimators.validation.predict_tool import ToolPrediction
from reports import text
from reports.summaries.columns import number, plain, table
from robotmodels.common.arrays import Array
from robotmodels.common.plain_data import json_data

_MOST = 20
"""Positions that a terminal shows."""


def tool_summary(prediction: ToolPrediction, spread: str, written: Sequence[Path]) -> str:
    """Return compliance, resonances and damping with standard deviations, position by position."""
    rows = []
    for i in range(len(prediction.points)):
        compliance = [_cell(prediction.compliance, i, k, 1e6) for k in range(3)]
        resonance = _cell(prediction.resonances, i, 0, 1 / (2 * np.pi))
        rows.append((f"{i + 1}", *compliance, resonance, _cell(prediction.damping, i, 0, 100.0)))
    header = (
        "position",
        "compliance [um/N]\nsoftest",
        "\nmiddle",
        "\nstiffest",
        f"first resonance\n{prediction.motors} [Hz]",
        "damping\n[%]",
    )
    frame = prediction.frame
    lines = [
        f"{frame.link} at {', '.join(f'{x:g}' for x in frame.at)} m, axes of the {frame.axes}; "
        f"motors clamped for compliances; bands by {plain(spread)}",
        *table(header, rows[:_MOST], right=range(6)),
    ]
    if len(rows) > _MOST:
        lines.append(f"  and {len(rows) - _MOST} more in the files")
    return "\n".join([*lines, *(f"written  {path}" for path in written)])


def tool_document(prediction: ToolPrediction, spread: str) -> dict[str, Any]:
    """Return all but responses as plain numbers, SI units."""
    return {
        "schema": "prediction/1",
        "frame": {
            "link": prediction.frame.link,
            "at": list(prediction.frame.at),
            "axes": prediction.frame.axes,
        },
        "positions": json_data(prediction.compliance.positions),
        "points": json_data(prediction.points),
        "compliance": _document(prediction.compliance)
        | {"directions": json_data(prediction.directions)},
        "resonances": _document(prediction.resonances),
        "damping_ratios": _document(prediction.damping),
        "motors": prediction.motors,
        "spread": spread,
        "level": prediction.compliance.level,
    }


def tool_csv(prediction: ToolPrediction, motors: Sequence[str]) -> str:
    """Return a table with a row for each position."""
    k = prediction.resonances.values.shape[1]
    header = [*motors, "x", "y", "z"]
    for name in ("softest", "middle", "stiffest"):
        header += _titles(f"compliance_{name}", "m/N")
    for i in range(k):
        header += _titles(f"resonance_{i + 1}", "rad/s") + _titles(f"damping_ratio_{i + 1}", "-")
    columns = [prediction.compliance.positions, prediction.points]
    columns += [_columns(prediction.compliance, i) for i in range(3)]
    for i in range(k):
        columns += [_columns(prediction.resonances, i), _columns(prediction.damping, i)]
    return _csv(header, np.hstack(columns).tolist())


def response_csv(prediction: ToolPrediction) -> str:
    """Return responses of the frame along x, y, z to forces along them, a row for each line."""
    header = ["position", "frequency [Hz]", "motion", "force", "real", "imaginary", "magnitude"]
    header += ["std of ln magnitude", "std of phase [rad]", "lower", "upper"]
    band, rows = prediction.response, []
    if band is not None:
        for q, f, i, j in np.ndindex(*band.values.shape[:2], 3, 3):
            at = q, f, i, j
            value, hertz = complex(band.values[at]), float(prediction.omega[f] / (2 * np.pi))
            sizes = value.real, value.imag, abs(value)
            spread = (getattr(band, name)[at] for name in ("std", "phase_std", "lower", "upper"))
            rows.append([q + 1, hertz, "xyz"[i], "xyz"[j], *sizes, *(float(x) for x in spread)])
    return _csv(header, rows)


_MARGINS = {
    "gain_margin": "-",
    "gain_reduction": "-",
    "phase_margin": "rad",
    "peak_sensitivity": "-",
    "peak_frequency": "rad/s",
    "bandwidth": "rad/s",
}


def margins_summary(
    band: MarginBand,
    motors: Sequence[str],
    remedies: Sequence[Suggestion],
    spread: str,
    written: Sequence[Path],
) -> str:
    """Return the worst of each motor over the positions, stability, and what may help."""
    rows = []
    nominal = band.nominal
    for i, motor in enumerate(motors):
        gains = (number(m.gain_margin[:, i].min()) for m in (nominal, band.lower))
        phases = (np.rad2deg(m.phase_margin[:, i].min()) for m in (nominal, band.lower))
        peaks = (number(m.peak_sensitivity[:, i].max()) for m in (nominal, band.upper))
        worst = int(np.argmax(nominal.peak_sensitivity[:, i]))
        rows.append(
            (
                motor,
                "{} ({})".format(*gains),
                "{:.1f} ({:.1f})".format(*phases),
                "{} ({})".format(*peaks),
                number(nominal.peak_frequency[worst, i] / (2 * np.pi)),
                number(nominal.bandwidth[:, i].min() / (2 * np.pi)),
            )
        )
    header = (
        "motor",
        "gain margin\n(lower end)",
        "phase [deg]\n(lower end)",
        "peak of S\n(upper end)",
        "at\n[Hz]",
        "bandwidth\n[Hz]",
    )
    unstable = int(np.argmax(band.unstable))
    lines = [
        f"worst over {text.plural(len(band.positions), 'position')}, in brackets what "
        f"{band.level:.0%} intervals allow; each loop with the others closed; "
        f"–: no limit; draws: {spread}",
        *table(header, rows, right=range(1, 6)),
        f"  largest singular value of S: {number(band.nominal.largest_sensitivity.max())}",
        f"  instability: {band.unstable[unstable]} of {band.draws} draws in position "
        f"{unstable + 1}, the worst; at most {100 * band.probability_bound[unstable]:.2g} % (95 %)",
    ]
    lines += [f"  to begin with, {_words(remedy, motors)}" for remedy in remedies]
    return "\n".join(plain(line) for line in [*lines, *(f"written  {p}" for p in written)])


def margins_document(
    band: MarginBand, motors: Sequence[str], remedies: Sequence[Suggestion], spread: str
) -> dict[str, Any]:
    """Return margins, their intervals and suggestions as plain numbers, SI units."""
    content = {
        "schema": "margins/1",
        "motors": list(motors),
        "positions": band.positions,
        "nominal": band.nominal,
        "lower": band.lower,
        "upper": band.upper,
        "level": band.level,
        "draws": band.draws,
        "spread": spread,
        "unstable": band.unstable,
        "probability_of_instability": band.probability,
        "probability_bound": band.probability_bound,
        "suggestions": tuple(remedies),
    }
    document: dict[str, Any] = json_data(content)
    return document


def margins_csv(band: MarginBand, motors: Sequence[str]) -> str:
    """Return a table with a row for each position and motor."""
    header = ["position", "motor", "stable", "unstable draws", "largest singular value of S"]
    for name, unit in _MARGINS.items():
        header += [f"{name} [{unit}]", f"{name} lower", f"{name} upper"]
    rows = []
    for q, i in np.ndindex(len(band.positions), len(motors)):
        row: list[Any] = [q + 1, motors[i], bool(band.nominal.stable[q]), int(band.unstable[q])]
        row.append(float(band.nominal.largest_sensitivity[q]))
        for name in _MARGINS:
            row += [float(getattr(m, name)[q, i]) for m in (band.nominal, band.lower, band.upper)]
        rows.append(row)
    return _csv(header, rows)


def _words(remedy: Suggestion, motors: Sequence[str]) -> str:
    what = f"{remedy.gain:g} of its gain"
    if remedy.notch is not None:
        hertz = remedy.notch.frequency / (2 * np.pi)
        what = f"a notch at {number(hertz)} Hz, damping {remedy.notch.zeros:g}"
        what += f" over {remedy.notch.poles:g}"
    change = f"from {number(remedy.before)} to {number(remedy.after)}"
    return f"{motors[remedy.motor]}: {what} takes its worst peak of S {change}"


def _cell(prediction: Prediction, row: int, column: int, factor: float) -> str:
    """Return a value in another unit with its relative standard deviation."""
    value, std = factor * prediction.values[row, column].real, prediction.std[row, column]
    if not np.isfinite(value):
        return ""
    percent = f"{100 * std:.2g}" if np.isfinite(std) else "?"
    return plain(f"{text.significant(value, 3)} ±{percent} %")


def _document(prediction: Prediction) -> dict[str, Any]:
    names = ("values", "std", "lower", "upper")
    return {name: json_data(getattr(prediction, name)) for name in names}


def _titles(name: str, unit: str) -> list[str]:
    return [f"{name} [{unit}]", f"{name} relative std", f"{name} lower", f"{name} upper"]


def _columns(prediction: Prediction, i: int) -> Array:
    parts = (prediction.values.real, prediction.std, prediction.lower, prediction.upper)
    return np.stack([part[:, i] for part in parts], axis=1)


def _csv(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    lines = io.StringIO()
    writer = csv.writer(lines, lineterminator="\n")
    writer.writerows(
        [header, *([f"{x:.9g}" if isinstance(x, float) else x for x in r] for r in rows)]
    )
    return lines.getvalue()
