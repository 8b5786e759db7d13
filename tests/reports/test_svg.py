import base64
import re

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from reports.figures import svg


def line_of(points):
    def draw(palette):
        figure = Figure(figsize=(3, 2))
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set(xlim=(0, 1), ylim=(0, 1))
        axes.set_axis_off()
        axes.plot(*points, color=palette.accent)
        axes.text(0.5, 0.5, "a < b & c", color=palette.ink)
        return figure

    return draw


def vertices(path):
    """Follow M and relative l commands, whose numbers may repeat and need no space."""
    out, here = [], np.zeros(2)
    for command, numbers in re.findall(r"([Ml])([^MlzLCQ]*)", path):
        steps = np.array([float(n) for n in re.findall(r"-?(?:\d+\.?\d*|\.\d+)", numbers)])
        for step in steps.reshape(-1, 2):
            here = step if command == "M" else here + step
            out.append(here)
    return np.array(out)


def test_short_paths_keep_every_point_within_a_twentieth():
    rng = np.random.default_rng(0)
    x, y = np.linspace(0, 1, 400), rng.uniform(0, 1, 400)
    with mpl.rc_context({"path.simplify": False}):  # it leaves out points in line with others
        page = svg.inline(line_of((x, y)), "a", "a jagged line of many points")
    path = max(re.findall(r' d="([^"]*)"', page), key=len)
    found = vertices(path)
    expected = np.stack([216 * x, 144 * (1 - y)], axis=1)
    np.testing.assert_allclose(found, expected, atol=0.0501 + 1e-9)


def test_two_figures_share_a_page_without_clashing_identifiers():
    drawing = line_of(([0, 1], [0, 1]))
    pages = [svg.inline(drawing, name, "a line from corner to corner") for name in ("a", "b")]
    ids = [set(re.findall(r'\bid="([^"]*)"', page)) for page in pages]
    assert not ids[0] & ids[1]
    for page, own in zip(pages, ids, strict=True):
        assert set(re.findall(r"#([\w-]+)\)", page)) <= own


def test_colours_words_and_alt_text():
    page = svg.inline(line_of(([0, 1], [0, 1])), "a", 'says "x < y"')
    assert "var(--accent)" in page
    assert "var(--ink)" in page
    assert "#01020" not in page
    assert "a &lt; b &amp; c" in page
    assert 'aria-label="says &quot;x &lt; y&quot;"' in page


def test_the_same_figure_is_the_same_text():
    drawing = line_of(([0, 1], [0, 1]))
    assert svg.inline(drawing, "a", "line") == svg.inline(drawing, "a", "line")


@pytest.mark.parametrize("name", ["a", "in-figure-2", "text-axes-line2d_1"])
def test_everything_a_figure_refers_to_is_in_it_whatever_its_name(name):
    def draw(palette):
        figure = Figure(figsize=(3, 2))
        figure.subplots().plot([0, 1], [0, 1], "o-", color=palette.accent)
        return figure

    page = svg.inline(draw, name, "a line with dots")
    references = set(re.findall(r'(?:href="#|url\(#)([^")]+)', page))
    assert len(references) >= 2  # a marker and a clipping path
    for reference in references:
        assert f'id="{reference}"' in page


def test_a_large_figure_becomes_a_picture(monkeypatch):
    monkeypatch.setattr(svg, "LARGEST_SVG", 100)
    page = svg.inline(line_of(([0, 1], [0, 1])), "a", "a line")
    assert page.startswith('<img class="card" alt="a line" src="data:image/png;base64,')
    data = base64.b64decode(re.search(r"base64,([^\"]*)", page)[1])
    assert data.startswith(b"\x89PNG")


def test_names_in_any_script_are_drawn_without_a_warning():
    def draw(palette):
        figure = Figure(figsize=(3, 2))
        figure.subplots().set_title("电机", color=palette.ink)
        return figure

    assert "电机" in svg.inline(draw, "a", "a title")
