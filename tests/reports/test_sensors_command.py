"""``oed sensors``."""

import json
from pathlib import Path

import pytest
import yaml
from command_line import oed

import robotmodels
from robotmodels.description.robot_file import read_robot_file


@pytest.fixture
def study(tmp_path: Path) -> Path:
    path = Path(robotmodels.__file__).parent / "library" / "manutec_r3.yaml"
    robot = read_robot_file(path).model_dump(by_alias=True, exclude_unset=True, mode="json")
    robot["urdf"] = str(path.parent / robot["urdf"])
    robot["outputs"] = [
        *({"motor": motor["name"], "quantity": "acceleration"} for motor in robot["motors"]),
        {"name": "twin", "motor": "m1", "quantity": "torque"},
        {"name": "elbow", "joint": "joint3", "quantity": "angle"},
        {"name": "shoulder", "spring": "g2", "quantity": "torque"},
    ]
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot))
    content = {
        "schema": "study/1",
        "robot": "robot.yaml",
        "frequencies": {"low": 2.0, "high": 60.0, "count": 8},
        "noise": {"relative": 0.03, "floor": 0.01},
        "candidates": {"per_joint": {"joint2": 3, "joint3": 3}},
        "design": {"experiments": 2},
        "output": "out",
    }
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(content))
    return tmp_path / "study.yaml"


def test_what_informs_is_bought_within_the_budget(study) -> None:
    prices = ("--price", "shoulder=5", "--price=elbow=5", "--price=twin=0.5")
    code, out, err = oed("sensors", str(study), "--budget=10", "--json", *prices)
    assert (code, err) == (0, "")
    content = json.loads(out)
    assert content["sensors"] == ["elbow", "shoulder"]
    assert content["cost"] == 10
    # The current of a motor of a known torque tells nothing of springs.
    assert content["relative_efficiency"]["twin"] == pytest.approx(1.0)
    assert content["relative_efficiency"]["elbow"] < 0.95
    _, out, _ = oed("sensors", str(study), "--budget=9", *prices)
    assert "for 5.5" in out


def test_wrong_prices(study) -> None:
    for words, message in (
        (("--price=elbow",), "--price elbow: NAME=PRICE is needed, such as tip=900"),
        (("--price=elbow=-1",), "--price elbow=-1: NAME=PRICE"),
        (
            ("--price=elbw=1",),
            "is no output of the robot beside motors' encoders (did you mean 'elbow'",
        ),
    ):
        code, _, err = oed("sensors", str(study), "--budget=1", *words)
        assert code == 2
        assert message in err
