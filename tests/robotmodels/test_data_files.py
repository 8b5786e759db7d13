"""Guards of containers and schemas of arrays, by what each must refuse."""

import os
import struct
from contextlib import suppress
from dataclasses import replace

import h5py
import numpy as np
import pytest
from scipy.io import loadmat, savemat

from estimators import read_records, write_records
from robotmodels import InvalidInput, Records
from robotmodels.data_files.json_text import parse_json


def records(**changes) -> Records:
    rng = np.random.default_rng(0)
    shape = (1, 1, 2, 2, 24, 2)
    return replace(
        Records(
            positions=rng.normal(size=(1, 2)),
            sample_time=0.01,
            reference=rng.normal(size=(1, 1, 2, 1, 24, 2)),
            torque=rng.normal(size=shape),
            angle=rng.normal(size=shape),
            lines=np.array([5, 9]),
            detection=np.array([7]),
            saturated=np.zeros((1, 1, 2, 2, 2), bool),
        ),
        **changes,
    )


def refused(path, said):
    with pytest.raises(InvalidInput, match=said) as caught:
        read_records(path)
    assert path.name in str(caught.value)
    assert "\n" not in str(caught.value)


def replaced(file, name, value):
    del file[name]
    file[name] = value


TORQUE = "position_00000/torque"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda f: replaced(f, "lines", [5.9, 9.9]), r"lines: 5.9\d* at 0 .*; whole numbers"),
        (lambda f: replaced(f, "lines", "text"), "lines: text; whole numbers of shape .* needed"),
        (lambda f: replaced(f, "lines", np.array([b"a"])), "lines: text; whole numbers"),
        (lambda f: replaced(f, "lines", [5 + 1j, 9]), "lines: complex numbers; whole numbers"),
        (lambda f: replaced(f, "lines", [True]), "lines: truth values; whole numbers"),
        (lambda f: replaced(f, "lines", 2**62), r"lines: shape \(\); .*\(line,\) are needed"),
        (lambda f: (f.pop(TORQUE), f.create_group(TORQUE)), "torque: a group; real numbers"),
        (lambda f: replaced(f, TORQUE, np.zeros((1, 2, 2, 24, 3))), "of 3 for|has 3"),
        (lambda f: replaced(f, TORQUE, h5py.Empty("f8")), "torque: nothing; real numbers"),
        (lambda f: f.create_dataset("torque_0", data=1.0), "'torque_0' is unknown"),
        (lambda f: f.attrs.create("sample_time", [0.1, 0.2]), r"sample_time: shape \(2,\); one"),
        (lambda f: f.attrs.create("sample_time", "0.1"), "sample_time: text; one real number"),
        (lambda f: f.attrs.create("sample_time", np.nan), "sample_time: nan; a finite number"),
        (lambda f: f.attrs.create("schema", 1.0), "'schema' is '1.0'"),
        (lambda f: f.move("position_00000", "position_00001"), "'position_00000' is missing"),
        (lambda f: f.pop("position_00000"), "'position_00000' is missing"),
    ],
)  # fmt: skip
def test_hdf5_of_other_types_shapes_and_names(tmp_path, change, said):
    path = tmp_path / "r.h5"
    write_records(path, records())
    with h5py.File(path, "r+") as file:
        change(file)
    refused(path, said)


def test_notes_may_be_attributes(tmp_path):
    path = tmp_path / "r.h5"
    write_records(path, records())
    with h5py.File(path, "r+") as file:
        file.attrs["operator"] = "K. Meyer"
    assert read_records(path).lines.tolist() == [5, 9]


def test_arrays_that_only_claim_their_size(tmp_path):
    path = tmp_path / "r.h5"
    write_records(path, records())
    with h5py.File(path, "r+") as file:
        del file[TORQUE]
        file.create_dataset(TORQUE, shape=(1, 2, 2, 6 * 10**9, 1), dtype="f8")
    refused(path, "shape .* the file holds at most 0 values of it; .* never written")


@pytest.mark.parametrize("kind", ["external link", "soft link", "virtual", "external values"])
def test_hdf5_that_leads_to_other_files(tmp_path, kind):
    path, secret = tmp_path / "r.h5", tmp_path / "secret.h5"
    write_records(path, records())
    with h5py.File(secret, "w") as file:
        file["x"] = [5.0, 9.0]
    with h5py.File(path, "r+") as file:
        del file["lines"]
        if kind == "external link":
            file["lines"] = h5py.ExternalLink(str(secret), "/x")
        elif kind == "soft link":
            file["lines"] = h5py.SoftLink("/detection")
        elif kind == "virtual":
            layout = h5py.VirtualLayout(shape=(2,), dtype="f8")
            layout[:] = h5py.VirtualSource(str(secret), "x", shape=(2,))
            file.create_virtual_dataset("lines", layout)
        else:
            file.create_dataset("lines", (2,), "f8", external=[(str(secret), 0, 16)])
    refused(path, "'lines' is a link to|lines: its values are in another file")


def test_hdf5_cut_off(tmp_path):
    path = tmp_path / "r.h5"
    write_records(path, records())
    content = path.read_bytes()
    for size in (0, 5, 100, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:size])
        refused(path, "not an? (sound )?HDF5 file")


@pytest.mark.parametrize("damage", ["no size", "all of 64 bits", "longer", "elsewhere"])
def test_heaps_over_which_hdf5_does_not_end(tmp_path, damage):
    path = tmp_path / "r.h5"
    write_records(path, records())
    content = bytearray(path.read_bytes())
    heap = content.index(b"GCOL")
    reference = content.index(struct.pack("<IQI", len("records/1"), heap, 1))
    if damage in ("longer", "elsewhere"):
        place = heap if damage == "longer" else 5
        content[reference : reference + 16] = struct.pack("<IQI", 2**31, place, 1)
    else:
        size = 0 if damage == "no size" else 2**64 - 16
        index = 0 if damage == "no size" else 1
        content[heap + 16 : heap + 32] = struct.pack("<HH4xQ", index, 1, size)
    path.write_bytes(content)
    refused(path, "not a sound HDF5 file")


@pytest.mark.parametrize("userblock", [0, 512])
def test_heaps_of_other_things_than_text(tmp_path, userblock):
    """Region references lie in the same heaps and give no length."""
    path, original = tmp_path / "r.h5", tmp_path / "o.h5"
    write_records(original, records())
    with h5py.File(path, "w", userblock_size=userblock) as file, h5py.File(original) as other:
        for name in other:
            other.copy(name, file)
        file.attrs.update(other.attrs)
        values = file["position_00000/torque"]
        regions = np.array([values.regionref[0, 0] for _ in range(300)], h5py.regionref_dtype)
        file["position_00000/torque"].attrs["regions"] = regions
    np.testing.assert_array_equal(read_records(path).torque, records().torque)


def changed_mat(path, **changes):
    write_records(path, records())
    contents = {k: v for k, v in loadmat(path).items() if k[0] != "_"}
    savemat(path, {k: v for k, v in (contents | changes).items() if v is not None})


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"schema": np.array([["records/1"]], dtype=object)}, "schema: a cell array; text"),
        ({"schema": {"a": 1}}, "schema: a struct; text"),
        ({"schema": ["records/1", "again"]}, "schema: 2 lines of text; one is needed"),
        ({"sample_time": [0.01, 0.02]}, r"sample_time: shape \(1, 2\); one real number"),
        ({"sample_time": "0.01"}, "sample_time: text; one real number"),
        ({"sample_time": 0.01 + 1j}, "sample_time: complex numbers; real numbers"),
        ({"lines": [5.9, 9.9]}, "lines: 5.9.*; whole numbers are needed"),
        ({"lines": [[5.0, 9.0], [3.0, 7.0]]}, r"lines: shape \(2, 2\); whole numbers"),
        ({"saturated": np.full((1, 1, 2, 2, 2), 0.5)}, "saturated: 0.5; true and false"),
        ({"torque": {"a": 1}}, "torque: a struct; real numbers"),
        ({"torque_0": 1.0}, "'torque_0' is unknown"),
        ({"torque": None}, "'torque' is missing"),
    ],
)
def test_mat_of_other_types_shapes_and_names(tmp_path, changes, said):
    changed_mat(tmp_path / "r.mat", **changes)
    refused(tmp_path / "r.mat", said)


def test_mat_with_one_bit_flipped(tmp_path):
    path = tmp_path / "r.mat"
    write_records(path, records())
    content, taken = path.read_bytes(), []
    for place in range(128, len(content), len(content) // 60):
        path.write_bytes(content[:place] + bytes([content[place] ^ 8]) + content[place + 1 :])
        with suppress(InvalidInput):
            read_records(path)
            taken.append(place)
    assert len(taken) < 10  # what is compressed has checksums


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("torque_1", "torque_0", "column 'torque_0' is there twice"),
        ("torque_1", "moment_1", "column 'moment_1' is unknown"),
        ("[5, 9]", "[5.9, 9.9]", "lines: 5.9"),
        ("[5, 9]", '"5, 9"', "lines: text; whole numbers"),
        ("[5, 9]", "[5, [9]]", "lines: a mixture of types"),
        ("[5, 9]", "[true, 9]", "lines: a mixture of types"),
        ("[5, 9]", "[NaN, 9]", "comment 'lines': NaN is no number of JSON"),
        ("[5, 9]", "[" * 5000, "comment 'lines': not valid JSON"),
        ("[5, 9]", f"[{'9' * 400}, 9]", "lines: .*too large"),
        ("sample_time: 0.01", "sample_time: [0.01]", r"sample_time: shape \(1,\); one real number"),
        ("# sample_time", "# lines: [5]\n# sample_time", "'# lines: ...' is given twice"),
        ("axes: [1, 1, 2, 2, 24, 1]", "axes: [1, 1, 2, 2, 1e300, 1]", "axes: 1.*e\\+300.*whole"),
        ("axes: [1, 1, 2, 2, 24, 1]", "axes: [1, 1, 2, 2, 9007199254740992, 1]", "96 rows; "),
        ("axes: [1, 1, 2, 2, 24, 1]", "axes: [1, 1, 2, 2, 24]", "axes: 5 numbers; 6 are needed"),
    ],
)
def test_csv_of_other_columns_and_comments(tmp_path, old, new, said):
    path = tmp_path / "r.csv"
    write_records(path, records())
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    refused(path, said)


def test_columns_are_told_by_name_not_by_place(tmp_path):
    path = tmp_path / "r.csv"
    write_records(path, records())
    text = path.read_text()
    path.write_text(text.replace("torque_0,torque_1", "torque_1,torque_0"))
    assert np.array_equal(read_records(path).torque, records().torque[..., ::-1])


@pytest.mark.parametrize("suffix", [".h5", ".mat", ".csv"])
def test_devices_pipes_folders_and_nul(tmp_path, suffix):
    os.mkfifo(tmp_path / f"pipe{suffix}")
    refused(tmp_path / f"pipe{suffix}", "device or a pipe")
    (tmp_path / f"zero{suffix}").symlink_to("/dev/zero")
    refused(tmp_path / f"zero{suffix}", "device or a pipe")
    (tmp_path / f"folder{suffix}").mkdir()
    refused(tmp_path / f"folder{suffix}", "folder")
    with pytest.raises(InvalidInput, match="null"):
        read_records(tmp_path / f"a\0{suffix}")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"lines": [5.9, 9.9]}, "lines: 5.9"),
        ({"lines": np.array(["5", "9"])}, "lines: an array of real numbers"),
        ({"torque": np.ones((1, 1, 2, 2, 24, 2)) * 1j}, "torque: an array of real numbers"),
        ({"torque": [[1.0], [1.0, 2.0]]}, "torque: an array of real numbers"),
        ({"saturated": np.full((1, 1, 2, 2, 2), 0.3)}, "saturated: 0.3"),
    ],
)
def test_arrays_in_memory_are_not_cut_either(changes, said):
    with pytest.raises(InvalidInput, match=said):
        records(**changes)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"a": 1, "a": 2}', "a.json: key 'a' is given twice"),
        ("[NaN]", "a.json: NaN is no number"),
        ("[" * 100_000, "a.json: not valid JSON"),
        ("9" * 5000, "a.json: not valid JSON"),
        (b"\xff", "a.json: not valid JSON"),
    ],
)
def test_json_is_what_the_standard_says(text, said):
    with pytest.raises(InvalidInput, match=said):
        parse_json(text, "a.json")
