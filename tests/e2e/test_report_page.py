import re
from collections import Counter
from html.parser import HTMLParser

import pytest

SECTIONS = (
    "summary",
    "robot",
    "candidates",
    "design",
    "positions",
    "comparison",
    "responses",
    "fit",
    "residuals",
    "parameters",
    "cross-check",
    "uncertainty",
    "weak-directions",
    "tool",
    "provenance",
)
VOID = {"meta", "link", "br", "img", "input"}


class Outline(HTMLParser):
    """Collects elements, and complains of tags that do not match."""

    def __init__(self):
        super().__init__()
        self.elements, self.open = [], []

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def page(small_study):
    folder, _ = small_study
    text = (folder / "report.html").read_text(encoding="utf-8")
    outline = Outline()
    outline.feed(text)
    assert outline.open == []
    return text, outline.elements


def test_every_section_is_there_and_in_the_contents(page):
    _, elements = page
    ids = {attrs.get("id") for _, attrs in elements}
    anchors = [attrs for tag, attrs in elements if tag == "a"]
    links = [attrs["href"] for attrs in anchors if attrs.get("class") != "term"]
    # The contents come first; text may point to a section again.
    assert list(dict.fromkeys(links)) == ["#content", *(f"#{section}" for section in SECTIONS)]
    assert set(SECTIONS) <= ids


def test_ids_are_unique_and_references_resolve(page):
    text, elements = page
    ids = Counter(attrs["id"] for _, attrs in elements if "id" in attrs)
    assert [name for name, count in ids.items() if count > 1] == []
    references = re.findall(r"url\(#([^)]+)\)", text)
    references += [a["href"][1:] for _, a in elements if a.get("href", "").startswith("#")]
    references += [a["aria-labelledby"] for _, a in elements if "aria-labelledby" in a]
    assert set(references) <= set(ids)


def test_nothing_is_fetched(page):
    text, elements = page
    for _, attrs in elements:
        for key in ("src", "href", "xlink:href", "action", "data"):
            assert attrs.get(key, "#").startswith(("#", "data:")), attrs
    assert "http://" not in text.replace("http://www.w3.org/2000/svg", "")
    assert "https://" not in text
    assert "@import" not in text
    for call in ("fetch(", "XMLHttpRequest", "import(", "WebSocket", "sendBeacon"):
        assert call not in text


def test_every_figure_says_what_it_shows(page):
    _, elements = page
    figures = [attrs for tag, attrs in elements if tag == "svg"]
    assert len(figures) >= 8
    for attrs in figures:
        assert attrs["role"] == "img"
        assert len(attrs["aria-label"]) > 20
    assert all(attrs.get("alt") for tag, attrs in elements if tag == "img")


def test_figures_take_the_pages_colours(page):
    text, _ = page
    assert "#01020" not in text
    assert "var(--accent)" in text
    assert "light-dark(" in text


def test_the_page_is_light(page):
    text, _ = page
    assert len(text.encode()) < 600_000


def test_words_and_numbers_of_the_certificate_and_the_table(page):
    text, _ = page
    for words in (
        "equivalence theorem",
        "d3.stiffness",
        "kN m/rad",
        "Theorem 1",
        "Trustworthy",
        "Quote the recommended standard deviations",
        "5 visits, 10 runs",
        "R-hat",
        "Seed 3",
    ):
        assert words in text
    assert "nan" not in re.sub(r"<[^>]*>", " ", text).split()
