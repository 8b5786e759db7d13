"""FRFs of files that do not say how well their noise is known."""

import json
import re

import numpy as np
import pytest
from command_line import oed
from conftest import drawn, write_study

import estimators
import robotmodels

STUDY = """\
schema: study/1
robot: robot.yaml
data: {frf: FILE}
fit: {residuals: [nls], decades: 0.1, starts: 1}
posterior: {ensembles: 2, walkers: 16, steps: 100}
profiles: 0
output: results/here
"""


@pytest.mark.parametrize("ending", ["h5", "csv", "uff"])
@pytest.mark.parametrize("known", [True, False], ids=["stated", "unknown"])
def test_unknown_noise_is_never_trustworthy(tmp_path, ending, known):
    path = write_study(tmp_path, STUDY.replace("FILE", f"frf.{ending}"))
    robot = robotmodels.load_robot(tmp_path / "robot.yaml")
    positions = np.array([[-1.6, 1.0], [-0.8, -1.2]])
    omega = 2 * np.pi * np.geomspace(3, 60, 12)
    noise = robotmodels.RelativeNoise(relative=0.03, floor=0.01)
    data = estimators.simulate_frf(robot, positions, omega, noise, np.random.default_rng(5))
    if not known:  # as files before degrees of freedom were stated
        data = estimators.FrfEstimate(
            *(getattr(data, k) for k in ("positions", "omega", "response", "covariance")),
            data.repetitions,
            np.nan,
        )
    estimators.write_frf(tmp_path / f"frf.{ending}", data)
    with drawn():
        code, out, err = oed("run" if ending == "h5" else "fit", path, "--workers", 1)
    assert (code, err) == (0, "")
    trust = json.loads((tmp_path / "results" / "here" / "fit.json").read_text())["trust"]
    if known:
        assert trust["verdict"] == "trustworthy"
        return
    assert trust["verdict"] == "too few blocks"
    assert "not known" in trust["reason"]
    assert "verdict  too few blocks: the degrees of freedom" in out
    if ending == "h5":
        page = (tmp_path / "results" / "here" / "report.html").read_text(encoding="utf-8")
        assert re.search(
            r'<p class="verdict">Too few blocks: .* may be quoted with reservations</p>', page
        )
        assert "unknown" in page[page.index('id="estimates"') :]
