"""The published study in small: two joints that harden, six estimators, judged on a page."""

import json
import re

import numpy as np
import pytest
from browser import violations_of
from command_line import oed
from conftest import ROBOT, STUDY, drawn, write_study

import estimators
import robotmodels
from oed.replication.as_published import published_settings
from oed.replication.local_minima import first_blocks
from oed.replication.paper import CONCLUSIONS
from oed.study.settings.study_file import ESTIMATORS, load_study
from oed.study.stages.data import Data
from reports.text import ranges
from robotmodels.common.dataclass_files import read_dataclass

MODEL = ROBOT + "  - {name: b3x, joint: elbow_joint, axis: x, stiffness: 5.0e4, damping: 50}\n"
PLANT = MODEL.replace("stiffness: 4.0e4", "stiffness: {low: 3.4e4, high: 5.0e4, torque: 300}")
FITS = """\
fit:
  decades: 0.5
  starts: 2
  estimators:
    - {name: LLSM15U, residual: lls_magnitude, weights: user}
    - {name: LLS15U, residual: lls, weights: user}
    - {name: LLS15O, residual: lls, weights: optimal}
    - {name: NLS15U, residual: nls, weights: user}
    - {name: NLS15O, residual: nls, weights: optimal}
    - {name: LLS1U, residual: lls, weights: user, positions: best}
  result: LLS15U
compare_with: wernholt_moberg_2008
truth: plant.yaml
"""
FIT = re.search(r"^fit: .*\n", STUDY, re.M)[0]
COMPARE = re.search(r"^compare: .*\n", STUDY, re.M)[0]
PUBLISHED = (
    STUDY.replace(FIT, FITS)
    .replace(COMPARE, "compare: {runs: 0}\nprofiles: 0\n")
    .replace("steps: 400", "steps: 100")
)


DRAWN = ("3", "7b", "8", "9")
"""Figures that are drawn, one of each kind; the page has places for all."""


def only_warnings(err: str) -> bool:
    """Return whether errors are warnings of weak plans, which reduced studies have."""
    return all(line.startswith("warning: ") for line in err.splitlines())


@pytest.fixture(scope="module")
def published(tmp_path_factory):
    """Folder of the study."""
    folder = tmp_path_factory.mktemp("published")
    path = write_study(folder, PUBLISHED, MODEL)
    (folder / "plant.yaml").write_text(PLANT, encoding="utf-8")
    with drawn(f"figure-({'|'.join(DRAWN)})"):
        code, _, err = oed("run", path, "--workers", 1)
    assert code == 0
    assert only_warnings(err)
    return folder


def test_costs_are_those_of_plain_numpy(published):
    output = published / "results" / "here"
    found = json.loads((output / "published.json").read_text())["estimators"]
    robot = robotmodels.load_robot(published / "robot.yaml")
    data = read_dataclass(output / "stages" / "data" / "result.h5", Data).estimate
    snr = np.abs(data.response) / np.sqrt(data.variance)
    user = np.where(np.eye(2, dtype=bool), 1.0, 0.1) * (snr >= np.sqrt(10))
    optimal = np.where(snr >= np.sqrt(10), snr**2, 0.0)
    costs = {}
    for name in ESTIMATORS:
        runs = estimators.read_fits(output / "stages" / f"fit-{name}" / "runs.h5", robot, data)
        assert len(runs) == 2
        pairs = []
        for run in runs:
            values = run.parameters.values
            G = robotmodels.frequency_response(robot, data.positions, data.omega, values)
            error = np.abs(np.log(data.response / G)) ** 2
            pairs.append([(user * error).sum(), (optimal * error).sum()])
        costs[name] = np.array(sorted(pairs))
    reference, least = costs["LLS15U"][0, 0], costs["LLS15O"][:, 1].min()
    for name in ESTIMATORS:
        np.testing.assert_allclose(found[name]["cost"], costs[name][:, 0] / reference, rtol=1e-6)
        np.testing.assert_allclose(found[name]["optimal_cost"], costs[name][:, 1] / least, 1e-6)
        share = np.mean(costs[name][:, 0] / reference < 1.5)
        assert found[name]["reasonable"]["cost"] == pytest.approx(share)
        assert sorted(found[name]["start"]) == list(range(2))


def test_the_result_is_the_estimator_that_the_study_names(published):
    output = published / "results" / "here"
    fit = json.loads((output / "fit.json").read_text())
    best = fit["estimators"]["LLS15U"]
    assert [row["estimate"] for row in fit["parameters"]] == best["estimate"]
    assert (best["residual"], best["weights"], fit["cost"]) == ("lls", "user", best["cost"])
    truth = {row["name"]: row["truth"] for row in fit["parameters"]}
    assert truth["d2.stiffness"] is None  # it hardens: no single number
    assert truth["d3.stiffness"] == 2.5e4
    assert fit["estimators"]["LLS1U"]["positions"] == 1


def test_the_page_judges_seven_conclusions_and_shows_every_figure(published):
    output = published / "results" / "here"
    page = (output / "published.html").read_text(encoding="utf-8")
    judged = json.loads((output / "published.json").read_text())["conclusions"]
    assert [one["conclusion"] for one in judged] == list(CONCLUSIONS)
    for one in judged:
        assert one["verdict"] in ("supported", "not supported", "undecided")
        assert one["conclusion"][1:] in page
        assert f"<strong>{one['verdict']}</strong>" in page
    for number in ("3", "4", "5", "6", "7a", "7b", "8", "9"):
        picture = page.partition(f'id="figure-{number}"')[2].partition("</figure>")[0]
        assert ("<path" in picture) == (number in DRAWN)
    text = re.sub(r"<(script|style|svg).*?</\1>", "", page, flags=re.S)
    assert not re.search(r"\bnan\b", text)
    assert "http" not in text
    assert "report.html" in {p.name for p in output.iterdir()}


def test_the_banner_counts_the_conclusions_and_axe_finds_no_violation(published):
    output = published / "results" / "here"
    judged = json.loads((output / "published.json").read_text())["conclusions"]
    page = (output / "published.html").read_text(encoding="utf-8")
    banner = page.partition('<div class="banner')[2].partition("</div>")[0]
    supported = [i for i, one in enumerate(judged, 1) if one["verdict"] == "supported"]
    assert f"{len(supported)} of 7 conclusions supported" in banner
    assert (f"supported: {ranges(supported)}" in banner.lower()) == bool(supported)
    assert ("more starts" in banner) == any(one["verdict"] == "undecided" for one in judged)
    assert violations_of(output / "published.html") == []


def test_the_study_is_put_beside_the_paper_again_without_computing(published):
    output = published / "results" / "here"
    before = json.loads((output / "published.json").read_text())
    (output / "published.json").unlink()
    code, _, err = oed("replicate", published / "study.yaml", "--workers", 1)
    assert code == 0
    assert only_warnings(err)
    assert json.loads((output / "published.json").read_text()) == before


EXPERIMENT = """\
data:
  experiment:
    multisine: {band: [3.0, 40.0], sample_time: 0.004, period: 0.5, odd: false, slope: -1.0}
    blocks: 3
    periods: 1
    limits: {torque: 60.0, speed: 10.0}
    imperfections: {friction: 0.0, angle_noise: 1.0e-6}
  method: log
as_published: true
local_minima: {positions: 2, amplitudes: [0.5, 1.0], blocks: [2, 3], starts: 2}
"""


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """Study file that is repeated as published too."""
    folder = tmp_path_factory.mktemp("both")
    study = PUBLISHED.replace("posterior", f"{EXPERIMENT}posterior")
    path = write_study(folder, study.replace("experiments: 5", "experiments: 3, most: 1"), MODEL)
    (folder / "plant.yaml").write_text(PLANT, encoding="utf-8")
    with drawn():
        code, _, err = oed("replicate", path, "--workers", 1)
    assert code == 0
    assert only_warnings(err)
    return path


@pytest.mark.slow
def test_as_published_is_an_ordinary_study_of_other_settings(both):
    """The stages of both, and a study that says in its file what the paper did."""
    study = load_study(both)
    other = published_settings(study)
    assert other.data.experiment.multisine.slope == 0.0
    assert (other.data.method, other.fit.minimiser, other.fit.minimum_snr) == (
        "ari",
        "quasi_newton",
        0.0,
    )
    stages = study.output / "as_published" / "stages"
    robot = robotmodels.load_robot(both.parent / "robot.yaml")
    data = read_dataclass(stages / "data" / "result.h5", Data).estimate
    records = list(robotmodels.iterate_records(stages / "experiment" / "records.h5"))
    again = estimators.estimate_frf(records, "ari", structure="diagonal")
    again = again.without_images(robot, records[0])
    np.testing.assert_allclose(data.response, again.response, rtol=1e-12)
    own = read_dataclass(study.output / "stages" / "data" / "result.h5", Data).estimate
    assert not np.allclose(own.response, data.response, rtol=1e-6)
    weights = {
        "LLS15O": np.abs(data.response) ** 2 / data.variance,
        "NLS15O": 1 / data.variance,
        "LLS15U": np.broadcast_to(np.where(np.eye(2, dtype=bool), 1.0, 0.1), data.response.shape),
    }
    for name, expected in weights.items():
        fits = estimators.read_fits(stages / f"fit-{name}" / "runs.h5", robot, data)
        usual = estimators.read_fits(
            study.output / "stages" / f"fit-{name}" / "runs.h5", robot, own
        )
        assert {tuple(run.start) for run in fits} == {tuple(run.start) for run in usual}
        assert all("maximum number" in run.message or run.converged for run in fits)
        np.testing.assert_allclose(fits[0].weights, expected, rtol=1e-9)


@pytest.mark.slow
def test_the_page_has_both_beside_the_paper(both):
    output = load_study(both).output
    page = (output / "published.html").read_text(encoding="utf-8")
    found = json.loads((output / "published.json").read_text())
    assert set(found["as_published"]["estimators"]) == set(ESTIMATORS)
    assert len(found["as_published"]["conclusions"]) == 7
    table = page.partition('id="reasonable"')[2].partition("</table>")[0]
    assert table.count("as published") == 1
    for name in ESTIMATORS:
        shares = found["estimators"][name], found["as_published"]["estimators"][name]
        for criterion in ("cost", "springs", "all_springs"):
            parts = [f"{100 * one['reasonable'][criterion]:.0f}" for one in shares]
            assert parts in [re.findall(r">(\d+)<", row)[:2] for row in table.split("<tr")]
    assert 'id="figure-3-published"' in page
    assert "power \N{MINUS SIGN}1" in page


@pytest.mark.slow
def test_less_excitation_is_measured_and_fitted(both):
    output = load_study(both).output
    minima = json.loads((output / "published.json").read_text())["minima"]
    rows = minima["excitations"]
    assert (minima["positions"], minima["starts"]) == (2, 2)
    assert [(one["amplitude"], one["blocks"]) for one in rows] == [
        (1.0, 2), (1.0, 3), (0.5, 2), (0.5, 3),
    ]  # fmt: skip
    records = list(robotmodels.iterate_records(output / "stages" / "experiment" / "records.h5"))
    for one in rows[:2]:
        estimate = estimators.estimate_frf(
            [first_blocks(part, one["blocks"]) for part in records[:2]], "log", structure="diagonal"
        )
        relative = np.sqrt(estimate.variance) / np.abs(estimate.response)
        assert one["deviation"] == pytest.approx(np.median(relative))
        assert one["seconds"] == 2 * one["blocks"] * 2 * 0.5  # positions, motors, period
    for full, half in zip(rows[:2], rows[2:], strict=True):
        assert half["deviation"] != pytest.approx(full["deviation"], rel=1e-6)  # measured anew
        assert all(0.5 <= search["reached"] <= 1 for search in full["searches"])
    page = (output / "published.html").read_text(encoding="utf-8")
    assert page.partition('id="minima-table"')[2].partition("</table>")[0].count("<tr") == 5


MISTAKES = {
    "five estimators": (
        "run",
        PUBLISHED.replace(
            "    - {name: LLS1U, residual: lls, weights: user, positions: best}\n", ""
        ),
        ("study.yaml: compare_with", "LLS1U missing in fit.estimators"),
    ),
    "a name twice": (
        "run",
        PUBLISHED.replace("name: LLS15O", "name: LLS15U"),
        ("fit: estimators: the name 'LLS15U' is used twice",),
    ),
    "nothing published": ("replicate", STUDY, ("study.yaml: compare_with: missing",)),
    "no experiment": (
        "replicate",
        PUBLISHED + "as_published: true\n",
        ("as_published: it repeats the experiment",),
    ),
    "no comparison": (
        "run",
        STUDY + "as_published: true\n",
        ("as_published: it belongs to a study with compare_with",),
    ),
    "too many blocks": (
        "replicate",
        PUBLISHED.replace(
            "posterior", EXPERIMENT.replace("blocks: [2, 3]", "blocks: [2, 4]") + "posterior"
        ),
        ("local_minima: blocks: 4; the experiment has 3",),
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_studies_that_cannot_be_compared_are_refused(tmp_path, mistake):
    command, study, said = MISTAKES[mistake]
    code, _, err = oed(command, write_study(tmp_path, study, MODEL))
    assert code == 2
    for words in said:
        assert words in err
