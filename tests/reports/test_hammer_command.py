"""``oed hammer``: hits together with what motor-side data have told, and alone."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from command_line import oed
from robots import HERE, built

from estimators import covariance, fit, simulate_frf, write_frf
from robotmodels import Frame, HammerTest, RelativeNoise, load_robot, save_robot

SENSORS = [
    {"name": f"tip {axis}", "link": "tool0", "at": [0.0, 0.0, 0.1], "direction": direction}
    for axis, direction in (("x", [1.0, 0.0, 0.0]), ("z", [0.0, 0.0, 1.0]))
]
CONTENT = yaml.safe_load((HERE / "two_joints.yaml").read_text()) | {"accelerometers": SENSORS}
ROBOT = built(CONTENT)
POSITIONS = np.array([[-0.8, 0.4], [-1.2, 0.9], [-0.4, -0.8]])
OMEGA = 2 * np.pi * np.geomspace(4.0, 50.0, 15)
OPTIONS = ("--link=tool0", "--at=0,0,0.1", "--direction=1,0,0", "--direction=0,0,1")


@pytest.fixture
def before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> np.ndarray:
    """Covariance of a fit to motor-side data, in a robot file beside hits."""
    rng = np.random.default_rng(5)
    data = simulate_frf(ROBOT, POSITIONS[:1], OMEGA, RelativeNoise(0.1, 0.05), rng)
    first = fit(ROBOT, data, residual="nls", weights="optimal")
    known = covariance(first).covariance
    save_robot(first.robot(covariance=known), tmp_path / "robot.yaml")
    tip = Frame("tool0", (0.0, 0.0, 0.1), "link")
    test = HammerTest(ROBOT, tip, np.eye(3)[[0, 2]])
    hits = simulate_frf(test, POSITIONS, OMEGA, RelativeNoise(0.05, 1e-4), rng)
    write_frf(tmp_path / "hits.h5", hits)
    monkeypatch.chdir(tmp_path)
    return known


def test_informations_of_both_add_up(before) -> None:
    stds = []
    for words in ((), ("--alone",)):
        code, out, err = oed("hammer", "robot.yaml", "hits.h5", *OPTIONS, *words)
        assert (code, err) == (0, "")
        assert ("3 positions, alone" in out) == bool(words)
        robot = load_robot("two joints_identified.yaml")
        stds.append([robot.file.fitted.relative_std[name] for name in robot.parameters.names])
        z = np.log(robot.parameters.values / ROBOT.parameters.values) / stds[-1]
        assert np.abs(z).max() < 4
    together, alone = np.array(stds)
    expected = (1 / np.diag(before) + 1 / alone**2) ** -0.5  # of uncorrelated estimates
    assert (together < 1.2 * np.minimum(alone, np.sqrt(np.diag(before)))).all()
    assert (together > 0.5 * expected).all()


MISTAKES = {
    ("--direction=0,1",): "--direction: '0,1'; three numbers",
    ("--direction=0,0,0",): "directions [[0.0, 0.0, 0.0]]; three finite numbers each, not all zero",
    ("--direction=0,0,1",): "FRFs of 2 sensors by 2 forces",
    ("--direction=0,0,1", "--link=toool"): "error: hammer test: frame: 'toool' is not a link",
    ("--direction=0,0,1", "--motors=braked"): "--motors: 'braked'",
}


@pytest.mark.parametrize("words", MISTAKES)
def test_mistakes_are_one_line(words, before) -> None:
    if "--link=toool" in words:
        words = (*words, "--direction=1,0,0")
    code, _, err = oed("hammer", "robot.yaml", "hits.h5", *words)
    assert code == 2
    assert MISTAKES.get(words, "error: hammer test: frame: 'toool' is not a link") in err
    assert err.count("\n") == 1


def test_the_document_has_the_intervals(before) -> None:
    code, out, _ = oed("hammer", "robot.yaml", "hits.h5", *OPTIONS, "--json")
    assert code == 0
    document = json.loads(out)
    assert document["schema"] == "hammer/1"
    assert document["prior"] == list(ROBOT.parameters.names)
    assert [one["name"] for one in document["intervals"]] == list(ROBOT.parameters.names)
