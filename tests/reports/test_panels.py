"""Panels show the same on pages, as SVG, as in notebooks, by matplotlib."""

import re
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.path import Path

from reports.figures.corner_figure import contours, corner_plot, counted
from reports.figures.palette import LIGHT
from reports.figures.panels import Area, Axis, Bubbles, Curve, Panel, Panels, Rule, bars, cells
from reports.figures.study_figures import convergence


def texts(svg):
    """Return the words of numbers with their places, below and on the left."""
    below, left = re.findall(r'<g font-size="8"[^>]*>(.*?)</g>', svg)
    pattern = r'<text x="([-\d.]+)" y="([-\d.]+)">([^<]*)</text>'
    return [
        [(float(x), float(y), word.replace("−", "-")) for x, y, word in re.findall(pattern, group)]
        for group in (below, left)
    ]


def curve(path):
    """Follow M and relative l, in tenths of a point."""
    start, steps = re.fullmatch(r"M([\d ]+)l([-+\d]*)", path).groups()
    moves = np.array(re.findall(r"[-+]\d+", steps), dtype=float).reshape(-1, 2)
    return np.vstack([np.array(start.split(), float), moves]).cumsum(axis=0) / 10


@pytest.mark.parametrize("log", [False, True])
def test_points_lie_between_its_numbers(log):
    x = np.geomspace(1, 300, 40)
    y = np.sin(np.arange(40.0)) + 3
    panel = Panel([Curve(x, y, "accent", 0.0, 3.0)], Axis("x", log=log), Axis("y"))
    svg = Panels((6, 3), [[panel]]).svg("a", "a curve")
    points = np.array(re.findall(r"M(\d+) (\d+)h0", svg), dtype=float) / 10
    below, left = texts(svg)
    numbers = np.array([float(word) for _, _, word in below])
    along = np.log if log else np.asarray
    across = np.polyfit([place for place, _, _ in below], along(numbers), 1)
    up = np.polyfit([place - 3 for _, place, _ in left], [float(word) for *_, word in left], 1)
    drawn = np.column_stack([np.polyval(across, points[:, 0]), np.polyval(up, points[:, 1])])
    assert len(drawn) == 40
    np.testing.assert_allclose(drawn[:, 0], along(x), atol=3e-3 * np.ptp(along(x)))
    np.testing.assert_allclose(drawn[:, 1], y, atol=0.01)


def test_both_drawings_have_the_same_numbers():
    panels = convergence(np.array([0.5, 1e-3, 1e-9]), 2e-11)
    below, left = texts(panels.svg("a", "gaps"))
    (axes,) = panels(LIGHT).axes
    assert [word for *_, word in below] == [t.get_text() for t in axes.get_xticklabels()]
    assert [word for *_, word in left] == [
        t.get_text().replace("−", "-") for t in axes.get_yticklabels()
    ]
    assert len(left) >= 3
    height = float(re.search(r"M0 0v([\d.]+)", panels.svg("a", "gaps"))[1])
    assert all(0 <= y - 3 <= height for _, y, _ in left)


def test_what_lies_outside_is_left_out_and_nothing_is_not_drawn():
    nothing = np.full(3, np.nan)
    ends = (0.0, 1.0)
    marks = [
        Curve(np.array([2.0, 0.5]), np.array([0.5, 0.5]), "accent", 0.0, 3.0),
        Curve(nothing, nothing, "ink"),
        Rule(7.0, "muted"),
        Area(np.array([-5.0, 5.0, 5.0, -5.0]), np.array([0.2, 0.2, 0.4, 0.4]), "second"),
        Bubbles(np.array([0.5]), np.array([0.5]), np.array([30.0]), "second"),
    ]
    svg = Panels((3, 3), [[Panel(marks, Axis(limits=ends), Axis(limits=ends))]]).svg("a", "b")
    assert svg.count("h0") == 1
    assert 'var(--muted)" stroke-width="8"' not in svg
    (area,) = re.findall(r'd="(M[^"]*z)" fill', svg)
    outline = curve(area.rstrip("z"))
    assert outline[:, 0].min() == 0
    assert outline[:, 0].max() < 72 * 3
    assert svg.count("<circle") == 1
    assert "nan" not in svg


def test_words_are_escaped_and_said():
    panel = Panel([Rule(0.5, "ink", upright=True)], Axis("a < b"), Axis("c\nd"), "e & f")
    svg = Panels((3, 2), [[panel, None]], legend=[("g > h", "accent")]).svg("a", 'says "x"')
    for words in ("a &lt; b", "e &amp; f", "g &gt; h", 'aria-label="says &quot;x&quot;"'):
        assert words in svg
    assert svg == Panels((3, 2), [[panel, None]], legend=[("g > h", "accent")]).svg("a", 'says "x"')
    shown, empty = Panels((3, 2), [[panel, None]])(LIGHT).axes
    assert shown.get_visible()
    assert not empty.get_visible()


def test_bars_and_cells_have_gaps_between():
    at, ends = bars(np.array([1.0, 2.0]), np.array([3.0, 4.0]), np.array([5.0, 6.0]))
    np.testing.assert_array_equal(at, [1, 1, 1, 2, 2, 2])
    np.testing.assert_array_equal(ends, [3, 5, np.nan, 4, 6, np.nan])
    chosen = np.array([[False, True], [False, False]])
    x, y = cells(np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0, 5.0]), chosen)
    np.testing.assert_array_equal(x, [1, 3, 3, 1, np.nan])
    np.testing.assert_array_equal(y, [0, 0, 2, 2, np.nan])


def test_contours_enclose_the_shares_of_ellipses():
    rng = np.random.default_rng(4)
    draws = rng.multivariate_normal([1.0, -2.0], [[4.0, 1.5], [1.5, 1.0]], 100_000)
    edges = np.linspace(draws.min(axis=0), draws.max(axis=0), 37)
    width = edges[1] - edges[0]
    bins = np.minimum(((draws - edges[0]) / width).astype(int), 35)
    middles = edges[0] + (np.arange(-4, 40)[:, None] + 0.5) * width
    x, y = contours(middles[:, 0], middles[:, 1], counted(bins[:, 0], bins[:, 1]))
    gaps = np.flatnonzero(np.isnan(x))
    loops = [Path(np.column_stack([x, y])[a + 1 : b]) for a, b in pairwise(gaps)]
    shares = sorted(float(loop.contains_points(draws).mean()) for loop in loops if len(loop) > 8)
    inner, outer = 1 - np.exp(-0.5), 1 - np.exp(-2.0)
    assert shares[-1] == pytest.approx(outer, abs=0.03)
    assert min(abs(share - inner) for share in shares) < 0.04
    assert abs(shares[-1] - inner) > 0.3


def test_a_corner_of_one_parameter_is_its_histogram():
    draws = np.random.default_rng(0).standard_normal((400, 1))
    panels = corner_plot(["a"], draws, np.eye(1), np.array([0.3]))
    ((panel,),) = panels.rows
    steps = panel.marks[-1]
    area = np.sum(np.diff(steps.x) * steps.y[1:])
    assert area == pytest.approx(400 * np.ptp(draws) / 36)
    assert panels(LIGHT).axes[0].get_xlabel() == "a"
