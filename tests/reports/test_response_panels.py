import matplotlib.pyplot as plt
import numpy as np

from reports.response_panels import response_panels
from reports.svg import LIGHT


def test_rows_are_outputs_and_columns_are_motors():
    rng = np.random.default_rng(0)
    G = rng.standard_normal((12, 3, 2)) + 1j * rng.standard_normal((12, 3, 2))
    omega = 2 * np.pi * np.geomspace(2, 80, 12)
    names = {"motors": ("m1", "m2"), "outputs": ("m1", "m2", "elbow")}
    figure = response_panels(omega, G, 0.1 * np.abs(G), G, **names)(LIGHT)
    words = {text.get_text() for axes in figure.axes for text in axes.texts}
    assert {"from m1", "from m2", "to m1", "to m2", "to elbow"} <= words
    plt.close(figure)
