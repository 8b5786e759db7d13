"""Damaged logs are refused in one line, or read as far as they can be, never with a traceback."""

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from file_mutations import mutated_bytes
from mcap_ros2.writer import Writer as Ros2Writer
from nptdms import ChannelObject, TdmsWriter
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

from robotmodels.common.errors import InvalidInput
from robotmodels.logs.clocks import table_clock
from robotmodels.logs.mapping_file import TimeChoice
from robotmodels.logs.open_log import open_log

TIME = 0.004 * np.arange(120)
ANGLES = np.stack([np.sin(TIME), np.cos(TIME)], axis=1)


def write_text(path):
    table = np.column_stack([TIME, ANGLES])
    np.savetxt(path, table, header="t;q1;q2", delimiter=";", comments="")


def write_hdf5(path):
    with h5py.File(path, "w") as file:
        file["rec/t"], file["rec/q"] = TIME, ANGLES


def write_parquet(path):
    pq.write_table(pa.table({"t": TIME, "q": pa.array(ANGLES.tolist())}), path)


def write_tdms(path):
    with TdmsWriter(path) as writer:
        properties = {"wf_increment": 0.004}
        writer.write_segment(
            [ChannelObject("g", f"q{j}", ANGLES[:, j], properties) for j in (0, 1)]
        )


def write_bag(path):
    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "std_msgs/msg/Float64MultiArray"
    layout = store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    with Writer(path) as writer:
        writer.chunk_threshold = 2000
        connection = writer.add_connection("/q", kind, typestore=store)
        for time, angles in zip(TIME, ANGLES, strict=True):
            message = store.types[kind](layout=layout, data=angles)
            writer.write(connection, int(1e9 * time), store.serialize_ros1(message, kind))


def write_mcap(path):
    with path.open("wb") as file:
        writer = Ros2Writer(file, chunk_size=2000)
        schema = writer.register_msgdef("our_msgs/msg/Angles", "float64[2] q\nstring text")
        for time, angles in zip(TIME, ANGLES, strict=True):
            content = {"q": angles.tolist(), "text": "a"}
            writer.write_message("/q", schema, content, int(1e9 * time))
        writer.finish()


WRITERS = {
    "a.bag": write_bag,
    "a.mcap": write_mcap,
    "a.csv": write_text,
    "a.mat": lambda path: savemat(path, {"rec": {"t": TIME, "q": ANGLES.T}}),
    "a.h5": write_hdf5,
    "a.npz": lambda path: np.savez(path, t=TIME, q=ANGLES),
    "a.parquet": write_parquet,
    "a.tdms": write_tdms,
}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.filterwarnings("ignore")  # of libraries, over what is damaged
def test_damage_is_refused_or_passed_over(tmp_path, name):
    path = tmp_path / name
    WRITERS[name](path)
    content, rng = path.read_bytes(), np.random.default_rng(7)
    for _ in range(40):
        path.write_bytes(mutated_bytes(content, rng))
        message = read_through(path)
        assert "\n" not in message
        assert not message or str(path) in message


def read_through(path):
    """Return the error over a file, nothing if it can be read."""
    try:
        with open_log(path) as log:
            for table in log.tables:
                for channel in table.channels:
                    table.values(channel)
                table_clock(log, table, TimeChoice())
    except InvalidInput as error:
        return str(error)
    return ""
