"""Logs that need optional libraries, each written by another library than reads it, or by hand."""

import json
import sqlite3
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer as Ros2McapWriter
from nptdms import ChannelObject, TdmsWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from robotmodels.common.errors import InvalidInput
from robotmodels.logs import optional_library
from robotmodels.logs.clocks import fitted_clock
from robotmodels.logs.message_types import RosType
from robotmodels.logs.open_log import open_log
from robotmodels.logs.topic_table import TopicTable

N, STEP = 200, 0.008
TIME = STEP * np.arange(N)
ANGLES = np.stack([np.sin(TIME), 2 * np.cos(TIME), -TIME], axis=1)
NAMES = ["shoulder", "elbow", "wrist"]
START = 1_700_000_000 * 1_000_000_000
STAMPS = START + np.round(TIME * 1e9).astype(np.int64)
EXTRA = "float64 tool\nfloat64[2] pair\nbool on\nstring text\n"


def test_parquet_with_nested_lists(tmp_path):
    """As LeRobot stores a state a frame, with stamps and text beside."""
    state = pa.array(ANGLES.tolist(), type=pa.list_(pa.float64()))
    fixed = pa.FixedSizeListArray.from_arrays(pa.array(ANGLES.ravel()), 3)
    table = pa.table(
        {
            "observation.state": state,
            "action": fixed,
            "timestamp": TIME,
            "moment": pa.array(STAMPS, type=pa.timestamp("ns")),
            "task": ["move"] * N,
            "done": [False] * (N - 1) + [True],
            "count": np.arange(N),
        }
    )
    pq.write_table(table, tmp_path / "log.parquet", row_group_size=70)
    with open_log(tmp_path / "log.parquet") as log:
        table = log.tables[0]
        assert "task" not in table.channels
        for j in range(3):
            assert np.array_equal(table.values(f"observation.state[{j}]"), ANGLES[:, j])
            assert np.array_equal(table.values(f"action[{j}]"), ANGLES[:, j])
        assert table.values("done").sum() == 1
        assert np.diff(table.values("moment")) == pytest.approx(STEP, abs=3e-7)


def test_parquet_with_structs_and_lists_of_changing_lengths(tmp_path):
    joints = [{"name": "a", "position": [float(k), 2.0]} for k in range(N)]
    boxes = [[1.0] * (k % 3) for k in range(N)]
    pq.write_table(pa.table({"t": TIME, "joints": joints, "boxes": boxes}), tmp_path / "a.parquet")
    with open_log(tmp_path / "a.parquet") as log:
        (table,) = log.tables
        assert list(table.channels) == ["t", "joints.position[0]", "joints.position[1]"]
        assert np.array_equal(table.values("joints.position[0]"), np.arange(N))


def test_tdms_with_stamps(tmp_path):
    stamps = np.datetime64("2024-01-01T12:00:00") + np.round(TIME * 1e6).astype("timedelta64[us]")
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment([ChannelObject("g", "moment", stamps), ChannelObject("g", "q", TIME)])
    with open_log(tmp_path / "a.tdms") as log:
        (table,) = log.tables
        assert table.time == "moment"
        assert np.diff(table.values("moment")) == pytest.approx(STEP, abs=5e-7)


def joint_state(store, k, order=(0, 1, 2)):
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](
        sec=int(STAMPS[k] // 10**9), nanosec=int(STAMPS[k] % 10**9)
    )
    header = {"stamp": stamp, "frame_id": ""}
    if "seq" in types["std_msgs/msg/Header"].__dataclass_fields__:
        header["seq"] = k
    return types["sensor_msgs/msg/JointState"](
        header=types["std_msgs/msg/Header"](**header),
        name=[NAMES[j] for j in order],
        position=ANGLES[k, list(order)],
        velocity=np.zeros(3),
        effort=np.array([]),
    )


def check_joint_states(path, topic="joints"):
    with open_log(path) as log:
        table = next(table for table in log.tables if table.name == topic)
        assert table.values("time") == pytest.approx(TIME, abs=1e-9)
        for j, name in enumerate(NAMES):
            assert np.array_equal(table.values(f"position[{name}]"), ANGLES[:, j])
        assert not any(channel.startswith("effort") for channel in table.channels)
        return log.notes


def custom(store):
    types = get_types_from_msg(EXTRA, "our_msgs/msg/Tool")
    store.register(types)
    return lambda k: store.types["our_msgs/msg/Tool"](
        tool=float(k), pair=np.array([k, -k], dtype=float), on=True, text="a"
    )


def write_bag2(path, plugin):
    store = get_typestore(Stores.ROS2_JAZZY)
    message = custom(store)
    with Writer2(path, version=9, storage_plugin=plugin) as writer:
        joints = writer.add_connection("/joints", "sensor_msgs/msg/JointState", typestore=store)
        tool = writer.add_connection("/tool", "our_msgs/msg/Tool", typestore=store)
        for k in range(N):
            order = (0, 1, 2) if k % 2 else (2, 0, 1)  # a driver may list joints anyhow
            order = (0, 1, 2) if k == 0 else order
            raw = store.serialize_cdr(joint_state(store, k, order), "sensor_msgs/msg/JointState")
            writer.write(joints, int(STAMPS[k]) + 1_000_000, raw)
            if k % 4 == 0:
                raw = store.serialize_cdr(message(k), "our_msgs/msg/Tool")
                writer.write(tool, int(STAMPS[k]) + 2_000_000, raw)


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
@pytest.mark.parametrize("bare", [False, True])
def test_ros_2_bags_with_custom_messages(tmp_path, plugin, bare):
    """Whole folders, and their files without metadata."""
    write_bag2(tmp_path / "bag", plugin)
    ending = "*.db3" if plugin is StoragePlugin.SQLITE3 else "*.mcap"
    path = next((tmp_path / "bag").glob(ending)) if bare else tmp_path / "bag"
    check_joint_states(path)
    with open_log(path) as log:
        tool = next(table for table in log.tables if table.name == "tool")
        assert tool.rows == N // 4
        assert tool.values("pair[1]").tolist() == list(range(0, -N, -4))
        assert tool.values("time") == pytest.approx(TIME[::4] + 0.002, abs=1e-9)


def test_ros_1_bags(tmp_path):
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer1(tmp_path / "a.bag") as writer:
        joints = writer.add_connection("/joints", "sensor_msgs/msg/JointState", typestore=store)
        for k in range(N):
            raw = store.serialize_ros1(joint_state(store, k), "sensor_msgs/msg/JointState")
            writer.write(joints, int(STAMPS[k]), raw)
    check_joint_states(tmp_path / "a.bag")


def test_mcap_of_other_writers(tmp_path):
    """Foxglove's own writers: definitions of ROS 2 as text, and JSON."""
    definition = "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Ros2McapWriter(file)
        schema = writer.register_msgdef("our_msgs/msg/Joints", definition)
        for k in range(N):
            content = {"name": NAMES, "position": ANGLES[k].tolist(), "velocity": [], "effort": []}
            writer.write_message("/joints", schema, content, int(STAMPS[k]))
        writer.finish()
    check_joint_states(tmp_path / "a.mcap")
    with (tmp_path / "b.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("joints", "jsonschema", b"{}")
        channel = writer.register_channel("joints", "json", schema)
        for k in range(N):
            content = {"name": NAMES, "position": ANGLES[k].tolist(), "text": "a"}
            stamp = int(STAMPS[k])
            writer.add_message(channel, stamp, json.dumps(content).encode(), stamp)
        writer.finish()
    check_joint_states(tmp_path / "b.mcap")


def test_topics_of_unknown_types_are_passed_over_and_told(tmp_path):
    write_bag2(tmp_path / "bag", StoragePlugin.SQLITE3)
    path = next((tmp_path / "bag").glob("*.db3"))
    with sqlite3.connect(path) as database:
        database.execute("delete from message_definitions")
    database.close()
    notes = check_joint_states(path)
    assert "topic /tool: its type our_msgs/msg/Tool is not defined in the file" in notes[0]


def test_tdms(tmp_path):
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        for part in (slice(0, 120), slice(120, N)):
            properties = {"wf_increment": STEP, "unit_string": "deg"}
            writer.write_segment(
                [ChannelObject("drive", f"q{j}", ANGLES[part, j], properties) for j in range(3)]
            )
        writer.write_segment([ChannelObject("slow", "T", np.arange(20.0))])
    with open_log(tmp_path / "a.tdms") as log:
        table = next(table for table in log.tables if table.name == "drive")
        assert table.sample_time == STEP
        assert table.channels["q1"].unit == "deg"
        assert np.array_equal(table.values("q1"), ANGLES[:, 1])
        assert np.array_equal(table.channels["q2"].read(100, 150), ANGLES[100:150, 2])


def write_kuka_trace(folder):
    """Write header and samples as documented: blocks of little-endian doubles."""
    names = [f"AxisAct_A{j + 1}" for j in range(3)]
    lines = ["DIAEXTENDED  {@:ENGLISH", "#BEGINGLOBALHEADER", "101,KRC", "#ENDGLOBALHEADER"]
    time = {200: "Zeit", 202: "s", 210: "IMPLIZIT", 220: N, 240: 0, 241: STEP}
    channels = [
        {200: name, 202: "°", 210: "EXPLIZIT", 211: "TRACE.R64", 213: "BLOCK", 214: "REAL64",
         220: N, 221: j + 1, 240: 0, 241: 1e-3 if j == 1 else 1}
        for j, name in enumerate(names)
    ]  # fmt: skip
    for header in (time, *channels):
        lines += ["#BEGINCHANNELHEADER", *(f"{k},{v}" for k, v in header.items())]
        lines.append("#ENDCHANNELHEADER")
    (folder / "trace.dat").write_bytes("\r\n".join(lines).encode("cp1252"))
    (ANGLES * [1, 1e3, 1]).astype("<f8").tofile(folder / "trace.r64")
    return folder / "trace.dat"


def test_a_kuka_trace(tmp_path):
    with open_log(write_kuka_trace(tmp_path)) as log:
        (table,) = log.tables
        assert (table.rows, table.sample_time) == (N, STEP)
        assert list(table.channels) == ["AxisAct_A1", "AxisAct_A2", "AxisAct_A3"]
        assert table.channels["AxisAct_A1"].unit == "°"
        for j, name in enumerate(table.channels):
            assert table.values(name) == pytest.approx(ANGLES[:, j], rel=1e-12)


def test_a_kuka_trace_that_is_cut_off(tmp_path):
    path = write_kuka_trace(tmp_path)
    samples = (tmp_path / "trace.r64").read_bytes()
    (tmp_path / "trace.r64").write_bytes(samples[:-80])
    with (
        pytest.raises(InvalidInput, match="590 values, the header says 200 samples"),
        open_log(path),
    ):
        pass


@pytest.mark.parametrize(
    ("name", "library"),
    [("a.parquet", "pyarrow"), ("a.bag", "rosbags"), ("a.mcap", "mcap"), ("a.tdms", "nptdms")],
)
def test_a_missing_library_is_named_with_what_installs_it(tmp_path, monkeypatch, name, library):
    def absent(module):
        raise ImportError(module)

    monkeypatch.setattr(optional_library, "import_module", absent)
    (tmp_path / name).write_bytes(b"anything")
    command = r"pip install 'elastic-robot-oed\[records\]'"
    message = f"the library (rosbags|{library}) is needed; {command}"
    with pytest.raises(InvalidInput, match=message), open_log(tmp_path / name):
        pass


@pytest.mark.parametrize("name", ["a.parquet", "a.bag", "a.db3", "a.mcap", "a.tdms"])
def test_damaged_files_are_one_line(tmp_path, name):
    (tmp_path / name).write_bytes(b"\x89rubbish" * 99)
    with pytest.raises(InvalidInput) as error, open_log(tmp_path / name):
        pass
    assert str(Path(tmp_path / name)) in str(error.value)


def test_recordings_one_behind_the_other_become_runs():
    """LeRobot's files have episodes whose time begins at zero each."""
    stamps = np.concatenate([TIME[:80], TIME[:50], TIME[:70]])
    clock = fitted_clock(stamps, "a", "stamps")
    assert clock.segments == [(0, 80), (80, 130), (130, 200)]
    assert clock.restarts == (80, 130)
    assert clock.sample_time == pytest.approx(STEP)


RULE = 80 * "="
ODD = f"""uint8 mode
float64 level
string label
geometry_msgs/Point[] corners
bool[3] flags
int16[] counts
our_msgs/Inner inner
{RULE}
MSG: our_msgs/Inner
float32 small
int64 large
{RULE}
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
"""


def odd_messages(store):
    """Numbers between texts and arrays of other sizes, so that they lie elsewhere each time."""
    store.register(get_types_from_msg(ODD, "our_msgs/msg/Odd"))
    types, rng = store.types, np.random.default_rng(4)
    for k in range(60):
        points = [types["geometry_msgs/msg/Point"](x=1.0, y=2.0, z=3.0)] * (k % 3)
        yield types["our_msgs/msg/Odd"](
            mode=k,
            level=float(rng.standard_normal()),
            label="a" * (k % 5),
            corners=points,
            flags=rng.random(3) > 0.5,
            counts=rng.integers(-9, 9, 2).astype(np.int16),
            inner=types["our_msgs/msg/Inner"](
                small=np.float32(rng.random()), large=int(rng.integers(-(2**40), 2**40))
            ),
        )


@pytest.mark.parametrize("cdr", [True, False])
def test_numbers_of_messages_that_are_laid_out_anyhow(cdr):
    """Many at once or one by one, in both byte orders: what rosbags decodes."""
    store = get_typestore(Stores.EMPTY)
    messages = list(odd_messages(store))
    kind = RosType(store, "our_msgs/msg/Odd", cdr=cdr)
    for little in (True, False):
        if cdr:
            raws = [
                bytes(store.serialize_cdr(m, kind.kind, little_endian=little)) for m in messages
            ]
        else:
            raws = [bytes(store.serialize_ros1(m, kind.kind)) for m in messages]
        with ExitStack() as stack:
            topic = TopicTable(kind, raws[0], stack)
            assert topic._layout is not None
            for k, raw in enumerate(raws):
                topic.append(k, raw)
            topic.flush()
            table = topic.table("odd", 0)
            expected = [
                [m.mode, m.level, *m.flags, *m.counts, m.inner.small, m.inner.large]
                for m in messages
            ]
            values = np.stack([table.values(name) for name in topic.columns], axis=1)
        assert np.array_equal(values, np.array(expected, dtype=float))
        assert topic.dropped == 0


def write_small_chunks(path):
    """Joint states as bag of ROS 1 or as JSON in MCAP, some messages in each chunk."""
    if path.suffix == ".bag":
        store = get_typestore(Stores.ROS1_NOETIC)
        with Writer1(path) as writer:
            writer.chunk_threshold = 5000
            joints = writer.add_connection("/joints", "sensor_msgs/msg/JointState", typestore=store)
            for k in range(N):
                raw = store.serialize_ros1(joint_state(store, k), "sensor_msgs/msg/JointState")
                writer.write(joints, int(STAMPS[k]), raw)
        return
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=5000)
        writer.start()
        channel = writer.register_channel(
            "joints", "json", writer.register_schema("joints", "jsonschema", b"{}")
        )
        for k in range(N):
            content = json.dumps({"name": NAMES, "position": ANGLES[k].tolist()})
            writer.add_message(channel, int(STAMPS[k]), content.encode(), int(STAMPS[k]))
        writer.finish()


@pytest.mark.parametrize("name", ["a.bag", "a.mcap"])
def test_recordings_that_were_cut_off(tmp_path, name):
    """What came before is read, and the cut is told."""
    path = tmp_path / name
    write_small_chunks(path)
    assert check_joint_states(path) == ()
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with open_log(path) as log:
        (table,) = log.tables
        assert 20 < table.rows < N - 20
        assert np.array_equal(table.values("position[elbow]"), ANGLES[: table.rows, 1])
        assert log.notes == (f"{name}: it was cut off; what came before was read",)
