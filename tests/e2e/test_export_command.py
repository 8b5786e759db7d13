"""`oed export`: of a study's fit, of a robot file, of a built-in robot; mistakes in one line."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from command_line import oed
from conftest import ROBOT, STUDY, write_study
from scipy.io import loadmat

import robotmodels

SMALL = STUDY.replace("compare: {random: 1, runs: 12}\n", "").replace(
    "posterior: {ensembles: 2, walkers: 16, steps: 400}\n", ""
)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = write_study(tmp_path_factory.mktemp("export"), SMALL)
    code, _, err = oed("fit", path, "--workers", "1")
    assert code == 0, err
    return path


def exported(*words: object) -> dict[str, object]:
    code, out, err = oed("export", *words, "--workers", "1", "--json")
    assert code == 0, err
    return json.loads(out)


def test_a_study_is_exported_at_the_positions_of_its_plan(study: Path) -> None:
    results = study.parent / "results" / "here"
    design = json.loads((results / "design.json").read_text())
    fit = json.loads((results / "fit.json").read_text())
    intervals = {i["name"]: i for i in fit["trust"]["intervals"]}
    robot_file = Path(exported(study, "--to", "robot")["files"][0])
    assert robot_file.parent == results
    robot = robotmodels.load_robot(robot_file)
    assert robot.file.fitted.verdict == fit["trust"]["verdict"]
    for name, value in zip(robot.parameters.names, robot.parameters.values, strict=True):
        assert value == intervals[name]["value"]
        std = robot.file.fitted.relative_std[name]
        assert std == pytest.approx(intervals[name]["std"] / value, rel=1e-12)
    count = len(design["positions"])
    file = loadmat(exported(study, "--to", "state-space")["files"][0])
    assert file["positions"].shape == (count, 2)
    covariance = file["covariance_of_ln_parameters"]
    assert np.linalg.eigvalsh(covariance).min() > 0
    model = mujoco.MjModel.from_xml_path(exported(study, "--to", "mjcf")["files"][0])
    assert model.nkey == count


def test_the_robot_file_of_a_study_is_start_and_prior_of_the_next(study: Path) -> None:
    robot_file = study.parent / "fitted.yaml"
    exported(study, "--to", "robot", "-o", robot_file)
    text = SMALL.replace("robot: robot.yaml", "robot: fitted.yaml")
    text = text.replace("output: results/here", "output: results/next")
    first = json.loads((study.parent / "results/here/fit.json").read_text())
    stds = []
    for prior in ("none", "robot"):
        path = study.parent / f"next_{prior}.yaml"
        path.write_text(text.replace("starts: 2}", f"starts: 2, prior: {prior}}}"))
        code, _, err = oed("fit", path, "--workers", "1")
        assert code == 0, err
        fit = json.loads((study.parent / "results/next/fit.json").read_text())
        stds.append([i["std"] / i["value"] for i in fit["trust"]["intervals"]])
    before = np.array([i["std"] / i["value"] for i in first["trust"]["intervals"]])
    assert (np.array(stds[1]) < np.minimum(stds[0], before)).all()
    path.write_text(path.read_text().replace("fitted.yaml", "robot.yaml"))
    code, _, err = oed("fit", path, "--workers", "1")
    assert code == 2
    assert "neither in fitted.relative_std" in err


def test_draws_are_exported_as_uncertain_as_the_fit(study: Path, tmp_path: Path) -> None:
    words = "--to", "robot", "--draws", "16", "-o"
    first = exported(study, *words, tmp_path / "a.yaml")["files"]
    again = exported(study, *words, tmp_path / "b.yaml")["files"]
    assert [Path(name).name for name in first[:2]] == ["a.yaml", "a-01.yaml"]
    table = np.loadtxt(first.pop(), delimiter=",", skiprows=1)[:, 1:]
    assert Path(again.pop()).name == "b-draws.csv"
    robots = [robotmodels.load_robot(name) for name in first]
    np.testing.assert_allclose(table, [robot.parameters.values for robot in robots[1:]], rtol=1e-9)
    values = np.log([robot.parameters.values for robot in robots])
    repeated = np.log([robotmodels.load_robot(name).parameters.values for name in again])
    np.testing.assert_array_equal(values, repeated)
    std = np.array(list(robots[0].file.fitted.relative_std.values()))
    ratio = values[1:].std(axis=0, ddof=1) / std  # the file's are the recommended ones
    assert (ratio > 0.3).all()
    assert (ratio < 2.2).all()
    correlation = robots[0].file.fitted.correlation
    assert [len(row) for row in correlation] == list(range(len(std)))
    bent = exported(
        study, "--to", "mjcf", "--draws", "2", "--position=10,20", "-o", tmp_path / "c.xml"
    )
    assert [Path(name).name for name in bent["files"]] == [
        "c.xml", "c-1.xml", "c-2.xml", "c-draws.csv",
    ]  # fmt: skip
    alone = exported(study, *words, tmp_path / "d.yaml", "--table-only", "--seed", "5")["files"]
    assert [Path(name).name for name in alone] == ["d.yaml", "d-draws.csv"]
    assert not (np.loadtxt(alone[1], delimiter=",", skiprows=1)[:, 1:] == table).any()
    (tmp_path / "robot.yaml").write_text(ROBOT)
    target = tmp_path / "x.xml"
    code, _, err = oed(
        "export", tmp_path / "robot.yaml", "--to", "mjcf", "--draws", "2", "-o", target
    )
    assert code == 2
    assert not target.exists()
    assert "--draws: prior: robot file" in err
    assert "no standard deviation of a free parameter" in err


def test_robots_are_exported_at_positions_in_degrees(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text(ROBOT)
    target = tmp_path / "deep" / "x.json"
    words = ("--position=-90,20", "--position=-80,10", "-o", target)
    exported(tmp_path / "robot.yaml", "--to", "modes", *words)
    content = json.loads(target.read_text())
    positions = [there["position"] for there in content["positions"]]
    np.testing.assert_allclose(positions, np.radians([[-90, 20], [-80, 10]]))
    code, out, _ = oed("export", "manutec_r3", "--to", "urdf", "-o", tmp_path / "r3.urdf")
    assert code == 0
    assert "left out stiffness and damping of spring" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("ur10", "--to", "mujoco"), "--to: 'mujoco' is unknown"),
        (("ur11", "--to", "mjcf"), "robot 'ur11' is neither a built-in robot"),
        (("manutec_r3", "--to", "modes", "--position=1,2"), "--position: 2 given, 6 needed"),
        (("manutec_r3", "--to", "robot", "-o", "x.txt"), "a robot file ends in .yaml"),
        (("manutec_r3", "--to", "mjcf", "--table-only"), "--table-only: there is no table"),
    ],
)
def test_mistakes(words: tuple[str, ...], message: str) -> None:
    code, _, err = oed("export", *words)
    assert code == 2
    assert err.count("\n") == 1
    assert message in err
