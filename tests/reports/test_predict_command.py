"""``oed predict`` and ``oed margins``."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from command_line import oed
from robots import HERE

import robotmodels
from estimators import predict
from robotmodels import Frame

AT = "--position=-45,20"
GUESSED = {"d2.stiffness": 0.2, "d3.stiffness": 0.1, "d2.damping": 0.4, "d3.damping": 0.4}


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    content = yaml.safe_load((HERE / "two_joints.yaml").read_text()) | {"guessed": GUESSED}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(content))
    monkeypatch.chdir(tmp_path)
    return "robot.yaml"


def test_predictions_are_written_as_the_library_has_them(robot) -> None:
    words = ("--at=0,0,0.1", "--link=tool0", "--frequencies=2,40,5", "--json")
    code, out, err = oed("predict", robot, AT, *words)
    assert (code, err) == (0, "")
    content = json.loads(out)
    model, positions = robotmodels.load_robot(robot), np.deg2rad([[-45.0, 20.0]])
    frame = Frame("tool0", (0.0, 0.0, 0.1))
    from estimators import ToolCompliance, ToolResponse

    expected = predict(model, ToolCompliance(frame), positions)
    np.testing.assert_allclose(content["compliance"]["values"], expected.values)
    np.testing.assert_allclose(content["compliance"]["std"], expected.std)
    omega = 2 * np.pi * np.geomspace(2.0, 40.0, 5)
    response = predict(model, ToolResponse(omega, frame), positions)
    rows = list(csv.DictReader(Path("response.csv").read_text().splitlines()))
    assert len(rows) == 5 * 9
    assert float(rows[9]["real"]) == pytest.approx(response.values[0, 1, 0, 0].real, rel=1e-8)
    (row,) = csv.DictReader(Path("prediction.csv").read_text().splitlines())
    assert float(row["m2"]) == pytest.approx(np.deg2rad(-45))
    value = float(row["resonance_1 [rad/s]"])
    assert value == pytest.approx(content["resonances"]["values"][0][0], rel=1e-8)
    assert "Responses" in Path("prediction.html").read_text()


def test_maps_show_the_workspace(robot) -> None:
    code, out, _ = oed("predict", robot, "--map=8", "--modes=1", "-o", "map")
    assert code == 0
    assert "tool0 at 0, 0, 0 m" in out
    page = Path("map/prediction.html").read_text()
    assert page.index("Over the workspace") < page.index('<h2 id="positions"')
    assert "95 % band of it" in page
    rows = list(csv.DictReader(Path("map/prediction.csv").read_text().splitlines()))
    first = next(line for line in out.splitlines() if line.startswith("  1 ")).split()
    point = [float(rows[0][axis]) for axis in "xyz"]
    np.testing.assert_allclose([float(x) for x in first[1:4]], point, atol=0.006)
    ends = [1e6 * float(rows[0][f"compliance_softest {end}"]) for end in ("lower", "upper")]
    np.testing.assert_allclose([float(first[5]), float(first[7])], ends, rtol=6e-3)
    assert len(Path("map/prediction.csv").read_text().splitlines()) == 9


def test_bands_by_draws_are_near_those_by_derivatives(robot) -> None:
    std = []
    for words in (("--draws=60", "--seed=3"), ()):
        code, out, _ = oed("predict", robot, AT, "--json", *words)
        assert code == 0
        std.append(np.array(json.loads(out)["compliance"]["std"])[0, :2])
    ratio = std[0] / std[1]  # 9 % of scatter
    assert (ratio > 0.6).all()
    assert (ratio < 1.5).all()
    assert (ratio != 1).all()


def test_margins_are_those_of_the_controller(robot) -> None:
    motor = {"numerator": [40.0 * 0.08, 40.0], "denominator": [0.004, 1.0]}
    content = {"schema": "controller/1", "motors": [motor, motor]}
    Path("controller.json").write_text(json.dumps(content))
    words = ("--controller=controller.json", "--draws=6")
    code, out, err = oed("margins", robot, AT, *words)
    assert (code, err) == (0, "")
    assert "of 6 draws" in out
    assert "unstable open-loop poles: stable" in out
    page = Path("margins.html").read_text()
    assert "All loops at once" in page
    assert "encircles the origin 2 times counter-clockwise, with 2 unstable open-loop poles" in page
    written = json.loads(Path("margins.json").read_text())
    feedback = robotmodels.linear_feedback("controller.json")
    positions = np.deg2rad([[-45.0, 20.0]])
    expected = robotmodels.loop_margins(robotmodels.load_robot(robot), positions, feedback)
    peaks = written["nominal"]["peak_sensitivity"]
    np.testing.assert_allclose(peaks, expected.peak_sensitivity)
    assert len(list(csv.DictReader(Path("margins.csv").read_text().splitlines()))) == 2


MISTAKES = {
    ("predict", "--at=1,2"): "--at: 2 given, 3 needed",
    ("predict", "--motion=displacment"): "did you mean 'displacement'",
    ("predict", "--link=tool"): "'tool' is not a link of the URDF",
    ("predict", "--frequencies=2,80,1"): "--frequencies: '2,80,1'",
    ("predict", "--frequencies=80,2"): "--frequencies: 80 to 2 Hz",
    ("margins", "--controller=absent.json"): "absent.json",
    ("margins", "--controller=one_motor.json"): "one_motor.json: 1 motors, the robot has 2",
}


@pytest.mark.parametrize("words", MISTAKES)
def test_mistakes_are_one_line(words, robot) -> None:
    command, option = words
    motor = {"numerator": [1.0], "denominator": [1.0]}
    Path("one_motor.json").write_text(json.dumps({"schema": "controller/1", "motors": [motor]}))
    code, _, err = oed(command, robot, option)
    assert code == 2
    assert MISTAKES[words] in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    "words",
    [
        ("predict", "--at=1,2"),
        ("predict", "--axes=tool"),
        ("predict", "--frequencies=80,2"),
        ("margins", "--controller=absent.json"),
    ],
)
def test_mistakes_are_told_before_a_robot_is_read(words, monkeypatch, tmp_path) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, err = oed(words[0], "absent_robot", words[1])
    assert code == 2
    assert "absent_robot" not in err


def test_robots_without_deviations_say_so() -> None:
    code, _, err = oed("predict", "ur10")
    assert code == 2
    assert "no standard deviation of a free parameter" in err
