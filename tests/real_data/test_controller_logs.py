"""Logs of real controllers: what must come out stands in the README beside them."""

import os
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

import estimators
import robotmodels
from estimators.logs.proposal import propose_mapping
from estimators.logs.shift_regression import velocity_relation
from robotmodels.logs.mapping_file import Mapping
from robotmodels.logs.open_log import open_log

DATA = Path(__file__).parents[2].parent / "shared" / "data"


def files(*names):
    paths = [DATA / name for name in names]
    if not all(path.is_file() for path in paths):
        message = f"{paths[0]} is absent: logs of real controllers, see shared/data"
        if os.environ.get("CI") == "true":
            pytest.fail(message)
        pytest.skip(message)
    return paths


def movement(paths, **mapping):
    (single,) = robotmodels.import_movements(
        paths, Mapping.model_validate({"schema": "import/1", **mapping})
    )
    return single


def rms(values):
    return np.sqrt(np.mean(values**2, axis=0))


def approx(value):
    return pytest.approx(value, rel=1e-5)


def agree(values, figures):
    """Return whether values are published figures, to half a unit of their last digits."""
    units = [10.0 ** Decimal(figure).as_tuple().exponent for figure in figures.split()]
    distance = np.abs(values - np.array(figures.split(), dtype=float))
    return bool((distance < 0.5001 * np.array(units)).all())


def test_universal_robots_at_rest():
    log = files("logs/01_ur_rtde/robot_data.csv")
    currents = [f"actual_current_{i}" for i in range(6)]
    signals = [
        {"column": "actual_q_*", "role": "motor_angle", "unit": "rad", "side": "joint"},
        {"column": "actual_qd_*", "role": "motor_velocity", "unit": "rad/s", "side": "joint"},
        {"column": currents, "role": "motor_current", "unit": "A"},
    ]
    m = movement(log, signals=signals)
    assert (len(m), m.sample_time) == (256, approx(0.1))
    assert agree(m.motor_angle[0, :2], "1.21449e-5 -1.57075")
    assert agree(rms(m.motor_angle)[:2], "1.70988e-5 1.570787")
    assert rms(m.signal("motor_velocity"))[0] == 0
    assert agree(rms(m.signal("motor_current"))[0], "0.150033")
    with open_log(log) as opened:
        proposal = propose_mapping(opened, robotmodels.load_robot("ur5"))
    evidence = {entry.family.role: entry.evidence for entry in proposal.entries}
    assert "not determined" in evidence["motor_velocity"]
    assert proposal.mapping.signals[0].unit == "rad"


def test_staubli_two_files_without_a_clock_and_a_coupled_wrist():
    log = files("logs/02_tx40/pos_read_data.csv", "logs/02_tx40/curr_data.csv")
    m = movement(
        log,
        time={"sample_time": 0.0002},
        ratios=[32, 32, 45, -48, 45, 32],
        couplings={"joint_6": {"joint_5": 1.0}},
        signals=[
            {"column": "pos_read_data:*", "role": "motor_angle", "unit": "rad", "side": "motor"},
            {"column": "curr_data:*", "role": "motor_current", "unit": "A"},
        ],
    )
    assert (len(m), m.sample_time) == (12_000, approx(0.0002))
    assert agree(m.motor_angle[0, :2], "9.98688e-7 1.570781")
    assert agree(rms(m.motor_angle)[:2], "1.301055 1.249923")
    assert agree(rms(m.signal("motor_current"))[:2], "1.256734 1.220023")


def test_tiago_three_files_with_one_time():
    names = ("position", "velocity", "effort")
    log = files(*(f"logs/03_tiago/tiago_{name}.csv" for name in names))
    torso = {"side": "joint", "joint": "joint_1"}
    arm = {"side": "joint", "joints": [f"joint_{i}" for i in range(2, 9)]}
    m = movement(
        log,
        joints=[f"joint_{i}" for i in range(1, 9)],
        signals=[
            {"column": "*torso*position", "role": "motor_angle", "unit": "m", **torso},
            {"column": "*arm*position", "role": "motor_angle", "unit": "rad", **arm},
            {"column": "*torso*velocity", "role": "motor_velocity", "unit": "m/s", **torso},
            {"column": "*arm*velocity", "role": "motor_velocity", "unit": "rad/s", **arm},
            {"column": "*effort", "role": "motor_current", "unit": "A"},
        ],
    )
    assert (len(m), m.sample_time) == (3000, approx(0.01))
    assert agree(m.motor_angle[0, :2], "0.0597779 0.0699913")
    assert agree(rms(m.motor_angle)[:2], "0.2090515 0.5207399")
    assert agree(rms(m.signal("motor_velocity"))[:2], "0.02624164 0.1205970")
    assert agree(rms(m.signal("motor_current"))[:2], "1.524593 0.4039988")
    with open_log(log) as opened:
        stamps = opened.table_of("tiago_position:t")[0].values("t")
        for table in opened.tables:
            assert np.array_equal(table.values("t"), stamps)
    for j in range(8):
        relation = velocity_relation(stamps, m.motor_angle[:, j], m.signal("motor_velocity")[:, j])
        assert 0.993 < 1 / relation.factor < 1.007
        assert 0.184 < relation.lag < 0.199
    assert "scatter" in "".join(m.provenance["changes"])


def test_twincat_blocks_with_clocks_of_their_own():
    for name in ("decimal_comma", "double_timestamps"):
        log = files(f"logs/07_twincat/scope_{name}.csv")
        with open_log(log) as opened:
            rows = {table.rows for table in opened.tables}
            assert rows == {1000, 4996, 201}
        for channel, step, count in (
            ("var_REAL64", 0.001, 1000),
            ("func_OS", 0.0002, 4996),
            ("func_freesample", 0.005, 201),
        ):
            m = movement(log, signals=[{"column": channel, "role": "other"}])
            assert len(m) == count
            assert m.sample_time == approx(step)
        signals = [{"column": c, "role": "other"} for c in ("var_REAL64", "func_units_scaled")]
        m = movement(log, signals=signals)
        assert m.others["var_REAL64"][0] == 0
        assert agree(rms(m.others["var_REAL64"]), "576.9172")
        assert m.others["func_units_scaled"][0] == 10
        assert agree(rms(m.others["func_units_scaled"]), "5760.516")


def test_universal_files():
    folder = "logs/14_uff58"
    (history,) = files(f"{folder}/time-history-not-all-columns-filled.uff")
    with open_log(history) as log:
        (table,) = log.tables
        name = next(channel for channel in table.channels if channel != "time")
        assert (table.rows, table.sample_time) == (13, 5e-5)
        assert table.channels[name].unit == "m/s²"
    signal = {"column": name, "role": "accelerometer", "name": "s1"}
    m = movement([history], signals=[signal])
    assert agree(m.others["s1"][0], "-3.81956")
    assert agree(rms(m.others["s1"]), "3.740783")
    (response,) = files(f"{folder}/non_ascii_header.uff")
    with open_log(response) as log:
        (table,) = log.tables
        values = table.values("ref6_23_Mar")
        assert np.diff(table.values("frequency")) == approx(0.195313)
        assert len(values) == 6
        assert agree(values[0], "0.407994")
        assert agree(rms(np.abs(values)), "2.186937")


@pytest.mark.parametrize("name", ["panda_exciting_trajectory.db3", "derived_ros1.bag"])
def test_panda_ros_bags(name):
    """A bare database of ROS 2 without metadata, and the same messages as a bag of ROS 1."""
    log = files(f"logs/09_panda_ros2/{name}")
    robot = robotmodels.load_robot("panda")
    fields = (("position", "motor_angle", "rad"), ("velocity", "motor_velocity", "rad/s"),
              ("effort", "motor_torque", "N*m"))  # fmt: skip
    signals = [
        {"column": f"{field}[*]", "role": role, "unit": unit, "side": "joint"}
        for field, role, unit in fields
    ]
    m = movement(log, robot="panda", signals=signals)
    assert m.joints == robot.motor_names
    assert (len(m), m.sample_time) == (727, approx(0.03333334))
    assert agree(m.motor_angle[0, 0], "-2.253338")
    assert agree(rms(m.motor_angle)[0], "1.087413")
    assert agree(rms(m.signal("motor_velocity"))[0], "0.3815574")
    assert agree(rms(m.motor_torque)[:2], "0.9259366 18.00100")
    with open_log(log) as opened:
        proposal = propose_mapping(opened, robot)
    entries = {entry.family.role: entry for entry in proposal.entries}
    assert (entries["motor_angle"].signal.unit, entries["motor_angle"].signal.side) == (
        "rad", "joint"
    )  # fmt: skip
    relations = entries["motor_velocity"].relations
    assert len(relations) == 7
    for relation in relations:
        assert 0.983 < 1 / relation.factor < 1.008
        assert -0.005 < relation.lag < 0.010


@pytest.fixture(scope="module")
def kr300():
    with open_log(files("kr300/record_A.mat")) as log:
        return propose_mapping(log, robotmodels.load_robot("kr300"))


def test_kr300_is_understood_without_a_mapping(kr300):
    """Clock, units, side, both encoders, velocities, sign, start pose, inertias."""
    entries = {entry.family.role: entry for entry in kr300.entries}
    angle, link = entries["motor_angle"], entries["link_angle"]
    assert (angle.signal.unit, angle.signal.side) == ("deg", "joint")
    late = [1e3 * r.lag for r in link.relations if r is not None]
    assert late == pytest.approx([3.07, 3.07, 2.99], abs=0.15)
    errors = [1e3 * r.lag_std for r in link.relations if r is not None]
    assert all(abs(lag - 3.0) < 2 * error < 0.6 for lag, error in zip(late, errors, strict=True))
    slopes = [r.factor for r in link.relations if r is not None]
    assert slopes == pytest.approx([1.0, 1.0, 1.0], abs=6e-4)
    assert all(f"rec.act_pos_se_deg[{j}]" in link.evidence for j in (3, 4, 5))
    assert "absent" in link.evidence
    velocity = entries["motor_velocity"]
    assert [1 / r.factor for r in velocity.relations] == pytest.approx([1.0] * 6, abs=1e-4)
    assert [1e3 * r.lag for r in velocity.relations] == pytest.approx([4.39] * 6, abs=0.015)
    scatter = np.std([r.lag for r in velocity.relations], ddof=1)  # of lags that are one
    assert 0.5 < scatter / np.mean([r.lag_std for r in velocity.relations]) < 2
    assert velocity.signal.unit == "deg/s"
    second = entries["link_velocity"]
    assert second.signal is None
    assert "unfit" in second.evidence
    good = [r for r in second.relations if r is not None and r.determined]
    assert [1e3 * r.lag for r in good] == pytest.approx([23.05] * 3, abs=0.1)
    assert [1 / r.factor for r in good] == pytest.approx([0.9998] * 3, abs=6e-4)
    torque = entries["motor_torque"]
    assert (torque.signal.sign, torque.signal.side) == (1, "motor")
    assert "moving samples" in torque.evidence
    findings = "\n".join(kr300.findings)
    assert "2501 samples every 4 ms" in findings
    assert "start_pose" in findings
    assert "para.J_mr: inertia of m4 is 0.01 in the log, 0.00173" in findings


def test_kr300_becomes_a_movement_on_the_joint_side(kr300):
    robot = robotmodels.load_robot("kr300")
    pose = np.radians([0, -90, 90, 0, 0, 0]).tolist()
    mapping = kr300.mapping.model_copy(update={"start_pose": tuple(pose)})
    (m,) = robotmodels.import_movements(files("kr300/record_A.mat"), mapping, robot)
    assert (len(m), m.sample_time) == (2501, approx(0.004))
    assert m.joints == robot.motor_names
    assert np.isnan(m.link_angle[:, 3:]).all()
    assert np.std(m.motor_angle[:, :3] - m.link_angle[:, :3], axis=0).max() < 1e-3
    low, high = robot.position_limits.T
    assert ((m.motor_angle > low) & (m.motor_angle < high)).all()
    assert m.motor_torque[0, 1] == pytest.approx(-784, abs=40)  # stiction holds it at the start


def test_kr300_from_the_log_to_springs():
    """A short mapping, then the springs of a robot that nobody here built."""
    robot = robotmodels.load_robot("kr300")
    signals = [
        {"column": "rec.act_pos_mot_deg[*]", "role": "motor_angle", "unit": "deg", "side": "joint"},
        {"column": "rec.act_pos_se_deg[*]", "role": "link_angle", "unit": "deg"},
        {
            "column": "rec.act_torque_abs_nm[*]",
            "role": "motor_torque",
            "unit": "N*m",
            "side": "motor",
        },
    ]
    pose = np.radians([0, -90, 90, 0, 0, 0]).tolist()
    m = movement(files("kr300/record_A.mat"), robot="kr300", start_pose=pose, signals=signals)
    fit = estimators.fit_deflection(robot, m)
    values = {interval.name: interval for interval in fit.intervals()}
    for axis in (1, 2, 3):
        assert values[f"m{axis}.delay"].value == pytest.approx(0.003, abs=0.00015)
    assert 130 < values["payload.mass"].value < 170
    assert 6.4e6 < values["g2.stiffness"].value < 10e6
    assert 4.2e6 < values["g3.stiffness"].value < 5.4e6
    assert values["g1.stiffness"].verdict == "not identifiable"
