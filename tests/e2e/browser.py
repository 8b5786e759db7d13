"""Debian's Chromium, driven by playwright: started once, a fresh context for every page."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

CHROMIUM = Path("/usr/bin/chromium")


@contextmanager
def chromium() -> Iterator:
    """Give a browser; skip the test where there is none, but not in CI."""
    from playwright.sync_api import sync_playwright

    if not CHROMIUM.exists():
        if os.environ.get("CI") == "true":
            pytest.fail(f"{CHROMIUM} is absent; .ci/run installs it")
        pytest.skip(f"{CHROMIUM} is absent")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=str(CHROMIUM),
            args=["--no-sandbox", "--disable-gpu", "--disable-background-networking"],
        )
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def open_page(browser, path: Path, width: int, height: int, **options) -> Iterator:
    """Give a page of a file and a list of what went wrong: messages, errors, requests."""
    context = browser.new_context(
        viewport={"width": width, "height": height}, accept_downloads=True, **options
    )
    try:
        page, wrong = context.new_page(), []
        page.on("console", lambda message: wrong.append(f"console: {message.text}"))
        page.on("pageerror", lambda error: wrong.append(f"error: {error}"))
        page.on("request", lambda request: _note_request(request.url, wrong))
        page.goto(path.resolve().as_uri())
        yield page, wrong
    finally:
        context.close()


def violations(page) -> list[tuple[str, str]]:
    """Return the rules that axe finds broken on an open page, with the first element of each."""
    from axe_playwright_python.sync_playwright import Axe

    page.locator("details").evaluate_all("all => all.forEach((one) => { one.open = true; })")
    broken = Axe().run(page).response["violations"]
    return [(one["id"], one["nodes"][0]["html"]) for one in broken]


def violations_of(path: Path) -> list[tuple[str, str]]:
    """Return the rules that axe finds broken in a file, in light and dark colours."""
    broken = []
    with chromium() as browser:
        for scheme in ("light", "dark"):
            with open_page(browser, path, 1280, 900, color_scheme=scheme) as (page, _):
                broken += violations(page)
    return broken


def _note_request(url: str, wrong: list[str]) -> None:
    if not url.startswith(("file:", "data:", "blob:")):
        wrong.append(f"request: {url}")
