"""``oed structure``: springs that a study's data ask for."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from command_line import oed

from estimators import simulate_frf, write_frf
from robotmodels import RelativeNoise, load_robot, possible_springs, save_robot, with_springs

ROBOT = load_robot("moberg_axis1")


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """A simulated study whose plant has a spring that the model has not."""
    spring = next(s for s in possible_springs(ROBOT) if s.name == "arm1 67 % z")
    hidden = spring.model_copy(update={"stiffness": 1e6, "damping": 1000.0})
    save_robot(with_springs(ROBOT, [hidden], free=True), tmp_path / "truth.yaml")
    save_robot(ROBOT, tmp_path / "robot.yaml")
    content = {
        "schema": "study/1",
        "robot": "robot.yaml",
        "truth": "truth.yaml",
        "frequencies": {"low": 3.0, "high": 60.0, "count": 20},
        "noise": {"relative": 0.01, "floor": 0.003},
        "candidates": {"sobol": 4},
        "design": {"experiments": 2, "distinguish": [hidden.model_dump(mode="json")]},
        "fit": {"starts": 1, "decades": 0.0, "residuals": ["nls"]},
        "output": "out",
    }
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(content))
    return tmp_path / "study.yaml"


@pytest.mark.slow
def test_the_hidden_spring_is_named_and_the_robot_written(study) -> None:
    code, out, err = oed("structure", str(study), "--json", "--most", "2")
    assert code == 0, err
    content = json.loads(out)
    names = {spring["name"]: spring for spring in content["springs"]}
    assert any("arm1 67 % z" in (name, *one["twins"]) for name, one in names.items())
    assert all(step["fall"] > 0 for step in content["steps"])
    assert content["bic"][1] < content["bic"][0]
    assert content["held_out"] is None
    assert [power["name"] for power in content["powers"]] == ["arm1 67 % z"]
    assert 0.9 < content["powers"][0]["detection"] <= 1
    assert json.loads((study.parent / "out" / "structure.json").read_text())["files"] == []
    robot = load_robot(study.parent / "out" / "structure.yaml")
    assert {spring.name for spring in robot.file.springs} >= set(names)


def without_distinguish(study: Path) -> None:
    content = yaml.safe_load(study.read_text())
    del content["design"]["distinguish"]
    study.write_text(yaml.safe_dump(content))


def test_score_tests_without_a_choice(study) -> None:
    without_distinguish(study)
    code, out, err = oed("structure", str(study), "--most", "0")
    assert code == 0, err
    assert "0 springs added: no more than 0 were requested" in out
    assert "arm1 67 % z" in out
    assert out.startswith("structure  0 springs added, but the robot file is in doubt\n")
    assert "\nnext     " in out
    scores = json.loads((study.parent / "out" / "structure.json").read_text())["scores"]
    for one in scores[:12]:
        (line,) = (line for line in out.splitlines() if line.startswith(f" {one['name']} "))
        size = float(line.split(one["name"])[1].split()[1])
        if one["spring"]:
            assert line.endswith(one["unit"])  # a compliance
            assert 0 <= size <= max(one["interval"][1], 0) * 1.01
    page = (study.parent / "out" / "structure.html").read_text()
    assert "The robot. Marked, in position " in page
    assert "Springs in one row" not in page
    assert load_robot(study.parent / "out" / "structure.yaml").parameters.names == (
        ROBOT.parameters.names
    )


def test_a_wrong_number_of_the_robot_file_puts_springs_in_doubt(study) -> None:
    late = ROBOT.file.model_copy(update={"delay": 2e-3})
    save_robot(replace(ROBOT, file=late), study.parent / "truth.yaml")
    without_distinguish(study)
    code, out, err = oed("structure", str(study), "--most", "0")
    assert code == 0, err
    assert "the data contradict delay" in " ".join(out.split())
    document = json.loads((study.parent / "out" / "structure.json").read_text())
    assert document["contradicted"][0] == "delay"
    page = (study.parent / "out" / "structure.html").read_text()
    assert "No spring is missing" not in page
    assert "The data contradict delay" in page


def test_predictions_of_a_fit_that_lacks_a_spring_say_so(study) -> None:
    without_distinguish(study)
    for words in (["predict"], ["margins", "--draws", "2"]):
        _, out, err = oed(words[0], study, *words[1:])
        assert out.startswith("Model error: do not quote these numbers; "), err
    for name in ("prediction", "margins"):
        written = json.loads((study.parent / "out" / f"{name}.json").read_text())
        assert written["verdict"] == "model error"


def test_a_level_that_is_none_is_refused(study) -> None:
    code, out, err = oed("structure", str(study), "--level", "0")
    assert (code, out) == (2, "")
    assert "level 0" in err


@pytest.mark.slow
def test_wrong_steps_are_exchanged_and_dropped_and_positions_held_out_say_so(tmp_path) -> None:
    robot = load_robot("manutec_r3")
    spring = next(spring for spring in possible_springs(robot) if spring.name == "joint2 z")
    spring = spring.model_copy(update={"stiffness": 2e6, "damping": 2e3})
    low, high = np.clip(robot.position_limits, -1.5, 1.5).T
    positions = np.random.default_rng(7).uniform(low, high, (4, 6))
    omega, noise = 2 * np.pi * np.linspace(4, 60, 14), RelativeNoise(0.03, 0.01)
    truth = with_springs(robot, [spring], free=True)
    data = simulate_frf(truth, positions, omega, noise, np.random.default_rng(1))
    write_frf(tmp_path / "frf.h5", data)
    content = {
        "schema": "study/1",
        "robot": "manutec_r3",
        "data": {"frf": "frf.h5"},
        "fit": {"starts": 1, "decades": 0.0, "residuals": ["nls"]},
        "validation": {"positions": [3]},
        "output": "out",
    }
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(content))
    code, out, err = oed("structure", str(tmp_path / "study.yaml"), "--json")
    assert code == 0, err
    document = json.loads(out)
    assert [one["name"] for one in document["springs"]] == ["joint2 z"]
    assert len(document["held_out"]) == len(document["steps"]) + 1
    assert document["held_out"][0] > 1.2
    assert document["held_out"][-1] == pytest.approx(1, abs=0.1)
