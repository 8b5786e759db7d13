"""Figures of modes: frequencies and damping ratios with their intervals, over positions."""

import numpy as np

from estimators.validation.predict_tool import ToolPrediction
from reports.figures.panels import SERIES, Axis, Curve, Panel, Panels, bars


def modes(prediction: ToolPrediction) -> Panels:
    """Return resonances and damping ratios of each position, with one standard deviation."""
    frequency, damping = prediction.resonances, prediction.damping
    number = np.arange(1.0, len(prediction.points) + 1)
    x = Axis("position", (0.5, len(number) + 0.5), integer=True, count=12, grid=False)
    row = []
    for title, values, std in (
        ("resonance [Hz]", frequency.values.real / (2 * np.pi), frequency.std),
        ("damping ratio [%]", 100 * damping.values.real, damping.std),
    ):
        marks = []
        for k in range(values.shape[1]):
            colour, mode, half = SERIES[k % len(SERIES)], values[:, k], values[:, k] * std[:, k]
            marks.append(Curve(*bars(number, mode - half, mode + half), colour, 1.5))
            marks.append(Curve(number, mode, colour, 0.0, 4.0))
        row.append(Panel(marks, x, Axis(title, (0.0, None))))
    several = range(frequency.values.shape[1])
    legend = [(f"mode {k + 1}", SERIES[k % len(SERIES)]) for k in several]
    return Panels((7.0, 2.6), [row], legend=legend)
