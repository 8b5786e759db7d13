"""Studies whose records are fitted as runs: one run a visit, from the command line to the page."""

import json
import re
import shutil

import numpy as np
import pytest
from browser import chromium, open_page, violations_of
from command_line import oed
from conftest import STUDY, write_study
from test_study_data import TRUTH, fitted, ran

import estimators

EXPERIMENT = """\
data:
  experiment:
    multisine: {band: [3.0, 40.0], sample_time: 0.004, period: 0.5, odd: false, detection: 4}
    runs: 1
    blocks: 1
    transient_periods: 2
    limits: {speed: 0.5}
    imperfections: {friction: 0.0, angle_noise: 1.0e-5}
profiles: 1
"""
SHORT = re.sub(r"^(fit|compare): .*\n", "", STUDY, flags=re.M).replace("steps: 400", "steps: 100")
SHORT = SHORT.replace("experiments: 5", "experiments: 3, most: 2")
SIMULATED = SHORT.replace("posterior", f"fit: {{decades: 0.1, starts: 2}}\n{EXPERIMENT}posterior")
MEASURED = """\
schema: study/1
robot: robot.yaml
data: {records: records.h5, noise: detection}
fit:
  estimators: [{name: rows, residual: sml, weights: row_wise}]
  decades: 0.1
  starts: 1
posterior: {ensembles: 2, walkers: 16, steps: 100}
profiles: 0
validation: {positions: [1]}
output: results/here
"""


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    path = write_study(tmp_path_factory.mktemp("runs"), SIMULATED)
    return path, *ran(path, "spectra-1")


def test_records_are_fitted_as_runs_by_default(simulated):
    _, folder, page = simulated
    np.testing.assert_allclose(fitted(folder), TRUTH, rtol=0.02)
    stages = {path.name for path in (folder / "stages").iterdir()}
    assert {"fit-sml", "posterior", "profiles", "cross-check"} <= stages
    assert "cost-posterior" not in stages  # runs have no weights but those of their noise
    fit = json.loads((folder / "fit.json").read_text())
    assert fit["residual"] == "sml"
    assert fit["trust"]["verdict"] in estimators.VERDICTS
    uncertainty = json.loads((folder / "uncertainty.json").read_text())
    assert not uncertainty["failures"]
    ratio = np.divide(uncertainty["emcee"]["std"], uncertainty["theorem1"]["std"])
    assert (np.abs(np.log(ratio)) < 0.3).all()
    for section in ("run-spectra", "residuals", "cross-check", "controller"):
        assert f'id="{section}"' in page
    assert 'id="responses"' not in page
    ids = re.findall(r'<(?:h2|div|table|figure)[^>]* id="([^"]+)"', page)
    assert len(set(ids)) == len(ids)
    assert "outputs of 1 run in each of 3 visits" in " ".join(page.split())
    assert "visit 2" in page  # one of the two positions is visited twice
    tested = {one["name"] for one in fit["trust"]["directions"]}
    assert "d2.stiffness in position 2" in tested
    assert "d2.stiffness in position 3" not in tested


def test_an_element_of_a_run_is_enlarged(simulated):
    _, folder, _ = simulated
    with (
        chromium() as browser,
        open_page(browser, folder / "report.html", 1280, 900) as (page, bad),
    ):
        element = page.locator("#frf-element")
        element.locator("svg").wait_for()
        assert element.locator(".title").text_content() == (
            "Visit 1, m2 of run 1: Bode and residuals"
        )
        assert "dB of 1 rad/s²" in element.locator("svg").inner_html().replace("<", " ")
        views = element.get_by_label("as", exact=True).locator("option").all_text_contents()
        assert views == ["Bode and residuals", "Nyquist"]
        element.locator("svg").press("ArrowRight")
        told = element.locator("output").text_content()
        assert re.search(r"measured .* dB.*; predicted .* dB.*; residual \S+ and \S+ std", told), (
            told
        )
        assert "coherence" not in told
        element.get_by_label("beside").select_option("all visits")
        element.get_by_label("as", exact=True).select_option("Nyquist")
        assert "NaN" not in element.locator("svg").inner_html()
        assert bad == []


@pytest.mark.parametrize("width", [390, 1100, 1400])
def test_figures_fit_every_screen_and_tables_wide_ones(simulated, width):
    _, folder, _ = simulated
    with (
        chromium() as browser,
        open_page(browser, folder / "report.html", width, 900) as (page, bad),
    ):
        page.locator("#frf-element svg").wait_for()
        page.locator("details").evaluate_all("all => all.forEach((one) => { one.open = true; })")
        assert page.locator("html").evaluate("e => e.scrollWidth") <= width
        scrolled = page.locator(".scroll").evaluate_all(SCROLLED)
        assert [one for one in scrolled if width > 390 or not one.startswith("Table ")] == []
        assert bad == []


SCROLLED = """all => all.filter((one) => one.scrollWidth > one.clientWidth + 1)
    .map((one) => one.getAttribute("aria-label"))"""


def test_a_visit_of_one_run_is_worth_its_part_of_an_experiment(simulated):
    _, folder, _ = simulated
    design = json.loads((folder / "design.json").read_text())
    assert design["exact"]["runs"] == design["exact"]["experiments"] == 3
    whole = SIMULATED.replace("runs: 1\n", "runs: 2\n")
    both = write_study(folder.parent / "both", whole)
    from oed.study.pipeline import design_study
    from oed.study.settings.study_file import load_study

    predicted = design_study(load_study(both)).plan_summary.predicted
    ratio = np.divide(design["predicted"]["std"], [one.std for one in predicted])
    np.testing.assert_allclose(ratio, np.sqrt(2))


def test_axe_finds_no_violation_on_a_page_of_runs_and_rows_of_its_map_are_visits(simulated):
    _, folder, page = simulated
    assert violations_of(folder / "report.html") == []
    picture = page[page.index('id="residual-map"') :]
    names = re.findall(r"<text[^>]*>([^<]*)</text>", picture[: picture.index("</svg>")])
    assert {"1", "2"} & set(names)
    assert any(name.endswith(", visit 2") for name in names)


@pytest.mark.parametrize(
    ("right", "wrong", "words"),
    [
        ("starts: 2", "starts: 2, residuals: [nls]", "runs: 1; FRFs need 2, as many as motors"),
        ("runs: 1", "runs: 3", "data.experiment.runs: 3; a block has 1 to 2"),
    ],
)
def test_numbers_of_runs_that_cannot_be_are_named(right, wrong, words, tmp_path):
    code, _, err = oed("run", write_study(tmp_path, SIMULATED.replace(right, wrong)))
    assert (code, len(err.splitlines())) == (2, 1)
    assert words in err


def test_nothing_is_computed_again(simulated):
    path, _, _ = simulated
    code, out, _ = oed("fit", path, "--workers", 1)
    assert code == 0
    assert "reused   candidates, information, design, experiment, data, fit-sml, result" in out


def test_measured_runs_are_fitted_but_for_what_is_held_out(simulated, tmp_path):
    shutil.copy(simulated[1] / "stages" / "experiment" / "records.h5", tmp_path)
    path = write_study(tmp_path, MEASURED)
    folder, page = ran(path)
    np.testing.assert_allclose(fitted(folder), TRUTH, rtol=0.03)
    words = " ".join(page.split())
    assert "1 measured position was not fitted: outputs of runs there" in words
    assert "From measured outputs of runs in 2 positions" in words
    assert "Outputs were weighted one by one" in words
    path.write_text(MEASURED.replace("robot.yaml", "moberg_axis1"), encoding="utf-8")
    code, _, err = oed("run", path, "--workers", 1)
    assert (code, len(err.splitlines())) == (2, 1)
    assert "records.h5: runs: not of moberg_axis1" in err
