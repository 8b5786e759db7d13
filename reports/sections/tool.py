"""How stiff the tool is in the plan's positions, and how sure that is."""

import numpy as np
from markupsafe import Markup

from estimators.validation.predict import Prediction
from estimators.validation.predict_tool import ToolPrediction
from oed.study.results import StudyResults
from reports import text
from reports.figures import mode_figures
from reports.page_elements import Cell, Number, Section, Table, figure, filled, numbers, table


def section(results: StudyResults) -> Section | None:
    """Return the section; None without a prediction."""
    if results.tool is None:
        return None
    shown = prediction_table(results.tool)
    positions = positions_words(len(results.tool.points), len(results.plan.positions))
    modes = figure(
        "modes",
        mode_figures.modes(results.tool),
        "Resonances and damping ratios of the lowest modes in each position",
        caption=f"Lowest modes in {positions}, with one standard deviation.",
    )
    body = filled("prediction.html.j2", figures=[modes], table=shown)
    return Section("tool", "Tool", body + bands_words(results))


def positions_words(shown: int, count: int) -> str:
    """Return in which of the plan's positions the tool is predicted."""
    return "each position" if shown == count else f"the first {shown} of {count} positions"


def bands_words(results: StudyResults) -> Markup:
    """Return a paragraph on what the bands rest on."""
    return filled("bands.html.j2", spread=results.spread)


def prediction_table(prediction: ToolPrediction) -> Table:
    """Return where the tool is, its compliance, first resonance and damping with their bands."""
    level = f"{100 * prediction.compliance.level:.0f} % band"
    columns = numbers(
        "position", "x [m]", "y [m]", "z [m]", "softest [µm/N]", f"{level} of it [µm/N]",
        "middle [µm/N]", "stiffest [µm/N]", "resonance [Hz]", f"{level} of it [Hz]",
        "damping [%]", f"{level} of it [%]",
    )  # fmt: skip
    rows: list[list[Cell]] = []
    compliance = prediction.compliance
    for i, point in enumerate(prediction.points):
        others = (_value(1e6 * v.real) for v in compliance.values[i, 1:])
        row: list[Cell] = [Number(f"{i + 1}", i + 1.0)]
        row += [Number(text.fixed(float(x), 3), float(x)) for x in point]
        row += [*value_and_band(compliance, i, 1e6), *others]
        row += value_and_band(prediction.resonances, i, 1 / (2 * np.pi))
        rows.append([*row, *value_and_band(prediction.damping, i, 100.0)])
    caption = (
        "Tool coordinates in the base’s axes; half axes of the compliance ellipsoid with clamped "
        f"motors; first mode with {prediction.motors} motors."
    )
    return table("prediction", caption, columns, rows)


def value_and_band(prediction: Prediction, row: int, factor: float) -> list[Number]:
    """Return the first of several values in another unit, and the ends of its band."""
    value = factor * float(prediction.values[row, 0].real)
    low, high = (factor * float(end[row, 0]) for end in (prediction.lower, prediction.upper))
    ends = [text.significant(end, 3) for end in (low, high)]
    return [_value(value), Number(" to ".join(ends) if np.isfinite(low) else "–", low)]


def _value(value: float) -> Number:
    return Number(text.significant(float(value), 3), float(value))
