"""What is told or refused of logs and mappings, where no other test does."""

import json

import h5py
import numpy as np
import pytest
from mcap.writer import Writer

import robotmodels
from estimators.logs.mapping_checks import mapping_findings
from robotmodels.common.errors import InvalidInput
from robotmodels.logs import periodic
from robotmodels.logs.importer import Import
from robotmodels.logs.mapping_file import Mapping
from robotmodels.logs.open_log import open_log
from robotmodels.logs.periodic import found_records

STEP, N = 0.004, 400
TIME = STEP * np.arange(N)
ANGLES = np.stack([np.sin(3 * TIME), np.cos(2 * TIME)], axis=1)
ANGLE = {"column": "q*", "role": "motor_angle", "unit": "rad", "side": "joint"}
TORQUE = {"column": "f*", "role": "motor_torque", "unit": "N*m", "side": "joint"}


def write(path, time=TIME, rows=slice(None), **columns):
    """Write a text file with stamps and channels."""
    columns = columns or {"q1": ANGLES[:, 0], "q2": ANGLES[:, 1]}
    table = np.column_stack([time, *columns.values()])[rows]
    header = ",".join(["t", *columns])
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.17g")
    return path


def source_of(paths, use, robot=None, **mapping):
    """Return what `use` makes of an import."""
    document = {"schema": "import/1", "signals": [ANGLE], **mapping}
    with open_log(paths) as log:
        return use(Import(log, Mapping.model_validate(document), robot))


def notes(source):
    return "\n".join(source.notes)


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"joints": ["m1", "m9"]}, "joints: 'm9' is no motor or joint of ur10"),
        ({"couplings": {"m1": {"m9": 1.0}}}, "couplings: 'm9' is no joint of the log"),
        ({"couplings": {"m1": {"m2": 1}, "m2": {"m1": 1}}}, "motors must determine the joints"),
        ({"signals": [{**ANGLE, "sign": [1, -1, 1]}]}, "sign: 3 numbers for 2 joints"),
        ({"time": {"column": "t", "unit": "kg"}}, "unit 'kg' of the time is none of time"),
        ({"time": {"counter": "t"}}, "counter needs the sample_time of one count"),
    ],
)
def test_mappings_that_do_not_fit(tmp_path, mapping, message):
    robot = robotmodels.load_robot("ur10")
    choice = {"joints": ["m1", "m2"], **mapping}
    with pytest.raises(InvalidInput, match=message) as error:
        source_of(write(tmp_path / "a.csv"), notes, robot, **choice)
    assert "\n" not in str(error.value)


def test_a_sign_of_zero_is_none(tmp_path):
    (tmp_path / "m.yaml").write_text(
        "schema: import/1\nsignals: [{column: q, role: motor_angle, sign: 0}]\n"
    )
    with pytest.raises(InvalidInput, match="1 or -1 is needed"):
        robotmodels.import_movements(write(tmp_path / "a.csv"), tmp_path / "m.yaml")


def test_logs_without_signals(tmp_path):
    with pytest.raises(InvalidInput, match="no file named"), open_log([]):
        pass
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["mass"] = 3.0
    with pytest.raises(InvalidInput, match="no arrays of 8 or more"), open_log(tmp_path / "a.h5"):
        pass
    (tmp_path / "a.bag").write_bytes(b"rubbish" * 40)
    with pytest.raises(InvalidInput, match="no bag of ROS 1"), open_log(tmp_path / "a.bag"):
        pass
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("text", "jsonschema", b"{}")
        channel = writer.register_channel("talk", "json", schema)
        writer.add_message(channel, 1, json.dumps({"text": "a"}).encode(), 1)
        writer.finish()
    message = "no topic with numbers in it .no message has numbers."
    with pytest.raises(InvalidInput, match=message), open_log(tmp_path / "a.mcap"):
        pass


def test_tables_that_share_no_time(tmp_path):
    a, b = write(tmp_path / "a.csv"), write(tmp_path / "b.csv", TIME + 100, f1=TIME, f2=TIME)
    with pytest.raises(InvalidInput, match="its tables have no time in common"):
        source_of([a, b], lambda source: source.runs, signals=[{**ANGLE, "column": "a:q*"}, TORQUE])


def test_a_channel_with_gaps_is_not_interpolated(tmp_path):
    a = write(tmp_path / "a.csv")
    rows = np.r_[0:100, 140:N]
    b = write(tmp_path / "b.csv", TIME + 0.001, rows, f1=ANGLES[:, 0], f2=ANGLES[:, 1])
    with pytest.raises(InvalidInput, match="40 samples are missing before row 100"):
        source_of([a, b], notes, signals=[{**ANGLE, "column": "a:q*"}, TORQUE])


def test_many_gaps_and_times_that_begin_anew(tmp_path):
    rows = np.delete(np.arange(N), np.arange(20, N - 20, 50))
    told = source_of(write(tmp_path / "a.csv", rows=rows), notes)
    assert "8 gaps in all; each part becomes a run of its own" in told
    twice = np.r_[TIME[: N // 2], TIME[: N // 2]]
    told = source_of(write(tmp_path / "b.csv", twice), notes)
    assert f"the time begins anew at row {N // 2}, and with it a run" in told


def test_a_channel_slower_than_its_table(tmp_path):
    held = np.repeat(ANGLES[::4, 0], 4)
    told = source_of(write(tmp_path / "a.csv", q1=held, q2=ANGLES[:, 1]), notes)
    assert "q1 (motor_angle of joint_1): 75% of values repeat the one before" in told
    assert "q2 (motor_angle of joint_2)" not in told


def test_missing_values_are_counted(tmp_path):
    gappy = np.where(np.arange(N) % 100 == 7, np.nan, ANGLES[:, 0])
    told = source_of(write(tmp_path / "a.csv", q1=gappy, q2=ANGLES[:, 1]), notes)
    assert "q1 (motor_angle of joint_1): 4 of 400 values are missing" in told


def test_why_there_are_no_records(tmp_path, monkeypatch):
    path = write(tmp_path / "a.csv", q1=ANGLES[:, 0], q2=ANGLES[:, 1], f1=TIME, f2=TIME)
    both = {"signals": [ANGLE, TORQUE]}
    _, (reason,) = source_of(path, found_records)
    assert "motor angles and motor torques are needed" in reason
    _, (reason,) = source_of(path, found_records, **both)
    assert "ratios or a robot is needed" in reason
    _, (reason,) = source_of(path, found_records, **both, ratios=[50.0], period=0)
    assert "period: 0 says that it is not periodic" in reason
    monkeypatch.setattr(periodic, "_MOST_NUMBERS", 600)
    _, (reason,) = source_of(path, found_records, **both, ratios=[50.0])
    assert reason == "no records: more than 300 samples; cut the log"


def test_where_accelerometers_sit(tmp_path):
    """By the robot file, of those that it names."""
    robot = robotmodels.load_robot("ur10")
    sensor = {"name": "s1", "link": "forearm_link", "at": [0.1, 0, 0], "direction": [0, 0, 1]}
    file = robot.file.model_validate(
        {**robot.file.model_dump(by_alias=True), "accelerometers": [sensor]}
    )
    path = write(tmp_path / "a.csv", q1=ANGLES[:, 0], q2=ANGLES[:, 1], a=TIME, b=TIME + 1)
    more = [
        {"column": column, "role": "accelerometer", "unit": "g", "name": name}
        for column, name in (("a", "s1"), ("b", "s2"))
    ]
    mapping = {"joints": ["m1", "m2"], "signals": [ANGLE, *more]}
    lines = source_of(
        path, mapping_findings, robotmodels.ElasticRobot(file, robot.folder), **mapping
    )
    assert "accelerometer s1: on forearm_link at (0.1, 0, 0) m along (0, 0, 1)" in lines
    assert any(line.startswith("accelerometer s2: not in the robot file") for line in lines)
