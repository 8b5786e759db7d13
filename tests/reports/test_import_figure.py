"""The picture of a log: its legend hides no curve."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from reports.figures.import_figures import signal_panels
from reports.figures.svg import LIGHT


@pytest.mark.parametrize("count", [2, 12])
def test_the_legend_names_every_joint_beside_the_panels(count):
    time = np.linspace(0, 1, 50)
    joints = [f"joint_{j + 1}" for j in range(count)]
    signals = {"motor_angle": np.sin(np.outer(time, np.arange(1, count + 1)))}
    signals["motor_torque"] = np.where(np.arange(count) == 0, np.nan, signals["motor_angle"])
    figure = signal_panels(time, signals, {"motor_angle": "rad"}, joints)(LIGHT)
    FigureCanvasAgg(figure).draw()
    (legend,) = figure.legends
    assert [one.get_text() for one in legend.get_texts()] == joints
    box = legend.get_window_extent()
    for axes in figure.axes:
        assert axes.get_legend() is None
        assert not box.overlaps(axes.get_window_extent())
    assert figure.bbox.x0 <= box.x0
    assert box.x1 <= figure.bbox.x1
