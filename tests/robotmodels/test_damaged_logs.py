"""Damaged logs are refused in one line, or read as far as they can be, never with a traceback."""

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from file_mutations import mutated_bytes
from nptdms import ChannelObject, TdmsWriter
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


WRITERS = {
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
