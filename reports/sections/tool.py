"""How stiff the tool is in the plan's positions, and how sure that is."""

import numpy as np
from markupsafe import Markup

from estimators.validation.predict import Prediction
from estimators.validation.predict_tool import ToolPrediction
from oed.study.results import StudyResults
from reports import text
from reports.figures import mode_figures
from reports.page_elements import Cell, Number, Section, Table, figure, filled, numbers, table

_ROUNDING = 1e-9
"""Of the largest compliance, below which others are zero."""


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
        caption=f"Lowest modes in {positions}, motors {results.tool.motors}, with one standard "
        "deviation.",
    )
    body = filled("prediction.html.j2", figures=[modes], table=shown)
    modes_body = filled("modes.html.j2", motors=results.tool.motors, shown=mode_table(results.tool))
    return Section("tool", "Tool", body + modes_body + bands_words(results))


def mode_table(prediction: ToolPrediction) -> Table:
    """Return frequency and damping ratio of every mode in each position, with their bands."""
    level = f"{text.level(prediction.resonances.level)} band"
    columns = numbers(
        "position", "mode", "resonance [Hz]", f"{level} of it [Hz]", "damping [%]",
        f"{level} of it [%]",
    )  # fmt: skip
    rows = [
        [
            *(Number(f"{number + 1}", number + 1.0) for number in at),
            *value_and_band(prediction.resonances, at, 1 / (2 * np.pi)),
            *value_and_band(prediction.damping, at, 100.0),
        ]
        for at in np.ndindex(prediction.resonances.values.shape)
    ]
    caption = f"Lowest modes, motors {prediction.motors}: undamped resonances, and damping ratios."
    return table("tool-modes", caption, columns, rows)


def positions_words(shown: int, count: int) -> str:
    """Return in which of the plan's positions the tool is predicted."""
    return "each position" if shown == count else f"the first {shown} of {count} positions"


def bands_words(results: StudyResults) -> Markup:
    """Return a paragraph on what the bands rest on."""
    return filled("bands.html.j2", spread=results.spread)


def prediction_table(prediction: ToolPrediction) -> Table:
    """Return where the tool is, its compliance, first resonance and damping with their bands."""
    level = f"{text.level(prediction.compliance.level)} band"
    columns = numbers(
        "position", "x [m]", "y [m]", "z [m]", "softest [µm/N]", f"{level} of it [µm/N]",
        "middle [µm/N]", "stiffest [µm/N]", "resonance [Hz]", f"{level} of it [Hz]",
        "damping [%]", f"{level} of it [%]",
    )  # fmt: skip
    rows: list[list[Cell]] = []
    compliance = prediction.compliance
    for i, point in enumerate(prediction.points):
        sizes = 1e6 * compliance.values[i].real
        others = (_value(v if v > _ROUNDING * sizes[0] else 0.0) for v in sizes[1:])
        row: list[Cell] = [Number(f"{i + 1}", i + 1.0)]
        row += [Number(text.fixed(float(x), 3), float(x)) for x in point]
        row += [*value_and_band(compliance, (i, 0), 1e6), *others]
        row += value_and_band(prediction.resonances, (i, 0), 1 / (2 * np.pi))
        rows.append([*row, *value_and_band(prediction.damping, (i, 0), 100.0)])
    caption = (
        "Tool coordinates in the base’s axes; half axes of the compliance ellipsoid with clamped "
        f"motors; first mode with {prediction.motors} motors."
    )
    return table("prediction", caption, columns, rows)


def value_and_band(
    prediction: Prediction, at: tuple[int, ...], factor: float
) -> tuple[Number, Number]:
    """Return a value in another unit, and the ends of its band."""
    value = factor * float(prediction.values[at].real)
    low, high = (factor * float(end[at]) for end in (prediction.lower, prediction.upper))
    shown, band = text.value_and_ends(value, low, high)
    return Number(shown, value), Number(band, low)


def _value(value: float) -> Number:
    return Number(text.significant(float(value), 3), float(value))
