"""Logs of every container that needs no optional library, each written by another library."""

import csv
import math

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from robotmodels.common.errors import InvalidInput
from robotmodels.logs import text_log
from robotmodels.logs.clocks import table_clock
from robotmodels.logs.mapping_file import TimeChoice
from robotmodels.logs.open_log import open_log
from robotmodels.logs.text_dialect import parse_stamp

TIME = np.arange(60) * 0.004
VALUES = np.stack([np.sin(3 * TIME), 1e4 * np.cos(TIME), -TIME], axis=1)
NAMES = ["q1", "q2", "q3"]


def written(path, rows, delimiter, decimal=".", before=(), names=("t", *NAMES)):
    """Write rows as people's tools do."""
    lines = [*before, delimiter.join(names)] if names else list(before)
    lines += [delimiter.join(f"{x!r}".replace(".", decimal) for x in row) for row in rows.tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


ROWS = np.column_stack([TIME, VALUES])


@pytest.mark.parametrize(
    ("delimiter", "decimal"),
    [(",", "."), (";", ","), (";", "."), ("\t", ","), (" ", "."), ("|", ".")],
)
@pytest.mark.parametrize("before", [(), ("# made by a controller", "# 2024-01-01"), ("File;x", "")])
def test_text_of_any_delimiter(tmp_path, delimiter, decimal, before):
    path = written(tmp_path / "log.txt", ROWS, delimiter, decimal, before)
    with open_log(path) as log:
        (table,) = log.tables
        assert list(table.channels) == ["t", *NAMES]
        for name, values in zip(table.channels, ROWS.T, strict=True):
            assert np.array_equal(table.values(name), values)


def test_names_in_a_comment_and_units_in_names(tmp_path):
    path = written(tmp_path / "a.csv", ROWS, ",", names=("# t [s]", "q1 (deg)", "q2 [rad/s]", "q3"))
    with open_log(path) as log:
        channels = log.tables[0].channels
        assert {n: c.unit for n, c in channels.items()} == {
            "t": "s", "q1": "deg", "q2": "rad/s", "q3": ""
        }  # fmt: skip


def test_a_row_of_units_below_the_names(tmp_path):
    path = written(
        tmp_path / "a.csv", ROWS, ",", before=("t,a,b,c",), names=("s", "deg", "A", "Nm")
    )
    with open_log(path) as log:
        units = [channel.unit for channel in log.tables[0].channels.values()]
        assert units == ["s", "deg", "A", "Nm"]


def test_no_header_at_all(tmp_path):
    path = written(tmp_path / "a.csv", ROWS, ",", names=())
    with open_log(path) as log:
        assert list(log.tables[0].channels) == [f"column_{i}" for i in range(1, 5)]
        assert log.tables[0].rows == len(ROWS)


def test_gaps_text_columns_and_rubbish(tmp_path):
    """Empty cells are no numbers, a line that was cut off is dropped and said."""
    lines = ["t,state,q", "0,run,1.5", "0.1,run,", "0.2,stop,2.5", "0.3,sto"]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(lines))
    with open_log(path) as log:
        assert list(log.tables[0].channels) == ["t", "q"]
        q = log.tables[0].values("q")
        assert q[[0, 2]].tolist() == [1.5, 2.5]
        assert np.isnan(q[1])


def test_iso_stamps_become_seconds(tmp_path):
    path = tmp_path / "a.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file, quoting=csv.QUOTE_ALL)
        writer.writerow(["stamp", "q"])
        for k in range(20):
            writer.writerow([f"2024-05-01T12:00:{k // 10:02d}.{k % 10}00000000+02:00", k])
    with open_log(path) as log:
        table = log.tables[0]
        assert table.time == "stamp"
        assert np.diff(table.values("stamp")) == pytest.approx(0.1, abs=1e-6)
        assert table.values("stamp")[0] == pytest.approx(1714557600.0)


def test_utf16_and_latin_1(tmp_path):
    for encoding in ("utf-16", "cp1252"):
        text = "t;Größe\n" + "".join(f"{k};{k},5\n" for k in range(9))
        (tmp_path / "a.csv").write_bytes(text.encode(encoding))
        with open_log(tmp_path / "a.csv") as log:
            assert log.tables[0].values("Größe")[3] == 3.5


def test_reading_in_chunks_changes_nothing(tmp_path, monkeypatch):
    path = written(tmp_path / "a.csv", np.tile(ROWS, (20, 1)), ",")
    monkeypatch.setattr(text_log, "_CHUNK", 1000)
    with open_log(path) as log:
        table = log.tables[0]
        assert np.array_equal(table.values("q2"), np.tile(VALUES[:, 1], 20))
        assert np.array_equal(
            table.channels["q2"].read(333, 777), np.tile(VALUES[:, 1], 20)[333:777]
        )
        assert np.array_equal(np.concatenate(list(table.pieces("q1", 7))), table.values("q1"))


@pytest.mark.parametrize("first", [True, False], ids=["channels first", "channels last"])
def test_matlab_5_and_7_3_hdf5_and_npz(tmp_path, first):
    """Structs in structs; arrays beside one time are one table, short arrays are constants."""
    signals = VALUES.T if first else VALUES
    savemat(
        tmp_path / "a.mat", {"rec": {"t": TIME, "in": {"q": signals}}, "para": {"u": [1.0, 2.0]}}
    )
    np.savez(tmp_path / "a.npz", **{"rec.t": TIME, "rec.in.q": signals, "para.u": [1.0, 2.0]})
    for name, stored in (("a.h5", signals), ("b.mat", signals.T)):
        with h5py.File(tmp_path / name, "w", userblock_size=512 if name == "b.mat" else 0) as file:
            file["rec/t"], file["rec/in/q"], file["para/u"] = TIME, stored, [1.0, 2.0]
            file["rec/in/q"].attrs["units"] = "deg"
    head = b"MATLAB 7.3 MAT-file".ljust(512)
    with (tmp_path / "b.mat").open("r+b") as file:
        file.write(head)
    for name in ("a.mat", "a.npz", "a.h5", "b.mat"):
        with open_log(tmp_path / name) as log:
            for k in range(3):
                table, channel = log.table_of(f"rec.in.q[{k}]")
                assert np.array_equal(table.values(channel), VALUES[:, k]), name
                unit = "deg" if name in ("a.h5", "b.mat") else ""
                assert table.channels[channel].unit == unit
            assert log.constants["para.u"].tolist() == [1.0, 2.0]


def test_several_files_are_one_log(tmp_path):
    a = written(tmp_path / "a.csv", ROWS, ",")
    b = written(tmp_path / "b.csv", ROWS[:30], ",")
    with open_log([a, b]) as log:
        assert [(t.name, t.rows) for t in log.tables] == [("a", 60), ("b", 30)]
        assert log.table_of("b:q1")[0].rows == 30
        with pytest.raises(InvalidInput, match="'q1' is in several tables: 'a:q1', 'b:q1'"):
            log.table_of("q1")
        assert len(log.matching("a:q*")) == 3


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", "nothing but words\nand more\n", "no table of numbers"),
        ("a.csv", b"\x00\x01\x02" * 50, "not a text file"),
        ("a.mat", b"rubbish" * 40, "not a MATLAB file"),
        ("a.h5", b"rubbish" * 40, "not an HDF5 file"),
        ("a.npz", b"rubbish" * 40, "not a file of NumPy arrays"),
        ("a.xyz", "1,2\n", "no format that is read"),
    ],
)
def test_files_that_are_no_logs(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(InvalidInput, match=message) as error, open_log(path):
        pass
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    ("stamp", "seconds"),
    [
        ("2024-05-01T12:00:01.250Z", 1714564801.25),
        ("2024-05-01 12:00:01,250", 1714564801.25),
        ("2024-05-01T14:00:01.250000000+02:00", 1714564801.25),
        ("01.05.2024 12:00:01.25", 1714564801.25),
        ("2024/05/01 12:00:01:250", 1714564801.25),
        ("12:00:01.250", 43201.25),
        ("1:02", 3720.0),
        ("2024-13-01 12:00", np.nan),
        ("12.5", np.nan),
    ],
)
def test_dates_and_times_of_day(stamp, seconds):
    assert parse_stamp(stamp) == pytest.approx(seconds, abs=1e-6, nan_ok=True)


def test_two_rows_of_names(tmp_path):
    """Groups above joints, as spreadsheets have them."""
    path = tmp_path / "a.csv"
    rows = "".join(f"{k * 0.01:.2f};{k};{2 * k};{3 * k};{4 * k}\n" for k in range(30))
    path.write_text("t;Position;;Torque;\n;A1;A2;A1;A2\n" + rows)
    with open_log(path) as log:
        table = log.tables[0]
        assert list(table.channels) == ["t", "Position.A1", "Position.A2", "Torque.A1", "Torque.A2"]
        assert table.values("Torque.A2")[5] == 20


def test_patterns_with_numbers_in_braces(tmp_path):
    state = np.random.default_rng(1).random((40, 7))
    np.savez(tmp_path / "a.npz", **{"obs.state": state, "names": np.array([{}], dtype=object)})
    with open_log(tmp_path / "a.npz") as log:
        hits = log.matching("obs.state[{4..6}]")
        assert [name for _, name in hits] == ["obs.state[4]", "obs.state[5]", "obs.state[6]"]
        with pytest.raises(InvalidInput, match=r"obs\.state\[7\]' is missing"):
            log.matching("obs.state[{4..7}]")


@pytest.mark.parametrize(
    ("field", "label", "channel"),
    [("Data", "Name", "rec.Y.drive/q_1"), ("values", "label", "rec.Y.drive/q_1")],
)
def test_structs_of_scopes_are_named_by_their_labels(tmp_path, field, label, channel):
    """Of dSPACE and Simulink: names and units beside values, the time in a struct of its own."""
    scope = np.zeros((1, 2), dtype=[(label, object), (field, object), ("Unit", object)])
    for k in range(2):
        scope[0, k] = (f"drive/q_{k}", VALUES[:, k][None], ("rev", "N.m")[k])
    savemat(tmp_path / "a.mat", {"rec": {"X": {"Data": TIME, "Unit": "s"}, "Y": scope}})
    with open_log(tmp_path / "a.mat") as log:
        (table,) = log.tables
        assert list(table.channels) == ["rec.X.Data", "rec.Y.drive/q_0", channel]
        assert [signal.unit for signal in table.channels.values()] == ["s", "rev", "N.m"]
        assert table_clock(log, table, TimeChoice()).source == "stamps of 'rec.X.Data'"
        assert np.array_equal(table.values(channel), VALUES[:, 1])


def test_references_of_matlab_7_3(tmp_path):
    """Elements of cells and arrays of structs lie behind references."""
    path = tmp_path / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        group, hidden = file.create_group("rec"), file.create_group("#refs#")
        names = group.create_dataset("Name", (3, 1), dtype=h5py.ref_dtype)
        values = group.create_dataset("Data", (3, 1), dtype=h5py.ref_dtype)
        units = group.create_dataset("Unit", (3, 1), dtype=h5py.ref_dtype)
        text = np.array([[ord(c)] for c in "deg"], dtype=np.uint16)
        hidden.create_dataset("u", data=text).attrs["MATLAB_class"] = np.bytes_("char")
        cell = file.create_dataset("cell", (2, 1), dtype=h5py.ref_dtype)
        for k in range(3):
            text = np.array([[ord(c)] for c in NAMES[k]], dtype=np.uint16)
            names[k, 0] = hidden.create_dataset(f"n{k}", data=text).ref
            hidden[f"n{k}"].attrs["MATLAB_class"] = np.bytes_("char")
            units[k, 0] = hidden["u"].ref
            values[k, 0] = hidden.create_dataset(f"v{k}", data=VALUES[:, k][None]).ref
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
        cell[0, 0] = hidden.create_dataset("c", data=TIME[None]).ref
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(512))
    with open_log(path) as log:
        (table,) = log.tables
        assert list(table.channels) == ["cell(0)", "rec.q1", "rec.q2", "rec.q3"]
        assert np.array_equal(table.values("rec.q3"), VALUES[:, 2])
        assert table.channels["rec.q3"].unit == "deg"
        assert np.array_equal(table.values("cell(0)"), TIME)


def test_attributes_scalars_and_compounds_of_hdf5(tmp_path):
    """The rate of sampling stands in an attribute; rows hold lists of joints."""
    rows = np.zeros(60, dtype=[("stamp", "f8"), ("q", "f4", (3,))])
    rows["q"] = VALUES
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["rec"], file["mass"] = rows, 3.5
        file.attrs["sample_rate"] = 250
    with open_log(tmp_path / "a.h5") as log:
        (table,) = log.tables
        assert np.array_equal(table.values("rec.q[1]"), VALUES[:, 1].astype(np.float32))
        assert np.array_equal(table.channels["rec.q[2]"].read(5, 9), rows["q"][5:9, 2])
        assert log.constants["mass"] == [3.5]
        assert table_clock(log, table, TimeChoice()).sample_time == pytest.approx(0.004)


@pytest.mark.parametrize(
    ("seconds", "nanoseconds"),
    [("ZeitInSec", "ZeitInNanoSec"), ("stamp.sec", "stamp.nanosec"), ("t_seconds", "t_nanos")],
)
def test_stamps_in_two_channels(tmp_path, seconds, nanoseconds):
    stamps = 1_500_000_000_123_456_789 + np.round(TIME * 1e9).astype(int)
    names, lines = [seconds, nanoseconds, "q1"], []
    for stamp, value in zip(stamps, VALUES[:, 0], strict=True):
        lines.append(f"{stamp // 10**9} {stamp % 10**9} {value!r}")
    (tmp_path / "a.log").write_text("\n".join([" ".join(names), *lines]))
    with open_log(tmp_path / "a.log") as log:
        (table,) = log.tables
        clock = table_clock(log, table, TimeChoice())
        assert clock.source == f"stamps of '{seconds} + {nanoseconds}'"
        assert clock.sample_time == pytest.approx(0.004, rel=1e-6)
        assert clock.restarts == ()


def test_lists_in_rows_of_text(tmp_path):
    """As data frames write lists in quotation marks, and YARP in parentheses."""
    rows = list(zip(TIME.tolist(), VALUES.tolist(), strict=True))
    quoted = "".join(f'{t},"[{", ".join(map(repr, v))}]",on\n' for t, v in rows)
    bare = "".join(f"{k} ({' '.join(map(repr, v))}) [ok]\n" for k, (_, v) in enumerate(rows))
    (tmp_path / "a.csv").write_text("t,q,state\n" + quoted)
    (tmp_path / "b.log").write_text(bare)
    for name, channels in (("a.csv", ["q[0]", "q[2]"]), ("b.log", ["column_2", "column_4"])):
        with open_log(tmp_path / name) as log:
            for channel, column in zip(channels, (0, 2), strict=True):
                assert np.array_equal(log.tables[0].values(channel), VALUES[:, column]), name


def test_rows_of_several_clocks_in_one_table(tmp_path):
    """As tools write that plot topics: a row a message, cells of other topics empty."""
    fast, slow = np.arange(200) * 0.004, np.arange(40) * 0.02 + 0.001
    rows = [(t, f"{t!r},{math.sin(t)!r},,") for t in fast.tolist()]
    rows += [(t, f"{t!r},,{math.cos(t)!r},{2 * t!r}") for t in slow.tolist()]
    lines = ["__time,/joints/a/position,/tool/x,/tool/y", *(line for _, line in sorted(rows))]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    with open_log(tmp_path / "a.csv") as log:
        joints, tool = log.tables
        assert (joints.name, tool.name) == ("", "part_2")
        assert joints.values("/joints/a/position") == pytest.approx(np.sin(fast), rel=1e-15)
        assert tool.channels["/tool/x"].read(3, 9) == pytest.approx(np.cos(slow[3:9]), rel=1e-15)
        assert np.array_equal(tool.values("/tool/y"), 2 * slow)
        steps = [table_clock(log, table, TimeChoice()).sample_time for table in log.tables]
        assert steps == pytest.approx([0.004, 0.02])


@pytest.mark.parametrize("number", ["{:+.17e}", "  {:.17g} ", "{:.17g}"])
@pytest.mark.parametrize("arrow", [True, False])
def test_numbers_are_read_to_their_last_bit(tmp_path, monkeypatch, number, arrow):
    """By each parser, with signs and spaces as programs write them."""
    if not arrow:
        monkeypatch.setattr(text_log, "find_spec", lambda name: None)
    values = np.random.default_rng(3).standard_normal((50, 2)) * [1e-7, 1e9]
    rows = [f"{k}," + ",".join(number.format(x) for x in row) for k, row in enumerate(values)]
    (tmp_path / "a.csv").write_text("\n".join(["t,a,b", *rows]))
    monkeypatch.setattr(text_log.Dialect, "number", None)  # the slow path is not taken
    with open_log(tmp_path / "a.csv") as log:
        for name, column in zip("ab", values.T, strict=True):
            assert np.array_equal(log.tables[0].values(name), column)
