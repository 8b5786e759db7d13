import re

import numpy as np
from matplotlib.path import Path

from reports.figures import compact_path


def curves(data):
    """Follow M, relative l and h0, one curve for each M."""
    out = []
    for command, numbers in re.findall(r"([Mlh])([^Mlh]*)", data):
        steps = np.array([int(n) for n in re.findall(r"[+-]?\d+", numbers)])
        if command == "M":
            out.append([steps])
        elif command == "l":
            for step in steps.reshape(-1, 2):
                out[-1].append(out[-1][-1] + step)
    return [np.array(curve) for curve in out]


def drawn(x, y, width=1000, height=800, corner=(0, 0)):
    path = compact_path.line(np.asarray(x, float), np.asarray(y, float), width, height)
    return curves(compact_path.data([path], np.array([corner])))


def test_a_curve_stays_within_two_units_and_has_fewer_points():
    rng = np.random.default_rng(0)
    x = np.linspace(0, 1000, 300)
    y = 400 + 200 * np.sin(x / 80) + rng.normal(0, 0.5, 300)
    (curve,) = drawn(x, y)
    assert len(curve) < 150
    away = np.interp(x, *curve.T) - y
    slope = np.abs(np.gradient(y, x))
    assert np.max(np.abs(away) / np.sqrt(1 + slope**2)) < 2
    (coarse,) = drawn(x, np.round(y / 40) * 40)
    assert np.max(np.abs(np.interp(x, *coarse.T) - y)) > 2  # the check can fail


def test_gaps_part_a_curve_and_a_lone_point_is_a_dot():
    y = np.array([1, 2, np.nan, 5, np.nan, 9, 4.0]) * 10
    first, last, lone = drawn(np.arange(7) * 10, y)
    np.testing.assert_array_equal(first, [[0, 10], [10, 20]])
    np.testing.assert_array_equal(lone, [[30, 50]])
    np.testing.assert_array_equal(last[:2], [[50, 90], [60, 40]])
    dot = compact_path.data([Path([[30, 50]], [Path.MOVETO])], np.zeros((1, 2)))
    assert dot == "M30 50h0"


def test_a_curve_is_cut_where_it_leaves_the_frame():
    before, after = drawn([0, 100, 200], [700, 1100, 700], height=800)
    np.testing.assert_allclose(before[-1], [25, 800], atol=1)
    np.testing.assert_allclose(after[0], [175, 800], atol=1)


def test_curves_are_moved_to_their_corners():
    (here,), (there,) = drawn([0, 9], [3, 5]), drawn([0, 9], [3, 5], corner=(40, 70))
    np.testing.assert_array_equal(there, here + np.array([40, 70]))


def test_a_band_is_bent_along_the_frame():
    x = np.array([0.0, 50.0, 100.0])
    path = compact_path.band(x, np.array([90.0, 200.0, 90.0]), np.array([10.0, 20.0, 10.0]), 100.0)
    (outline,) = curves(compact_path.data([path], np.zeros((1, 2))))
    assert outline[:, 1].max() == 100
    assert {(0, 10), (50, 20), (100, 90), (50, 100)} <= set(map(tuple, outline.tolist()))
