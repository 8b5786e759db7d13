"""Tables, links and print of a report in a browser; axe judges its accessibility."""

import csv
import io
import itertools
import json
import re
import shutil
from decimal import Decimal, InvalidOperation

import numpy as np
import pytest
from browser import chromium, open_page, violations
from command_line import oed
from conftest import STUDY, write_study

DESKTOP, PHONE = (1280, 900), (390, 800)
OPEN = "all => all.forEach((one) => { one.open = true; })"


@pytest.fixture(scope="module")
def browser():
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def pages(small_study, tmp_path_factory):
    """Pages of a study, of its design, of one with a floor, of a robot, and of two studies."""
    folder = tmp_path_factory.mktemp("pages")
    shutil.copytree(small_study[0].parents[1], folder / "study")
    study = folder / "study" / "study.yaml"
    code, _, err = oed("design", study, "--workers", 1)
    assert (code, err) == (0, "")
    code, _, err = oed("check", folder / "study" / "robot.yaml", "-o", folder / "check.html")
    assert (code, err) == (0, "")
    other = study.with_name("other.yaml")
    other.write_text(study.read_text().replace("results/here", "results/there"))
    shutil.copytree(study.parent / "results" / "here", study.parent / "results" / "there")
    target = folder / "comparison.html"
    code, _, err = oed("report", study, other, "-o", target, "--workers", 1)
    assert (code, err) == (0, "")
    low = STUDY.replace("[-2.5, -0.5]", "[-2.5, 0.6]").replace(
        "per_joint", "floor: 0.0\n  per_joint"
    )
    code, _, err = oed("design", write_study(folder / "low", low), "--workers", 1)
    assert (code, err) == (0, "")
    results = study.parent / "results" / "here"
    return {
        "rejected": folder / "low" / "results" / "here" / "design.html",
        "study": small_study[0] / "report.html",
        "design": results / "design.html",
        "check": folder / "check.html",
        "comparison": target,
    }


@pytest.fixture(params=["study", "design", "check", "comparison"])
def shown(browser, pages, request):
    with open_page(browser, pages[request.param], *DESKTOP) as (page, wrong):
        page.locator("details").evaluate_all(OPEN)
        yield page
        assert wrong == []


@pytest.fixture
def study(browser, pages):
    with open_page(browser, pages["study"], *DESKTOP) as (page, wrong):
        yield page
        assert wrong == []


@pytest.mark.parametrize("name", ["study", "design", "check", "comparison"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_violation(browser, pages, name, scheme):
    with open_page(browser, pages[name], *DESKTOP, color_scheme=scheme) as (page, _):
        assert violations(page) == []


def test_the_page_of_a_robot_says_what_the_terminal_says(browser, pages):
    code, said, _ = oed("check", pages["check"].parent / "study" / "robot.yaml")
    assert code == 0
    words = " ".join(re.sub(r"\s+", " ", said).split())
    with open_page(browser, pages["check"], *DESKTOP) as (page, _):
        rows = page.locator("#anti-resonance-table tbody tr").all_inner_texts()
        caption = page.locator("#mode-table caption").inner_text()
        heads = page.locator("#motor-table thead, #spring-table thead").all_inner_texts()
    for remark in re.sub(r"^.*?motors free; (.*)\.$", r"\1", caption).split("; "):
        assert remark in words
    first = said[said.index("anti-resonances up to") :].splitlines()[1].split()
    assert re.split(r"[\s,]+", rows[0].strip()) == [*first, "0"]  # none lies above
    assert not any(" or " in head.replace("joint or link", "") for head in heads)


def test_axe_finds_what_is_wrong(browser, tmp_path):
    bad = tmp_path / "bad.html"
    bad.write_text("<img src='data:,'><p style='color: #999; background: #888'>grey</p>")
    with open_page(browser, bad, *DESKTOP) as (page, _):
        assert {"image-alt", "color-contrast"} <= {id for id, _ in violations(page)}


SHOWN = """cells => cells.filter((one) => !("words" in one.dataset)).map(
    (one) => [one.textContent.trim(), Number(one.dataset.v), one.closest(".sheet").id])"""


def number_of(words):
    """Return the number that a cell shows and what its last digit counts; None of words."""
    words = re.sub(r"\s", "", words).replace("−", "-")
    powers = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
    words = re.sub(r"×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)$", lambda p: f"e{p[1].translate(powers)}", words)
    try:
        digit = Decimal(words).as_tuple().exponent
    except InvalidOperation:
        return None
    return float(words), 10.0**digit


def test_downloads_have_the_numbers_and_units_of_the_page(shown):
    cells = shown.locator("tbody [data-v]").evaluate_all(SHOWN)
    assert len(cells) > 10
    words = {"–", "∞", "undetermined", "file"}
    for text, value, sheet in cells:
        number = number_of(text)
        if number is None:
            assert text in words or text.startswith(("<", "struck out")), (sheet, text)
            continue
        # Efficiencies are rounded down, all else to the nearest.
        assert abs(number[0] - value) < number[1] + 1e-7 * abs(value), (sheet, text)


def test_every_row_has_a_heading(shown):
    rows = shown.locator("tbody tr:not(.group)")
    assert rows.count() == shown.locator("tbody tr:not(.group) > th[scope=row]").count() > 1


def test_rows_are_filtered_by_name_here_and_in_downloads(browser, pages):
    # Only long tables offer it: this one is made long.
    text = pages["study"].read_text(encoding="utf-8")
    rows = "".join(f"<tr><th scope=row>{n}</th><td data-v='1'>1</td></tr>" for n in "abcdefgh")
    longer = re.sub(
        r'(<div class="sheet" id="stages">.*?</tbody>)',
        rf"\1<tbody>{rows}</tbody>",
        text,
        count=1,
        flags=re.S,
    )
    path = pages["check"].with_name("longer.html")
    path.write_text(longer, encoding="utf-8")
    with open_page(browser, path, *DESKTOP) as (page, _):
        sheet = page.locator("#stages")
        sheet.get_by_label("Filter by name").fill("B")
        assert sheet.locator("tbody tr:visible").all_text_contents() == ["b1"]
        with page.expect_download() as download:
            sheet.locator("[data-save=csv]").click()
        saved = list(csv.reader(io.StringIO(download.value.path().read_text())))
        assert saved[1:] == [["b", "1"]]


def test_tables_are_copied_as_latex(study):
    study.context.grant_permissions(["clipboard-read", "clipboard-write"])
    study.evaluate(
        "() => Object.defineProperty(navigator, 'clipboard', "
        "{ value: { writeText: async (text) => { window.copied = text; } } })"
    )
    cell = study.locator("#estimates tbody tr:not(.group) td").first
    number = cell.text_content()
    cell.evaluate("one => { one.textContent = '∞ µm'; }")
    study.locator("#estimates [data-copy=latex]").click()
    text = study.evaluate("window.copied")
    cell.evaluate("(one, words) => { one.textContent = words; }", number)
    assert r"$\infty$ $\mu$m" in text
    assert text.splitlines()[1].startswith(r"\begin{tabular}{l")
    assert r"d2.stiffness &" in text
    assert r"std [\%]" in text
    assert r"{Springs}" in text
    assert text.count("&") % (text.splitlines()[3].count("&")) == 0
    assert not re.search(r"[−±≥°⁻×∞µμ]", text)


def test_a_link_to_a_part_opens_it(browser, pages):
    with open_page(browser, pages["study"], *DESKTOP) as (page, _):
        assert not page.locator("#frf-2").is_visible()
        page.goto(f"{page.url}#frf-2")
        page.evaluate("dispatchEvent(new HashChangeEvent('hashchange'))")
        assert page.locator("#frf-2").is_visible()
        assert not page.locator("#frf-1").is_visible()
        page.goto(f"{page.url.split('#')[0]}#all-runs")
        assert page.locator("#runs").is_visible()


def test_terms_lead_to_the_glossary_by_the_keyboard(browser, pages):
    with open_page(browser, pages["study"], *DESKTOP) as (page, _):
        entry = page.locator("#term-r-hat")
        assert not entry.is_visible()
        page.locator(".tiles a.term:has-text('R-hat')").focus()
        page.keyboard.press("Enter")
        entry.wait_for(state="visible")
        assert "R-hat" in entry.text_content()


def test_print_has_every_position_and_what_is_folded(study):
    study.emulate_media(media="print")
    panels = study.locator("section[aria-labelledby=responses] .choice")
    assert panels.count() >= 2
    assert all(panels.nth(i).is_visible() for i in range(panels.count()))
    assert study.locator("#runs td").first.bounding_box()["height"] > 0
    assert not study.locator(".filter").first.is_visible()
    terms = study.locator("#glossary dt:visible").all_inner_texts()
    assert {"R-hat", "p-value", "z"} <= set(terms)
    assert "BIC" not in terms  # of other pages
    study.emulate_media(media="screen")


def test_the_keyboard_skips_to_the_content_and_stops_only_where_something_scrolls(study):
    study.keyboard.press("Tab")
    assert study.evaluate("document.activeElement.className") == "skip"
    study.keyboard.press("Enter")
    assert study.evaluate("document.activeElement.id") == "content"
    boxes = study.locator(".scroll").evaluate_all(
        """all => all.filter((one) => one.checkVisibility()).map((one) => [
            one.tabIndex, one.scrollWidth > one.clientWidth + 1, one.getAttribute("aria-label")])"""
    )
    assert all((index == 0) == scrolls and name for index, scrolls, name in boxes)


QUESTIONS = {
    # question: page, links to click, where the answer is, and what it must say
    "May I trust these numbers?": ("study", [], ".banner .verdict", "{verdict}"),
    "Which standard deviation do I quote?": (
        "study",
        [],
        ".banner >> text=Quote the recommended",
        "standard deviations .*Theorem 1",
    ),
    "What do I do next?": ("study", [], ".banner p:has-text('Next:')", "Next: ."),
    "Which position do I measure first?": (
        "design",
        ["Positions"],
        "#plan tbody tr >> nth=0",
        "^1 {first}",
    ),
    "How long is the robot needed?": ("study", [], ".tiles div:has-text('robot time')", r"\d.* s"),
    "How sure is the damping of d3?": (
        "study",
        ["Parameters"],
        "#estimates tr:has-text('d3.damping')",
        "{std}",
    ),
    "What unit is this?": (
        "study",
        ["Parameters"],
        "#estimates tr:has-text('d3.stiffness')",
        "kN m/rad",
    ),
    "How accurate will the plan be?": (
        "design",
        ["Design"],
        "[aria-labelledby=design] p:has-text('Expected relative')",
        "{predicted}",
    ),
    "Why were candidates rejected?": (
        "rejected",
        ["Candidates"],
        "[aria-labelledby=candidates] p:has-text('Rejected for')",
        "Rejected for .*: 8[.,]",
    ),
    "What is R-hat?": ("study", [], ".tiles abbr:has-text('R-hat')", "R-hat"),
    "How do I make this page again?": ("study", ["Provenance"], "pre:has-text('oed run')", "study"),
    "Do two studies differ?": (
        "comparison",
        ["Estimates"],
        "figure:has(#differences-1), div:has(> #differences-1), #differences-1",
        "p-value",
    ),
    "What is wrong with my robot file?": ("check", [], ".banner .verdict", "Nothing looks wrong"),
}
"""What people ask; each answer is on one screen, or there after two clicks at most."""


@pytest.fixture(scope="module")
def facts(pages):
    """What the files say, in the words of pages."""
    folder = pages["study"].parent
    design = json.loads((folder / "design.json").read_text())
    trust = json.loads((folder / "uncertainty.json").read_text())["trust"]
    (damper,) = (one for one in trust["intervals"] if one["name"] == "d3.damping")
    angles = np.degrees(design["positions"][0]["position"])
    return {
        "verdict": trust["verdict"].capitalize(),
        "first": " ".join(f"{angle:.0f}".replace("-", "−") for angle in angles),
        "std": f"{100 * damper['std'] / damper['value']:.2f} ",
        "predicted": f"{100 * max(design['predicted']['std']):.2g} ?.?%",
    }


@pytest.mark.parametrize("question", QUESTIONS)
def test_questions_are_answered_on_one_screen_or_within_two_clicks(browser, pages, facts, question):
    name, links, answer, words = QUESTIONS[question]
    assert len(links) <= 2
    with open_page(browser, pages[name], *DESKTOP) as (page, _):
        page.evaluate("document.documentElement.style.scrollBehavior = 'auto'")
        for link in links:
            page.locator("nav").get_by_text(link, exact=True).click()
        found = page.locator(answer).first
        box, said = found.bounding_box(), " ".join(found.inner_text().split())
        assert re.search(words.format(**facts) if "{" in words else words, said), said
        assert 0 <= box["y"] < DESKTOP[1] - 30


def test_the_map_says_why_a_position_was_rejected(browser, pages):
    with open_page(browser, pages["rejected"], *DESKTOP) as (page, _):
        map_ = page.locator("#design-map")
        map_.locator("svg").wait_for()
        box, said = map_.locator("svg").bounding_box(), set()
        for x, y in itertools.product(np.linspace(0.1, 0.98, 30), np.linspace(0.05, 0.9, 15)):
            at = {"clientX": box["x"] + x * box["width"], "clientY": box["y"] + y * box["height"]}
            map_.locator("svg").dispatch_event("pointermove", at)
            said.add(map_.locator("output").text_content())
    assert any(re.match(r"Rejected \(.*floor.*\): m2", one) for one in said), said


def test_studies_laid_over_each_other_tell_their_difference(browser, pages):
    with open_page(browser, pages["comparison"], *DESKTOP) as (page, wrong):
        element = page.locator("#frf-element")
        element.locator("svg").wait_for()
        assert "Bode and difference" in element.locator(".title").text_content()
        for view in ("singular values", "Nyquist", "Bode and difference"):
            element.get_by_label("as", exact=True).select_option(view)
            drawing = element.locator("svg")
            assert "NaN" not in drawing.inner_html()
            assert drawing.locator('path[stroke-dasharray="7 4"]').count() >= 1
        drawing.press("ArrowRight")
        told = element.locator("output").text_content()
        assert re.search(r"; study [\d.]+ dB.*; other [\d.]+ dB.*; difference 0.00 dB$", told), told
        assert wrong == []
