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
    """Return softest compliance, first resonance and damping with their bands, by position."""
    rows = []
    for i, point in enumerate(prediction.points):
        quantities = (
            _cell(prediction.compliance, i, 1e6),
            _cell(prediction.resonances, i, 1 / (2 * np.pi)),
            _cell(prediction.damping, i, 100.0),
        )
        where = " ".join(f"{x:5.2f}" for x in point)
        rows.append((f"{i + 1}", where, *(cell for pair in quantities for cell in pair)))
    band = f"{text.level(prediction.compliance.level)} band"
    header = (
        "no.",
        "tool at x, y, z\n[m]",
        "softest\n[µm/N]",
        band,
        f"{prediction.motors}\n[Hz]",
        band,
        "damping\n[%]",
        band,
    )
    frame = prediction.frame
    lines = [
        f"{frame.link} at {', '.join(f'{x:g}' for x in frame.at)} m, axes of the {frame.axes}; "
        f"largest compliance, motors clamped; first resonance and its damping ratio, motors "
        f"{prediction.motors}; bands by {plain(spread)}",
        *table(header, rows[:_MOST], right=range(8)),
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


def _cell(prediction: Prediction, row: int, factor: float) -> tuple[str, str]:
    """Return the first of several values in another unit, and the ends of its band."""
    parts = (prediction.values.real, prediction.lower, prediction.upper)
    value, band = text.value_and_ends(*(factor * float(part[row, 0]) for part in parts))
    return plain(value), plain(band)


def _document(prediction: Prediction) -> dict[str, Any]:
    names = ("values", "std", "lower", "upper")
    return {name: json_data(getattr(prediction, name)) for name in names}


def _titles(name: str, unit: str) -> list[str]:
    return [f"{name} [{unit}]", f"{name} relative std", f"{name} lower", f"{name} upper"]


def _columns(prediction: Prediction, i: int) -> Array:
    parts = (prediction.values.real, prediction.std, prediction.lower, prediction.upper)
    return np.stack([part[:, i] for part in parts], axis=1)
