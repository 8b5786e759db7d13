"""Every code block and command of the documentation runs, page by page, top to bottom."""

import importlib.util
import itertools
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from browser import chromium, open_page, violations, violations_of
from command_line import oed
from conftest import drawn
from PIL import Image

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [
    ROOT / "AGENTS.md",
    *sorted(DOCS.rglob("*.md")),
]  # those of the gallery are run by test_examples
BLOCK = re.compile(r"^```(\w+)([^\n]*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
TITLE = re.compile(r'title="([^"]+)"')
ALONE = {"run", "design", "sample", "report", "simulate"}  # by a single process
SHOWN = {"text"}  # what a page shows and nobody can run


def blocks(page: Path) -> list[tuple[str, str, str]]:
    """Return language, what follows it, and content of each fenced block."""
    return BLOCK.findall(page.read_text(encoding="utf-8"))


def environment(folder: Path) -> dict[str, str]:
    """Return an environment in which `oed` is the one under test."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return os.environ | {"PATH": path, "MPLBACKEND": "Agg", "MPLCONFIGDIR": str(folder)}


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p)], ids=lambda p: p.stem)
def test_the_blocks_of_a_page_run(page, tmp_path, monkeypatch):
    """Python goes on where the page's block before it ended, as in one session."""
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    session = {"__name__": "__main__"}
    for language, options, content in blocks(page):
        title = TITLE.search(options)
        if title is not None:
            (work / title[1]).write_text(content, encoding="utf-8")
        elif language == "python":
            exec(compile(content, page.name, "exec"), session)
        elif language == "sh":
            for line in content.splitlines():
                run(line, tmp_path)
        else:
            assert language in SHOWN, f"{page.name}: a {language} block without a title is not run"


def run(line: str, folder: Path) -> None:
    """Run a command: `oed` in this process alone, which has the libraries loaded, the rest by bash.

    By default a process per core would load them all first; `oed fit` shows that this works.
    """
    command, _, target = line.partition(" > ")
    words = shlex.split(command, comments=True)
    if words[:1] != ["oed"]:
        shell(line, folder)
        return
    if words[1] in ALONE and "--workers" not in words:
        words += ["--workers", "1"]
    with drawn():  # tests of each kind of page have its pictures
        code, out, err = oed(*words[1:])
    assert code == 0, f"{line}\n{err}"
    if target:
        Path(target.strip()).write_text(out, encoding="utf-8")


def shell(commands: str, folder: Path) -> None:
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", commands],
        env=environment(folder),
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, f"{commands}\n{done.stdout}\n{done.stderr}"


@pytest.mark.parametrize("package", ["robotmodels", "estimators", "oed"])
def test_the_reference_names_every_public_name_once(package):
    rooms = hook("reference").public_names(package)
    assert sorted(name for names in rooms.values() for name in names) == sorted(
        importlib.import_module(package).__all__
    )
    pages = "".join(page.read_text(encoding="utf-8") for page in (DOCS / "api").glob("*.md"))
    assert sorted(re.findall(rf"^::: room {package}\.(\w+)$", pages, re.MULTILINE)) == sorted(rooms)


def hook(name: str):
    """Return a hook of the build."""
    spec = importlib.util.spec_from_file_location(name, DOCS / "hooks" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_first_sentences_go_on_over_lines_and_stop_at_their_end():
    first_sentence = hook("llms").first_sentence
    page = "# Title\n\n*Which [springs](a.md), and\nhow sure?* More words.\n\nAnother one.\n"
    assert first_sentence(page) == "Which springs, and how sure?"
    assert first_sentence("# Title\n") == ""


def test_formulas_become_mathml():
    content = r'<p>of <span class="arithmatex">\(a &lt; b\)</span></p>'
    page = hook("mathematics").on_page_content(content)
    assert (
        page == '<p>of <math xmlns="http://www.w3.org/1998/Math/MathML" display="inline"><mrow>'
        "<mi>a</mi><mo>&#x0003C;</mo><mi>b</mi></mrow></math></p>"
    )
    block = hook("mathematics").on_page_content(r'<div class="arithmatex">\[x^2\]</div>')
    assert '<div class="formula"><math' in block
    assert "<msup>" in block


@pytest.mark.parametrize(
    ("plain", "latex"),
    [
        ("P = H^-1 J H^-1", r"P = H^{-1} J H^{-1}"),
        ("sum_k conj(Psi_k)", r"\sum _{k} \overline{\Psi _{k}}"),
        ("lambda_min(M) >= 0", r"\lambda _{\min }(M) \ge  0"),
        ("floor sqrt(x_ij)^(1/p)", r"\mathrm{floor} \sqrt{x_{ij}}^{1/p}"),
    ],
)
def test_formulas_of_docstrings_become_latex(plain, latex):
    assert hook("mathematics").latex(plain) == latex


def test_formulas_of_docstrings_have_no_word_that_is_unknown():
    """Each word is a function, a Greek letter, a symbol of two letters, or a name beside."""
    names = {"relative", "floor", "gain", "lag", "delay", "opt"}
    latex = hook("mathematics").latex
    formulas = [
        formula
        for package in ("robotmodels", "estimators", "oed")
        for path in (ROOT / package).rglob("*.py")
        for formula in re.findall(r"\$(\S[^$\n]*\S)\$", path.read_text(encoding="utf-8"))
    ]
    assert len(formulas) > 20
    for formula in formulas:
        assert set(re.findall(r"mathrm\{(\w+)\}", latex(formula))) <= names, formula


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_functions_named_in_a_page_exist(page):
    """`package.module.name` in running text is something that can be imported."""
    text = BLOCK.sub("", page.read_text(encoding="utf-8"))
    for dotted in re.findall(r"`((?:robotmodels|estimators|oed)(?:\.\w+)+)`", text):
        package, *rest = dotted.split(".")
        found = importlib.import_module(package)
        for i, name in enumerate(rest):
            if not hasattr(found, name):
                found = importlib.import_module(".".join([package, *rest[: i + 1]]))
            else:
                found = getattr(found, name)


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda p: p.stem)
def test_files_named_in_a_page_exist(page):
    text = BLOCK.sub("", page.read_text(encoding="utf-8"))
    for path in re.findall(
        r"`((?:robotmodels|estimators|oed|reports|studies|examples)/[^`]*)`", text
    ):
        assert (ROOT / path).exists(), path


def test_the_page_of_the_viewer_shows_the_viewer():
    page = (DOCS / "how-to" / "view.md").read_text(encoding="utf-8")
    shown = re.findall(r"!\[[^]]*]\(([^)]+)\)", page)
    assert shown == ["../pictures/viewer.png"]
    picture = Image.open(DOCS / "how-to" / shown[0]).convert("RGB")
    assert min(picture.size) > 600
    red, green, blue = np.asarray(picture).astype(int).transpose(2, 0, 1)
    order = (red > 180) & (green < 90) & (blue < 150)  # the line along the plan's visits
    assert order.sum() > 200


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder of the built documentation, without what the gallery's scripts print and draw."""
    folder = tmp_path_factory.mktemp("docs")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir"]
    run = subprocess.run(
        [*command, str(folder / "site")],
        cwd=ROOT,
        env=environment(folder) | {"DOCS_GALLERY": "unrun"},  # `make docs` runs it
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    # Its addresses begin at the root of a server.
    lost = folder / "site" / "404.html"
    lost.write_text(re.sub(r'((?:href|src)=")/', r"\1", lost.read_text(encoding="utf-8")))
    return folder / "site"


QUICK = ("index", "how-to/campaign/index", "how-to/one-run-per-visit/index", "api/reports/index")


@pytest.mark.parametrize("name", QUICK)
def test_axe_finds_no_violation_in_pages_of_the_documentation(site, name):
    assert violations_of(site / f"{name}.html") == []


def test_a_page_with_long_formulas_fits_a_phone(site):
    with chromium() as browser:
        path = site / "api" / "robots" / "index.html"
        with open_page(browser, path, 390, 800) as (page, _):
            assert page.locator("html").evaluate("e => e.scrollWidth") <= 390


@pytest.mark.slow
def test_axe_finds_no_violation_in_any_page_of_the_documentation(site):
    pages, broken = sorted(site.rglob("*.html")), {}
    assert len(pages) > 50
    with chromium() as browser:
        for path, scheme in itertools.product(pages, ("light", "dark")):
            with open_page(browser, path, 1280, 900, color_scheme=scheme) as (page, _):
                broken[f"{path.relative_to(site)}, {scheme}"] = violations(page)
                page.set_viewport_size({"width": 390, "height": 800})
                width = page.locator("html").evaluate("e => e.scrollWidth")
                assert width <= 390, f"{path.relative_to(site)}: {width} px wide on a phone"
    assert not {name: rules for name, rules in broken.items() if rules}


def test_the_site_builds_without_warnings(site):
    page = (site / "index.html").read_text(encoding="utf-8")
    assert not re.search(r'(?:src|href)="https?://(?!squidfunk)[^"]*\.(?:js|css|woff2?)"', page)
    listed = (site / "llms.txt").read_text("utf-8")
    assert "- [Tutorial](tutorial/index.html): Ten minutes, of which the computer" in listed
    assert all(
        f"{one.stem}/index.html" in listed for one in DOCS.rglob("*.md") if one.stem != "index"
    )
    reference = (site / "api" / "uncertainty" / "index.html").read_text("utf-8")
    assert "$" not in re.sub(r"<(script|code|pre)\b.*?</\1>", "", reference, flags=re.DOTALL)
    assert "<msup><mi>H</mi>" in reference  # of Theorem 1
    assert "<code>ndarray, (Q, n), rad</code>" in reference  # as it is written, no Python tuple
