"""What ``oed check`` prints: readable, complete, the same as JSON, one line for a mistake."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import oed
from robots import BALANCED, CRANE, SENSED, built
from typer.testing import CliRunner

import robotmodels
from reports import application
from reports.commands.check_options import read_band, read_position
from reports.summaries.robot_summary import robot_json, robot_summary
from robotmodels import ElasticRobot, InvalidInput
from robotmodels.checks.diagnosis import diagnose
from robotmodels.checks.warnings import suspicions


def shown(robot: ElasticRobot, position: list[float] | None = None) -> str:
    at = robot.position_limits.mean(axis=1) if position is None else np.array(position)
    diagnosis = diagnose(robot, at)
    return robot_summary(diagnosis, suspicions(diagnosis), robot.file)


def line(text: str, start: str) -> str:
    """Return the one line whose first word is `start`."""
    (found,) = (row for row in text.splitlines() if row.split()[:1] == [start])
    return " ".join(found.split())


@pytest.mark.parametrize("name", robotmodels.builtin_robots())
def test_every_robot_fits_a_terminal(name: str) -> None:
    text = shown(robotmodels.load_robot(name))
    assert max(map(len, text.splitlines())) <= 80  # as wide as a terminal
    assert len(text.splitlines()) < 100
    assert not {"nan", "inf", "None", "–"} & set(text.split())
    for title in ("bodies", "motors", "springs", "resonances", "anti-resonances", "rigid mode"):
        assert title in text


def test_columns_are_aligned() -> None:
    rows = shown(robotmodels.load_robot("ur10")).splitlines()
    start = next(i for i, row in enumerate(rows) if row.startswith("springs"))
    table = rows[start + 1 : start + 20]
    assert len({row.index("°") for row in table if "°" in row}) == 1
    assert len({len(row) for row in table}) == 1


def test_units_states_and_loads() -> None:
    text = shown(robotmodels.load_robot("ur10"))
    assert "26 of 36 parameters free" in text
    assert line(text, "d2") == "d2 shoulder_lift_joint drive 40.0 60.0 0.328° 229"
    assert line(text, "b4z").count("fixed") == 2
    assert "payload included: 10.0 kg on wrist_3_link" in text
    assert "10 of 18 undamped modes, at 87.2 to 442 Hz, above 80 Hz" in text
    assert "6 rigid modes, one per motor" in text
    motor = next(row for row in text.splitlines() if "spring d2" in row)
    # 3.9212e-4 kg m^2, times 101^2; -229 N m on the arm are -2.27 on the shaft.
    assert motor.split()[:5] == ["m2", "shoulder_lift_joint", "101", "3.92", "4.00"]
    assert motor.split()[6] == "-2.27"


def test_ties_cuts_rigid_drives_and_prismatic_joints() -> None:
    text = shown(built(CRANE))
    assert "tied: fy.stiffness to fx.stiffness, dl.stiffness.high to dw.damping" in text
    assert "cut through boom at (0.300, 0.000, 0.000) m: az, ay" in text
    assert next(row for row in text.splitlines() if row.startswith("  mn")).endswith("rigid")
    assert "500 kN/m" in text
    assert line(text, "ds").endswith("mm 190 N")
    assert "at 100 N m 60.0" in " ".join(text.split())


def test_outputs_only_where_they_are_not_the_default() -> None:
    assert "outputs" not in shown(robotmodels.load_robot("panda"))
    robot = built(SENSED)
    text = shown(robot)
    assert "outputs (9)" in text
    words = " ".join(text.split())
    assert "accelerometer 'tip': acceleration of link wrist_3_link at (0.100, 0.000, " in words
    assert "0.050) m, along (0, 1, 1) [m/s²]" in words
    assert "late by 0.200 ms" in text
    assert "payload.com.z" in text
    file = robot.file.model_copy(update={"output": "velocity"})
    speed = shown(ElasticRobot(file, robot.folder))
    assert "velocity of every motor [rad/s]" in speed


def test_torque_gains_and_modes_that_cannot_be_told_apart() -> None:
    robot = built(CRANE)
    motors = [m.model_copy(update={"torque_gain": 1.1}) for m in robot.file.motors[:1]]
    file = robot.file.model_copy(update={"motors": [*motors, *robot.file.motors[1:]]})
    diagnosis = diagnose(robot, robot.position_limits.mean(axis=1))
    failed = replace(diagnosis, modes=(), overdamped=(), modes_failed="too damped")
    text = robot_summary(failed, suspicions(failed), file)
    assert "torque gains other than 1: mw 1.10" in text
    assert "undamped: 6.6" in text
    assert "overdamped mode: too damped" in text


def test_json_is_the_diagnosis_in_si_units() -> None:
    robot = built(SENSED)
    diagnosis = diagnose(robot, np.zeros(6))
    content = json.loads(robot_json(diagnosis, suspicions(diagnosis), robot.file))
    assert content["bodies"][0]["carried"] == pytest.approx(37.7)
    assert content["springs"][0]["stiffness"] == 4e4
    assert content["band"] == pytest.approx([4 * np.pi, 160 * np.pi])
    assert content["resonances"] == list(diagnosis.resonances)
    assert content["payload"]["mass"] == 5.0
    assert content["warnings"][0]["rule"] == "mode above the band"
    assert {a["name"] for a in content["accelerometers"]} == {"tip", "elbow", "foot"}


def test_a_position_is_in_degrees_and_in_metres_where_joints_slide() -> None:
    position = read_position(built(CRANE), "10,-20,0.3,0,5")
    assert position == pytest.approx([*np.radians([10, -20]), 0.3, *np.radians([0, 5])])
    np.testing.assert_allclose(read_position(built(CRANE), None)[2:4], [0.1, 0.25])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("0,0", r"2 given, 5 needed, one per motor: wrist, turn"),
        ("0,0,zero,0,0", r"'0,0,zero,0,0' is not a list of numbers such as"),
        ("0,200,0,0,0", r"'turn' at 200° is outside its limits, -180\.0 to 180\.0°"),
        ("0,0,20,0,0", r"'slide' at 20 m is outside its limits, -0\.2000 to 0\.4000 m"),
        ("nan,0,0,0,0", r"'wrist' at nan° is outside"),
    ],
)
def test_positions_that_cannot_be(words: str, message: str) -> None:
    with pytest.raises(InvalidInput, match=f"--position: .*{message}"):
        read_position(built(CRANE), words)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("80,2", "80 to 2 Hz; two positive frequencies"),
        ("0,2", "0 to 2 Hz"),
        ("2,nan", "2 to nan Hz"),
        ("2,inf", "2 to inf Hz"),
        ("2", "1 given, two are needed"),
        ("low,high", "'low,high' is not a list"),
    ],
)
def test_bands_that_cannot_be(words: str, message: str) -> None:
    with pytest.raises(InvalidInput, match=f"--band: {message}"):
        read_band(words)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["ur99"], "'ur99' is neither a built-in robot"),
        (["ur10", "--position", "0,1"], "6 needed"),
        (["ur10", "--position", "-10,0,0,0,0,900"], "'wrist_3_joint' at 900°"),
        (["ur10", "--band", "80,2"], "the lower first"),
    ],
)
def test_a_mistake_is_one_line_and_exit_code_2(words: list[str], message: str) -> None:
    code, out, err = oed("check", *words)
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert message in err


def test_the_command_prints_either() -> None:
    runner = CliRunner()
    words = ["check", "moberg_axis1", "--position", "-10", "--band", "5,30"]
    text = runner.invoke(application.app, words)
    assert text.exit_code == 0
    assert "position: -10°" in text.stdout
    assert "1 of 3 undamped modes, at 41.8 Hz, above 30 Hz" in text.stdout
    content = json.loads(runner.invoke(application.app, [*words, "--json"]).stdout)
    assert content["motors"][0]["angle"] == pytest.approx(np.radians(-10))


def test_friction_is_said_and_flagged_where_it_dominates() -> None:
    text = " ".join(shown(built(BALANCED)).split())
    assert "joint shoulder_lift_joint, f2: viscous 15 N m s/rad" in text
    assert "Coulomb friction of f3 is in simulations only" in text
    robot = robotmodels.with_speeds(built(BALANCED), np.full(3, 0.5))
    text = " ".join(shown(robot).split())
    assert "beside 4 of viscous friction; it DOMINATES" in text
