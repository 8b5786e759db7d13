"""Names and paths that a terminal, a page or a spreadsheet could obey are shown as they are."""

import csv
import io

import matplotlib.pyplot as plt
import pytest
from browser import chromium, open_page
from command_line import oed

from reports.page_elements import Column, Section, figure, filled, page, table
from robotmodels.common.printing import printable

HTML = "</script><img src=x onerror=\"document.title='run'\">"
FORMULAS = ["=1+1", "+1+1", "-1+1", "@SUM(1)", '=HYPERLINK("http://x","y")', "=1+1|calc,!A0"]
NUMBERS = ["-1.5", "+2", "1e-3"]


def drawn(palette):
    picture, axes = plt.subplots(figsize=(3, 2))
    axes.set_title(HTML, color=palette.ink)
    axes.plot([0, 1], [0, 1], label=HTML)
    axes.legend()
    plt.close(picture)
    return picture


def hostile_page() -> str:
    columns = [Column(HTML), Column("=2+3"), Column("name", code=True)]
    rows = [[HTML, word, HTML] for word in (*FORMULAS, *NUMBERS)]
    body = filled(
        "parameters.html.j2",
        parameters=table("values", HTML, columns, rows),
        forest=figure("forest", drawn, HTML),
        agreement=HTML,
        ratio=HTML,
        z_rms=HTML,
        refused=0,
    )
    return page(HTML, HTML, HTML, HTML, [Section("a", HTML, body)])


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "page.html"
    path.write_text(hostile_page(), encoding="utf-8")
    with chromium() as browser, open_page(browser, path, 1280, 900) as (opened, wrong):
        yield opened
        assert wrong == []


def test_html_in_names_is_text_on_a_page(shown):
    assert shown.title() == f"{HTML}: {HTML}"
    assert shown.locator("img").count() == 0
    assert shown.locator("h1").inner_text() == HTML
    assert shown.locator("script").count() == 1
    assert HTML in shown.locator("svg").first.text_content()
    assert shown.locator("svg").first.get_attribute("aria-label") == HTML


def test_no_cell_of_a_download_is_a_formula(shown):
    text = shown.evaluate(
        """async () => {
          let blob;
          URL.createObjectURL = (one) => { blob = one; return "#"; };
          document.querySelector("[data-save=csv]").click();
          return await blob.text();
        }"""
    )
    head, *rows = csv.reader(io.StringIO(text))
    assert head == [HTML, "'=2+3", "name"]
    assert [row[1] for row in rows] == [f"'{word}" for word in FORMULAS] + NUMBERS


@pytest.mark.parametrize("path", ["\x1b[31mred.yaml", "a\nb.yaml", "a\x9b.yaml", "\u202egnp.yaml"])
def test_a_terminal_obeys_no_path(path, tmp_path):
    for command in ("check", "run", "simulate", "frf"):
        _, out, err = oed(command, tmp_path / path)
        assert out == ""
        assert len(err.splitlines()) == 1
        assert err.removesuffix("\n").isprintable()
    assert printable("a\x1b[31m\u202eb\n") == "a\\u001b[31m\\u202eb\n"
