"""How stiff the tool is in the plan's positions, and how sure that is."""

import numpy as np
from markupsafe import Markup

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
    """Return compliance, first resonance and damping of each position with their deviations."""
    columns = numbers(
        "position", "softest [µm/N]", "softest ± [%]", "middle [µm/N]", "stiffest [µm/N]",
        "resonance [Hz]", "resonance ± [%]", "damping [%]", "damping ± [%]",
    )  # fmt: skip
    rows: list[list[Cell]] = []
    compliance, resonances = prediction.compliance, prediction.resonances
    damping = prediction.damping
    for i in range(len(prediction.points)):
        values = [
            1e6 * compliance.values[i, 0].real,
            100 * compliance.std[i, 0],
            *(1e6 * compliance.values[i, 1:].real),
            resonances.values[i, 0].real / (2 * np.pi),
            100 * resonances.std[i, 0],
            100 * damping.values[i, 0].real,
            100 * damping.std[i, 0],
        ]
        shown = (Number(text.significant(float(v), 3), float(v)) for v in values)
        rows.append([Number(f"{i + 1}", i + 1.0), *shown])
    caption = (
        f"Half axes of the compliance ellipsoid with clamped motors; first mode with "
        f"{prediction.motors} motors; relative standard deviations."
    )
    return table("prediction", caption, columns, rows)
