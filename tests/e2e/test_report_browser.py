"""The report in a browser: its controls are clicked, its looks are measured."""

import csv
import io
import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import h5py
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


@pytest.fixture(scope="module")
def loaded(browser, report):
    """Give one page for many tests, its pictures as they came, and what was wrong."""
    with open_page(browser, report, *DESKTOP, color_scheme="light") as (page, wrong):
        yield page, drawn(page), wrong


OPEN = "all => all.forEach((one) => { one.open = true; })"
RESET = """() => {
    while (document.documentElement.dataset.theme) document.getElementById("theme").click();
    document.querySelectorAll("details").forEach((one) => { one.open = false; });
    document.querySelectorAll(".chooser select").forEach((one) => {
        one.value = 0;
        one.dispatchEvent(new Event("change"));
    });
    const key = new KeyboardEvent("keydown", { key: "Home" });
    document.querySelector("svg[data-robot]").dispatchEvent(key);
    scrollTo({ top: 0, behavior: "instant" });
}"""
TOP = "scrollTo({ top: 0, behavior: 'instant' })"


@pytest.fixture
def desktop(loaded):
    page, _, wrong = loaded
    page.emulate_media(media="screen", color_scheme="light")
    page.evaluate(RESET)
    yield page
    assert wrong == []


@pytest.fixture(scope="module")
def phone_loaded(browser, report):
    with open_page(browser, report, *PHONE, has_touch=True) as (page, wrong):
        yield page, wrong


@pytest.fixture
def phone(phone_loaded):
    page, wrong = phone_loaded
    page.evaluate(RESET)
    yield page
    assert wrong == []


def picture(page, **options):
    return np.asarray(Image.open(io.BytesIO(page.screenshot(**options))).convert("RGB"))


def corner(page):
    """Return the colour of the page's background, above all that is written on it."""
    page.evaluate(TOP)
    return picture(page, clip={"x": 0, "y": 0, "width": 4, "height": 4})[0, 0]


def saved(page, button):
    with page.expect_download() as download:
        button.click()
    return download.value.suggested_filename, download.value.path().read_text(encoding="utf-8")


# The browser takes ten downloads a second; what the links would hand it is read from the page.
LINKED = """async (buttons) => {
    const links = HTMLAnchorElement.prototype, { click } = links, { createObjectURL } = URL;
    const made = [];
    let blob;
    URL.createObjectURL = (one) => createObjectURL.call(URL, (blob = one));
    links.click = function () { made.push([this.download, blob.text()]); };
    buttons.forEach((button) => button.click());
    Object.assign(links, { click });
    Object.assign(URL, { createObjectURL });
    return Promise.all(made.map(async ([name, text]) => [name, await text]));
}"""


def drawn(page):
    return page.locator("svg[data-robot]").evaluate_all(
        "pictures => pictures.map((one) => one.getAttribute('viewBox') + one.innerHTML)"
    )


def test_one_position_is_shown_and_the_control_changes_it(desktop):
    section = desktop.locator("section[aria-labelledby=responses]")
    panels = section.locator(".choice")
    shown = [panels.nth(i).is_visible() for i in range(panels.count())]
    assert len(shown) >= 2
    assert shown == [True] + [False] * (len(shown) - 1)
    section.get_by_label("Next position").click()
    assert panels.nth(1).is_visible()
    assert not panels.nth(0).is_visible()
    section.get_by_label("position", exact=True).select_option(index=0)
    assert panels.nth(0).is_visible()
    section.get_by_label("Previous position").click()
    assert panels.nth(len(shown) - 1).is_visible()


def test_an_element_is_enlarged_and_tells_its_values(desktop, small_study):
    panels = desktop.locator("#frf-1 svg[data-panels]")
    left, top, right, *_ = json.loads(panels.get_attribute("data-panels"))
    box, width = panels.bounding_box(), float(panels.get_attribute("viewBox").split()[2])
    scale = box["width"] / width
    panels.click(position={"x": scale * (left + right + 5), "y": scale * (top + 5)})
    element = desktop.locator("#frf-element")
    assert "from m3 to m2" in element.locator(".title").text_content()
    drawing = element.locator("svg")
    drawing.press("ArrowRight")  # the second line
    told = element.locator("output").text_content()
    with h5py.File(small_study[0] / "stages" / "data" / "result.h5") as file:
        estimate = file["estimate"]
        response = estimate["response"][0, 1, 0, 1]
        share = np.sqrt(estimate["covariance"][0, 1, 0, 1]) / abs(response)
        hertz = estimate["omega"][1] / (2 * np.pi)
    measured = re.search(r"([\d.]+) Hz; measured (\S+) dB, (\S+)°, std (\S+) %", told)
    values = [float(word.replace("−", "-")) for word in measured.groups()]
    expected = [hertz, 20 * np.log10(abs(response)), np.degrees(np.angle(response)), 100 * share]
    np.testing.assert_allclose(values, expected, rtol=0.05, atol=0.6)
    for view in ("Nyquist", "singular values", "coherence from SNR"):
        element.get_by_label("as", exact=True).select_option(view)
        whole = view == "singular values"  # of the matrix, so nothing is from one to another
        for choice in ("from", "beside"):
            assert element.get_by_label(choice, exact=True).is_hidden() == whole
        if not whole:
            element.get_by_label("beside").select_option("all positions")
        assert "NaN" not in drawing.inner_html()
        assert (" from " in drawing.get_attribute("aria-label")) != whole


def test_tables_sort_up_and_down_within_their_groups(desktop):
    table = desktop.locator("#estimates table")
    titles = [title.strip() for title in table.locator("thead th").all_text_contents()]
    column = titles.index("Theorem 1 [%]")

    def values(body):
        cells = (
            table.locator("tbody").nth(body).locator(f"tr:not(.group) td:nth-child({column + 1})")
        )
        return cells.evaluate_all("cells => cells.map((cell) => Number(cell.dataset.v))")

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
    sheets = desktop.locator(".sheet").evaluate_all(
        "all => all.map((one) => [one.id, one.querySelectorAll('tbody tr:not(.group)').length])"
    )
    files = desktop.locator(".sheet [data-save=csv]").evaluate_all(LINKED)
    assert len(files) == len(sheets) > 5
    for (sheet, count), (name, text) in zip(sheets, files, strict=True):
        rows = list(csv.reader(io.StringIO(text)))
        assert name == sheet + ".csv"
        assert len(rows) == 1 + count
        assert len({len(row) for row in rows}) == 1
    desktop.locator("details").evaluate_all(OPEN)
    name, text = saved(desktop, desktop.locator("#estimates [data-save=csv]"))
    assert list(csv.reader(io.StringIO(text))) == list(csv.reader(io.StringIO(dict(files)[name])))
    rows = list(csv.DictReader(io.StringIO(text)))
    assert {row["parameter"] for row in rows} >= {"d2.stiffness", "d3.damping"}
    assert all(float(row["Theorem 1 [%]"]) > 0 for row in rows)


def test_what_is_struck_out_is_marked_in_downloads_too(desktop):
    cell = desktop.locator("#estimates tbody tr:not(.group) td[data-v]").nth(1)
    number, before = cell.get_attribute("data-v"), cell.inner_html()
    cell.evaluate("(e) => { e.innerHTML = '<s>' + e.innerHTML + '</s>'; }")
    _, text = saved(desktop, desktop.locator("#estimates [data-save=csv]"))
    cell.evaluate("(e, html) => { e.innerHTML = html; }", before)
    assert f"struck out: {number}" in text
    assert text.count("struck out") == 1


def test_the_verdict_is_seen_first(desktop, phone):
    for page in (desktop, phone):
        box = page.locator(".banner").bounding_box()
        assert box["y"] + box["height"] < page.viewport_size["height"]
    assert desktop.locator(".banner .verdict").text_content() == (
        "Trustworthy: these numbers may be quoted"
    )


def test_every_figure_comes_down_as_svg_in_light_colours(desktop):
    desktop.locator("#theme").click()
    desktop.locator("#theme").click()
    buttons = desktop.locator("[data-save=svg]:visible")
    files = buttons.evaluate_all(LINKED)
    assert len(files) == buttons.count() >= 5
    assert saved(desktop, buttons.first) == tuple(files[0])
    for name, text in files:
        assert name.endswith(".svg")
        root = ET.fromstring(text)
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        assert root.get("width").endswith("pt")
        assert "var(--" not in text
        assert any(colour in text for colour in ("#1d5c92", "#1c2126", "#b3541e"))


def test_light_dark_and_as_the_system_has_it(desktop):
    button = desktop.locator("#theme")
    assert corner(desktop).min() > 240
    button.click()  # light
    assert desktop.locator("html").get_attribute("data-theme") == "light"
    button.click()  # dark
    assert corner(desktop).max() < 60
    desktop.reload()
    assert corner(desktop).max() < 60  # remembered
    button.click()  # as the system
    assert corner(desktop).min() > 240
    desktop.emulate_media(color_scheme="dark")
    assert corner(desktop).max() < 60
    desktop.emulate_media(media="print")
    assert corner(desktop).min() > 240
    assert not button.is_visible()


SCROLLED = """all => all.filter((one) => one.scrollWidth > one.clientWidth + 1)
    .map((one) => one.getAttribute("aria-label"))"""


@pytest.mark.parametrize("name", ["desktop", "phone"])
def test_nothing_is_wider_than_the_screen(request, name):
    page = request.getfixturevalue(name)
    page.locator("details").evaluate_all(OPEN)
    root = page.locator("html")
    assert root.evaluate("e => e.scrollWidth") <= page.viewport_size["width"]
    colours = picture(page).astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], dtype=np.uint32)
    assert len(np.unique(colours)) > 20  # not blank
    scrolled = page.locator(".scroll").evaluate_all(SCROLLED)
    assert [one for one in scrolled if name == "desktop" or not one.startswith("Table ")] == []
    tall = page.locator("body").bounding_box()["height"]
    assert tall > 3000
    small = page.locator("svg text:visible").evaluate_all(
        """texts => Math.min(...texts.map((text) => {
            const box = text.ownerSVGElement;
            const scale = box.getBoundingClientRect().width / box.viewBox.baseVal.width;
            return parseFloat(getComputedStyle(text).fontSize) * scale;
        }))"""
    )
    assert small > 8.0  # [px]


def test_without_scripts_everything_is_shown(browser, report):
    with open_page(browser, report, *DESKTOP, java_script_enabled=False) as (page, wrong):
        panels = page.locator("section[aria-labelledby=responses] .choice")
        assert all(panels.nth(i).is_visible() for i in range(panels.count()))
        assert not page.locator("[data-save]").first.is_visible()
        assert page.locator("svg[data-robot]").first.is_visible()
        assert not page.locator(".hint:visible").count()
        assert wrong == []


def numbers(words):
    return [float(number) for number in re.findall(r"-?\d+\.\d+", words)]


def test_pictures_of_the_robot_turn_together_and_back(desktop, loaded):
    first, before = desktop.locator("svg[data-robot]").first, loaded[1]
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


def test_a_mode_moves_the_pictures_and_lets_go(desktop):
    at_rest = drawn(desktop)
    choice = desktop.get_by_label("mode", exact=True)
    desktop.emulate_media(reduced_motion="reduce")  # a still picture at the amplitude
    choice.select_option("1")
    moved = drawn(desktop)
    assert all(now != then for now, then in zip(moved, at_rest, strict=True))
    assert " Hz (" in desktop.locator("#pose-1 .mode").text_content()
    choice.select_option("none")
    assert [numbers(one) for one in drawn(desktop)] == [
        pytest.approx(numbers(one), abs=0.002) for one in at_rest
    ]
    desktop.emulate_media(reduced_motion="no-preference")


def test_links_are_drawn_turn_and_move_with_modes(desktop):
    canvas = desktop.locator("#pose-1 canvas")
    painted = "canvas => canvas.toDataURL()"
    opaque = """canvas => canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height)
        .data.filter((value, k) => k % 4 === 3 && value === 255).length"""
    rest, size = canvas.evaluate(painted), canvas.evaluate("e => e.width * e.height")
    assert 0.003 * size < canvas.evaluate(opaque) < 0.5 * size
    desktop.emulate_media(reduced_motion="reduce")
    choice = desktop.get_by_label("mode", exact=True)
    choice.select_option("1")
    assert canvas.evaluate(painted) != rest
    choice.select_option("none")
    first = desktop.locator("svg[data-robot]").first
    first.press("ArrowLeft")
    assert canvas.evaluate(painted) != rest
    first.press("Home")
    assert canvas.evaluate(painted) == rest
    width = canvas.evaluate("e => e.width")
    desktop.get_by_label("size", exact=True).select_option("large")
    assert canvas.evaluate("e => e.width") > 1.5 * width
    desktop.emulate_media(reduced_motion="no-preference")
    with desktop.expect_download() as download:
        desktop.locator("#pose-1 [data-save]").click()
    saved = Path(download.value.path()).read_text()
    assert "data:image/png;base64," in saved
    assert 'class="tool"' in saved
    assert 'class="links"' not in saved


def test_the_design_map_tells_of_candidates(desktop):
    map_ = desktop.locator("#design-map")
    map_.get_by_label("across").select_option("tool x [m]")
    map_.get_by_label("up").select_option("tool z [m]")
    assert "tool x [m] and tool z [m]" in map_.locator("svg").get_attribute("aria-label")
    told = set()
    box = map_.locator("svg").bounding_box()
    for x in np.linspace(0.15, 0.95, 12):
        for y in (0.2, 0.5, 0.8):
            event = {
                "clientX": box["x"] + x * box["width"],
                "clientY": box["y"] + y * box["height"],
            }
            map_.locator("svg").dispatch_event("pointermove", event)
            told.add(map_.locator("output").text_content())
    words = r"Candidate, sensitivity ([\d.]+), weight [\d.]+: m2 \S+°, m3"
    candidates = [re.match(words, one) for one in told]
    values = [float(one[1]) for one in candidates if one]
    assert len(values) > 3
    assert max(values) <= 1.005
    for key, words in (("ArrowRight", "Position 1, "), ("ArrowLeft", "")):
        map_.locator("svg").focus()
        map_.get_by_label("across").select_option("tool x [m]")  # drawn anew
        map_.locator("svg").press(key)
        assert map_.locator("output").text_content().startswith(words)
    assert map_.locator("output").text_content().endswith(" m")


def test_turned_from_above_the_robot_casts_no_shadow(desktop):
    first = desktop.locator("svg[data-robot]").first
    for _ in range(9):
        first.press("ArrowUp")
    links, shadow = (
        first.locator(f"path.{part}").get_attribute("d") for part in ("links", "shadow")
    )
    assert links == shadow
    assert drawn(desktop)[0].count("NaN") == 0


def test_a_finger_turns_pictures_and_still_scrolls(phone):
    first = phone.locator("svg[data-robot]").first
    assert first.evaluate("e => getComputedStyle(e).touchAction") == "pan-y"
    assert phone.locator("section[aria-labelledby=positions] .hint").is_visible()
    assert phone.locator(".wider").count() >= 1  # and says that it scrolls
    assert "scroll sideways" in phone.locator(".wider > .tools").first.evaluate(
        "e => getComputedStyle(e, '::before').content"
    )


def test_contents_lead_to_the_sections(desktop):
    links = desktop.locator("nav a").all()
    assert len(links) > 5
    for i, link in enumerate(links):
        if i in (0, len(links) - 1):
            link.click()
        else:  # without the mouse, which takes longer
            link.evaluate("e => e.click()")
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


def test_a_mode_that_moves_is_told_with_its_damping_and_intervals(desktop):
    desktop.get_by_label("mode", exact=True).select_option("1")
    told = desktop.locator("#pose-1 .mode").text_content()
    desktop.get_by_label("mode", exact=True).select_option("0")
    words = re.fullmatch(
        r"([\d.]+) Hz \(([\d.]+) to ([\d.]+)\), damping ([\d.]+) % \(([\d.]+) to ([\d.]+)\)", told
    )
    hertz, low, high, damping, least, most = map(float, words.groups())
    assert low < hertz < high < 1.1 * low
    assert least < damping < most
