"""What ``oed predict`` says: tables for a terminal, JSON, and CSV for others."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimators.validation.predict import Prediction
from estimators.validation.predict_tool import ToolPrediction
from reports import text
from reports.summaries.columns import csv_text, plain, table
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
    return csv_text(header, np.hstack(columns).tolist())


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
    return csv_text(header, rows)


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
