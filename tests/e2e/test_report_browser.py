"""The report in a browser: its controls are clicked, its looks are measured."""

import csv
import io
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from browser import chromium, open_page
from PIL import Image

DESKTOP, PHONE = (1280, 900), (360, 740)


@pytest.fixture(scope="module")
def browser():
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def report(small_study):
    return small_study[0] / "report.html"


@pytest.fixture
def desktop(browser, report):
    with open_page(browser, report, *DESKTOP) as (page, wrong):
        yield page
        assert wrong == []


def picture(page):
    return np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))


def saved(page, button):
    with page.expect_download() as download:
        button.click()
    return download.value.suggested_filename, download.value.path().read_text(encoding="utf-8")


def test_one_position_is_shown_and_the_control_changes_it(desktop):
    section = desktop.locator("section[aria-labelledby=responses]")
    panels = section.locator(".choice")
    shown = [panels.nth(i).is_visible() for i in range(panels.count())]
    assert len(shown) >= 2
    assert shown == [True] + [False] * (len(shown) - 1)
    section.get_by_label("Next position").click()
    assert panels.nth(1).is_visible()
    assert not panels.nth(0).is_visible()
    section.locator("select").select_option(index=0)
    assert panels.nth(0).is_visible()
    section.get_by_label("Previous position").click()
    assert panels.nth(len(shown) - 1).is_visible()


def test_tables_sort_up_and_down_within_their_groups(desktop):
    table = desktop.locator("#estimates table")
    titles = [title.strip() for title in table.locator("thead th").all_text_contents()]
    column = titles.index("Theorem 1")

    def values(body):
        cells = (
            table.locator("tbody").nth(body).locator(f"tr:not(.group) td:nth-child({column + 1})")
        )
        return [float(cell.get_attribute("data-v")) for cell in cells.all()]

    before = values(0)
    head = table.locator("thead th").nth(column)
    head.locator("button").click()
    assert head.get_attribute("aria-sort") == "ascending"
    assert values(0) == sorted(before)
    assert values(1) == sorted(values(1))
    head.locator("button").click()
    assert head.get_attribute("aria-sort") == "descending"
    assert values(0) == sorted(before, reverse=True)
    assert table.locator("tbody").first.locator("tr").first.get_attribute("class") == "group"


def test_every_table_comes_down_as_csv(desktop):
    sheets = desktop.locator(".sheet")
    for i in range(sheets.count()):
        sheet = sheets.nth(i)
        for details in sheet.locator("xpath=ancestor::details").all():
            details.evaluate("element => { element.open = true; }")
        name, text = saved(desktop, sheet.locator("[data-save=csv]"))
        rows = list(csv.reader(io.StringIO(text)))
        assert name == sheet.get_attribute("id") + ".csv"
        assert len(rows) == 1 + sheet.locator("tbody tr:not(.group)").count()
        assert len({len(row) for row in rows}) == 1
    name, text = saved(desktop, desktop.locator("#estimates [data-save=csv]"))
    rows = list(csv.DictReader(io.StringIO(text)))
    assert {row["parameter"] for row in rows} >= {"d2.stiffness", "d3.damping"}
    assert all(float(row["Theorem 1"]) > 0 for row in rows)


def test_every_figure_comes_down_as_svg_in_light_colours(desktop):
    desktop.locator("#theme").click()
    desktop.locator("#theme").click()
    buttons = desktop.locator("[data-save=svg]:visible")
    assert buttons.count() >= 5
    for i in range(buttons.count()):
        name, text = saved(desktop, buttons.nth(i))
        assert name.endswith(".svg")
        root = ET.fromstring(text)
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        assert root.get("width").endswith("pt")
        assert "var(--" not in text
        assert "#1d5c92" in text or "#1c2126" in text


def test_light_dark_and_as_the_system_has_it(browser, report):
    with open_page(browser, report, *DESKTOP, color_scheme="light") as (page, wrong):
        button = page.locator("#theme")
        assert picture(page)[0, 0].min() > 240
        button.click()  # light
        assert page.locator("html").get_attribute("data-theme") == "light"
        button.click()  # dark
        assert picture(page)[0, 0].max() < 60
        page.reload()
        assert picture(page)[0, 0].max() < 60  # remembered
        page.locator("#theme").click()  # as the system
        assert picture(page)[0, 0].min() > 240
        page.emulate_media(color_scheme="dark")
        assert picture(page)[0, 0].max() < 60
        page.emulate_media(media="print")
        assert picture(page)[0, 0].min() > 240
        assert not page.locator("#theme").is_visible()
        assert wrong == []


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_nothing_is_wider_than_the_screen(browser, report, size):
    with open_page(browser, report, *size) as (page, wrong):
        for details in page.locator("details").all():
            details.evaluate("element => { element.open = true; }")
        root = page.locator("html")
        assert root.evaluate("e => e.scrollWidth") <= size[0]
        assert len(np.unique(picture(page).reshape(-1, 3), axis=0)) > 20  # not blank
        tall = page.locator("body").bounding_box()["height"]
        assert tall > 3000
        small = page.locator("svg text:visible").evaluate_all(
            """texts => Math.min(...texts.map((text) => {
                const box = text.ownerSVGElement;
                const scale = box.getBoundingClientRect().width / box.viewBox.baseVal.width;
                return parseFloat(getComputedStyle(text).fontSize) * scale;
            }))"""
        )
        assert small > 8.0  # [px]; figures scroll sideways rather than shrink
        assert wrong == []


def test_without_scripts_everything_is_shown(browser, report):
    with open_page(browser, report, *DESKTOP, java_script_enabled=False) as (page, wrong):
        panels = page.locator("section[aria-labelledby=responses] .choice")
        assert all(panels.nth(i).is_visible() for i in range(panels.count()))
        assert not page.locator("[data-save]").first.is_visible()
        assert page.locator("svg[data-robot]").first.is_visible()
        assert not page.locator(".hint").is_visible()
        assert wrong == []


def drawn(page):
    return page.locator("svg[data-robot]").evaluate_all(
        "pictures => pictures.map((one) => one.getAttribute('viewBox') + one.innerHTML)"
    )


def numbers(words):
    return [float(number) for number in re.findall(r"-?\d+\.\d+", words)]


def test_pictures_of_the_robot_turn_together_and_back(desktop):
    pictures = desktop.locator("svg[data-robot]")
    first, before = pictures.first, drawn(desktop)
    assert len(before) >= 2
    first.scroll_into_view_if_needed()
    box = first.bounding_box()
    desktop.mouse.move(box["x"] + 0.7 * box["width"], box["y"] + 0.5 * box["height"])
    desktop.mouse.down()
    desktop.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 0.9 * box["height"], steps=3)
    desktop.mouse.up()
    turned = drawn(desktop)
    assert all(now != then for now, then in zip(turned, before, strict=True))
    desktop.mouse.move(box["x"], box["y"])  # no button is held
    assert drawn(desktop) == turned
    assert first.bounding_box() == pytest.approx(box, abs=0.5)
    first.press("Home")
    home = drawn(desktop)
    for now, then in zip(home, before, strict=True):  # the script draws what the page came with
        assert numbers(now) == pytest.approx(numbers(then), abs=0.002)
    first.press("ArrowLeft")
    assert drawn(desktop) not in (home, turned)
    first.dblclick()
    assert drawn(desktop) == home


def test_turned_from_above_the_robot_casts_no_shadow(desktop):
    first = desktop.locator("svg[data-robot]").first
    for _ in range(9):
        first.press("ArrowUp")
    links, shadow = (
        first.locator(f"path.{part}").get_attribute("d") for part in ("links", "shadow")
    )
    assert links == shadow
    assert drawn(desktop)[0].count("NaN") == 0


def test_a_finger_turns_pictures_and_still_scrolls(browser, report):
    with open_page(browser, report, *PHONE, has_touch=True) as (page, wrong):
        first = page.locator("svg[data-robot]").first
        assert first.evaluate("e => getComputedStyle(e).touchAction") == "pan-y"
        assert page.locator(".hint").is_visible()
        assert page.locator(".wider").count() >= 1  # and says that it scrolls
        assert "scroll sideways" in page.locator(".wider > .tools").first.evaluate(
            "e => getComputedStyle(e, '::before').content"
        )
        assert wrong == []


def test_contents_lead_to_the_sections(desktop):
    for link in desktop.locator("nav a").all():
        link.click()
        assert desktop.locator(link.get_attribute("href")).is_visible()


def test_checks_can_fail(browser, tmp_path):
    broken = tmp_path / "broken.html"
    broken.write_text(
        '<img src="https://example.invalid/x.png"><script>undefinedFunction();</script>'
        '<div style="width: 2000px">wide</div>',
        encoding="utf-8",
    )
    with open_page(browser, broken, *PHONE) as (page, wrong):
        assert page.locator("html").evaluate("e => e.scrollWidth") > PHONE[0]
        assert any(words.startswith("error:") for words in wrong)
        assert any(words.startswith("request: https://example.invalid") for words in wrong)
