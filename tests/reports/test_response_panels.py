import matplotlib.pyplot as plt
import numpy as np

from reports.figures.response_panels import _level_range, response_panels
from reports.figures.svg import LIGHT


def test_rows_are_outputs_and_columns_are_motors():
    rng = np.random.default_rng(0)
    G = rng.standard_normal((12, 3, 2)) + 1j * rng.standard_normal((12, 3, 2))
    omega = 2 * np.pi * np.geomspace(2, 80, 12)
    names = {"motors": ("m1", "m2"), "outputs": ("m1", "m2", "elbow")}
    figure = response_panels(omega, G, 0.1 * np.abs(G), G, **names)(LIGHT)
    words = {text.get_text() for axes in figure.axes for text in axes.texts}
    assert {"from m1", "from m2", "to m1", "to m2", "to elbow"} <= words
    plt.close(figure)


def test_a_model_below_the_noise_stays_in_its_panel():
    omega = 2 * np.pi * np.geomspace(2, 80, 40)
    measured = np.ones((40, 1, 1), dtype=complex)
    measured[20:] = 0.01  # the noise
    model = measured.copy()
    model[20:] = np.geomspace(1e-2, 1e-3, 20)[:, None, None]
    low, high = _level_range(np.abs(measured), [], model)
    assert low <= -60 < -50 < _level_range(np.abs(measured), [])[0]
    assert high == 10
    plt.close(response_panels(omega, measured, 0.1 * np.abs(measured), model, ("m1",))(LIGHT))
