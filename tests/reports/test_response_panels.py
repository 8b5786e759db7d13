import re

import numpy as np
import pytest
from test_compact_path import curves

from reports.figures.response_panels import _level_range, response_panels

OMEGA = 2 * np.pi * np.geomspace(2, 80, 40)


def paths(svg, colour):
    """Return the data of a colour's curves: of magnitudes, then of phases."""
    return re.findall(
        rf'd="([^"]*)" fill="none" stroke="var\(--{colour}\)" stroke-width="[\d.]+"/>', svg
    )


def test_rows_are_outputs_and_columns_are_motors():
    rng = np.random.default_rng(0)
    G = rng.standard_normal((40, 3, 2)) + 1j * rng.standard_normal((40, 3, 2))
    names = {"motors": ("m1", "m<2"), "outputs": ("m1", "m2", "elbow")}
    svg = response_panels(OMEGA, G, 0.1 * np.abs(G), G, **names).svg("in-a", 'says "x < y"')
    words = set(re.findall(r"<text[^>]*>([^<]*)</text>", svg))
    assert {"from m1", "from m&lt;2", "to m1", "to m2", "to elbow"} <= words
    assert 'aria-label="says &quot;x &lt; y&quot;"' in svg
    assert svg.count('<use href="#in-a-grid"') == 6
    magnitude, phase = paths(svg, "second")
    assert len(curves(magnitude)) >= 6
    assert len(curves(phase)) >= 6


def test_levels_and_degrees_are_where_the_axes_say():
    G = (1 + OMEGA / 100)[:, None, None] * np.exp(0.005j * OMEGA)[:, None, None]
    svg = response_panels(OMEGA, G, 0.1 * np.abs(G), G, ("m1",)).svg("in-a", "one element")
    beside = svg[svg.index('text-anchor="end"') :]
    labels = re.findall(r'<text x="[^"]*" y="([^"]*)">(−?\d+)(°?)</text>', beside)
    levels = {int(w.replace("−", "-")): float(y) - 3 for y, w, degree in labels if not degree}
    slope, offset = np.polyfit([*levels], [*levels.values()], 1)
    scale = 1 / float(re.search(r"scale\(([\d.]+)\)", svg)[1])
    (curve,), (phase,) = (curves(path) for path in paths(svg, "second"))
    expected = scale * (offset + slope * 20 * np.log10(np.abs(G[:, 0, 0])))
    across = np.interp(np.log(OMEGA), np.log(OMEGA[[0, -1]]), curve[[0, -1], 0])
    np.testing.assert_allclose(np.interp(across, *curve.T), expected, atol=2)
    height = 0.5 * 173 * scale / (2 * np.pi)  # of a radian
    turned = (phase[-1, 1] - phase[0, 1]) / -height
    assert turned == pytest.approx(np.ptp(np.unwrap(np.angle(G[:, 0, 0]))), abs=2 / height)


def test_a_wrapped_phase_does_not_cross_its_panel():
    G = np.exp(-0.02j * OMEGA)[:, None, None]
    svg = response_panels(OMEGA, G, 0.1 * np.abs(G), G, ("m1",)).svg("in-a", "one element")
    parts = curves(paths(svg, "second")[1])
    assert len(parts) == 1 + round(np.ptp(0.02 * OMEGA) / (2 * np.pi))
    assert all((np.diff(part[:, 1]) >= 0).all() for part in parts)


def test_a_model_below_the_noise_stays_in_its_panel():
    measured = np.ones((40, 1, 1), dtype=complex)
    measured[20:] = 0.01  # the noise
    model = measured.copy()
    model[20:] = np.geomspace(1e-2, 1e-3, 20)[:, None, None]
    low, high = _level_range(np.abs(measured), [], model)
    assert low <= -60 < -50 < _level_range(np.abs(measured), [])[0]
    assert high == 10
    svg = response_panels(OMEGA, measured, 0.1 * np.abs(measured), model, ("m1",)).svg(
        "in-a", "one"
    )
    assert sum(map(len, curves(paths(svg, "second")[0]))) >= 3


def test_a_gap_in_the_distortion_leaves_dots():
    G = np.ones((40, 1, 1), dtype=complex)
    distortion = np.full((40, 1, 1), np.nan)
    distortion[[3, 20, 21]] = 0.1
    panels = response_panels(OMEGA, G, 0.1 * np.abs(G), None, ("m1",), distortion=distortion)
    line, dot = curves(paths(panels.svg("in-a", "one"), "ink")[0])
    assert len(np.unique(dot, axis=0)) == 1
    assert len(line) >= 2


def test_the_panels_of_a_robot_take_little_room():
    rng = np.random.default_rng(1)
    G = rng.standard_normal((80, 6, 6)) + 1j * rng.standard_normal((80, 6, 6))
    omega = 2 * np.pi * np.geomspace(2, 80, 80)
    motors = tuple(f"m{k}" for k in range(6))
    svg = response_panels(omega, G, 0.1 * np.abs(G), G, motors).svg("in-a", "noise, which is worst")
    assert len(svg) < 120_000  # matplotlib takes 200 000
