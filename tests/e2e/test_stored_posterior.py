"""Predictions, margins and draws of a study rest on the posterior that it has stored."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import oed

import robotmodels
from estimators import Posterior, ToolCompliance, predict
from oed.study.pipeline import run_study
from oed.study.settings.study_file import load_study
from robotmodels import Frame, compliance_ellipsoid, tool_model
from robotmodels.common.dataclass_files import read_dataclass


def answered(*words: object) -> dict:
    code, out, err = oed(*words, "--workers", 1, "--json")
    assert code == 0, err
    return json.loads(out)


@pytest.fixture
def study(small_study) -> Path:
    return small_study[0].parents[1] / "study.yaml"


def stored_draws(results: Path) -> np.ndarray:
    return read_dataclass(results / "stages/posterior/result.h5", Posterior).draws


def softest_of_draws(robot, positions, frame, draws) -> list[np.ndarray]:
    return [
        compliance_ellipsoid(tool_model(robot, positions, frame, theta).compliance()).values[:, 0]
        for theta in np.exp(draws)
    ]


def test_the_report_draws_from_it(study: Path, small_study) -> None:
    results = run_study(load_study(study))
    prediction, draws = results.tool, stored_draws(small_study[0])[::20]
    positions = prediction.compliance.positions
    softest = softest_of_draws(results.robot, positions, prediction.frame, draws)
    expected = np.log(softest).std(axis=0)
    np.testing.assert_allclose(prediction.compliance.std[:, 0], expected, rtol=0.25)
    bands = predict(results.fits.result, ToolCompliance(prediction.frame), positions)
    assert (bands.std != prediction.compliance.std)[:, :2].all()
    page = (small_study[0] / "report.html").read_text()
    assert "Bands rest on draws of the study" in page


def test_bands_are_those_of_its_draws(study: Path, small_study, tmp_path: Path) -> None:
    content = answered("predict", study, "-o", tmp_path, "--draws", 400)
    assert content["spread"] == "draws of the study's posterior"
    robot = robotmodels.load_robot(study.parent / "robot.yaml")
    frame, positions = Frame(content["frame"]["link"]), np.array(content["positions"])
    softest = softest_of_draws(robot, positions, frame, stored_draws(small_study[0])[::20])
    ends = np.quantile(softest, [0.025, 0.975], axis=0)
    lower, upper = (np.array(content["compliance"][name])[:, 0] for name in ("lower", "upper"))
    np.testing.assert_allclose(upper - lower, ends[1] - ends[0], rtol=0.25)
    np.testing.assert_allclose(lower, ends[0], rtol=0.02)
    margins = answered("margins", study, "-o", tmp_path, "--draws", 5)
    assert (margins["spread"], margins["draws"]) == ("draws of the study's posterior", 5)


def test_exported_robots_are_draws_of_it(study: Path, small_study, tmp_path: Path) -> None:
    target = tmp_path / "a.yaml"
    content = answered("export", study, "--to", "robot", "--draws", 3, "-o", target)
    assert content["spread"] == "posterior"
    code, _, err = oed("export", study, "--to", "robot", "--draws", 9999, "-o", target)
    assert code == 2
    assert "--draws: 9999; the posterior has" in err
    draws = stored_draws(small_study[0])
    for name in content["files"][1:-1]:
        theta = np.log(robotmodels.load_robot(name).parameters.values)
        assert np.abs(draws - theta).max(axis=1).min() < 1e-9
