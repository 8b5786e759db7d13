"""Studies on simulated experiments and on measured records, from the command line to the page."""

import json
import re
import shutil

import numpy as np
import pytest
from command_line import oed
from conftest import STUDY, drawn, write_study

import estimators

EXPERIMENT = """\
data:
  experiment:
    multisine: {band: [3.0, 40.0], sample_time: 0.004, period: 0.5, odd: false}
    blocks: 4
    periods: 2
    transient_periods: 2
    limits: {torque: 60.0, speed: 10.0}
    imperfections: {friction: 0.0, angle_noise: 1.0e-6}
"""
FITS = "fit: {residuals: [nls], decades: 0.1, starts: 1}\n"
SHORT = re.sub(r"^fit: .*\n", FITS, STUDY, flags=re.M).replace("steps: 400", "steps: 200")
SHORT = re.sub(r"^compare: .*\n", "", SHORT, flags=re.M)
SIMULATED = SHORT.replace("posterior", f"{EXPERIMENT}validation: {{count: 1}}\nposterior")
SIMULATED = SIMULATED.replace("experiments: 5", "experiments: 5, most: 1")
MEASURED = """\
schema: study/1
robot: robot.yaml
data: {records: records.h5}
fit: {residuals: [nls], decades: 0.1, starts: 1}
posterior: {ensembles: 2, walkers: 16, steps: 200}
profiles: 1
validation: {positions: [1, 3]}
output: results/here
"""
TRUTH = np.array([4.0e4, 2.5e4, 60.0, 37.5])


def ran(path, pictures="nothing"):
    """Return the results' folder and the page, with the pictures whose ids begin so."""
    with drawn(pictures):
        code, _, err = oed("run", path, "--workers", 1)
    assert (code, err) == (0, "")
    folder = path.parent / "results" / "here"
    return folder, (folder / "report.html").read_text(encoding="utf-8")


def fitted(folder):
    rows = json.loads((folder / "fit.json").read_text())["parameters"]
    return np.array([row["estimate"] for row in rows])


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    return ran(write_study(tmp_path_factory.mktemp("simulated"), SIMULATED), "calibration|frf-1")


def test_an_experiment_is_simulated_fitted_and_checked(simulated):
    folder, page = simulated
    np.testing.assert_allclose(fitted(folder), TRUTH, rtol=0.05)
    stages = {path.name for path in (folder / "stages").iterdir()}
    assert {"experiment", "validation", "profiles"} <= stages
    # Plans are compared by the noise law, which is not that of this experiment.
    assert "comparison" not in stages
    uncertainty = json.loads((folder / "uncertainty.json").read_text())
    trust = uncertainty["trust"]
    assert trust["verdict"] in estimators.VERDICTS
    # Four blocks: three degrees of freedom a line and position, more over all lines.
    assert all(6 <= one["dof"] < 1e4 for one in trust["intervals"])
    assert all("over blocks" in one["method"] for one in trust["intervals"])
    design = json.loads((folder / "design.json").read_text())["exact"]
    assert design["runs"] == design["experiments"] * 4 * 2
    ratio = np.divide(uncertainty["emcee"]["std"], uncertainty["theorem1"]["std"])
    assert (np.abs(np.log(ratio)) < 0.3).all()
    for section in ("experiment", "validation", "candidates"):
        assert f'id="{section}"' in page
    assert 'id="peaks"' in page


@pytest.fixture(scope="module")
def measured(simulated, tmp_path_factory):
    """Path of a study on the records of the other."""
    folder = tmp_path_factory.mktemp("measured")
    path = write_study(folder, MEASURED)
    shutil.copy(simulated[0] / "stages" / "experiment" / "records.h5", folder)
    return path


def test_records_are_fitted_but_for_what_is_held_out(measured):
    folder, page = ran(measured)
    design = json.loads((folder / "design.json").read_text())
    assert len(design["positions"]) == 3
    np.testing.assert_allclose(fitted(folder), TRUTH, rtol=0.08)
    assert "2 measured positions were not fitted" in " ".join(page.split())
    assert 'id="candidates"' not in page
    assert "no design was computed" in " ".join(page.split())
    # 5 positions, 4 blocks of 2 runs, 2 periods of 0.5 s are recorded.
    assert re.search(r"robot time</abbr></a></dt><dd>≥ 40\ss<", page)
    # Unchanged, nothing is computed again; other positions held out change what is fitted.
    code, out, _ = oed("fit", measured, "--workers", 1)
    assert code == 0
    assert "reused   data, split, information" in out
    share = measured.parent / "share.yaml"
    share.write_text(MEASURED.replace("positions: [1, 3]", "share: 0.2"), encoding="utf-8")
    code, out, _ = oed("fit", share, "--workers", 1)
    assert code == 0
    assert "4 positions" in out


MISTAKES = {
    "no such position": ("positions: [1, 3]", "positions: [5]", "no position 5; the data have 5"),
    "all": ("[1, 3]", "[0, 1, 2, 3, 4]", "all 5 positions of the data are held out"),
    "count": ("positions: [1, 3]", "count: 2", "validation: positions or share is needed"),
    "two": ("positions: [1, 3]", "positions: [1], share: 0.2", "positions and share given"),
    "none": ("{positions: [1, 3]}", "{}", "none of count, positions and share"),
    "design": (
        "profiles: 1",
        "design: {criterion: E}",
        "design.criterion: of no use with measured",
    ),
    "compare": ("profiles: 1", "compare: {random: 1}", "compare: of no use with measured data"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_what_cannot_be_held_out_is_said(mistake, measured):
    right, wrong, words = MISTAKES[mistake]
    path = measured.parent / "wrong.yaml"
    path.write_text(MEASURED.replace(right, wrong), encoding="utf-8")
    code, _, err = oed("run", path, "--workers", 1)
    assert code == 2
    assert words in err


def test_simulated_data_need_a_count(tmp_path):
    path = write_study(tmp_path, SIMULATED.replace("{count: 1}", "{share: 0.5}"))
    code, _, err = oed("run", path, "--workers", 1)
    assert code == 2
    assert "validation: count is needed for simulated data" in err
