from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, get_origin

import h5py
import numpy as np
import pytest

from robotmodels.common.arrays import Array, BoolArray, ComplexArray, IntArray
from robotmodels.common.dataclass_files import read_dataclass, write_dataclass
from robotmodels.common.errors import InvalidInput


@dataclass(frozen=True, eq=False)
class Inner:
    values: np.ndarray
    name: str


@dataclass(frozen=True, eq=False)
class Outer:
    inner: Inner
    absent: Inner | None
    there: Inner | None
    matrices: tuple[np.ndarray, ...]
    none: tuple[np.ndarray, ...]
    inners: tuple[Inner, ...]
    words: tuple[str, ...]
    numbers: Mapping[str, float]
    real: float
    count: int
    yes: bool
    response: np.ndarray
    flags: np.ndarray


def example():
    rng = np.random.default_rng(1)
    inner = Inner(rng.standard_normal((2, 3)), "a")
    return Outer(
        inner,
        None,
        Inner(np.arange(3), "ü"),
        tuple(rng.standard_normal((2, i)) for i in range(1, 13)),
        (),
        tuple(Inner(np.array(float(i)), str(i)) for i in range(3)),
        ("x", "y"),
        {"b": np.float64(0.1), "a": np.inf},
        float(np.nextafter(1, 2)),
        np.int64(3),
        True,
        rng.standard_normal(4) + 1j,
        np.array([True, False]),
    )


def test_a_dataclass_comes_back_bit_for_bit(tmp_path):
    wrote = example()
    write_dataclass(tmp_path / "x.h5", wrote)
    read = read_dataclass(tmp_path / "x.h5", Outer)
    assert read.absent is None
    assert (read.inner.name, read.there.name) == ("a", "ü")
    assert read.words == ("x", "y")
    assert read.numbers == {"b": 0.1, "a": np.inf}
    assert (read.real, read.count, read.yes) == (np.nextafter(1, 2), 3, True)
    assert read.none == ()
    assert [(float(one.values), one.name) for one in read.inners] == [(0, "0"), (1, "1"), (2, "2")]
    pairs = [
        (read.inner.values, wrote.inner.values),
        (read.there.values, wrote.there.values),
        (read.response, wrote.response),
        (read.flags, wrote.flags),
        *zip(read.matrices, wrote.matrices, strict=True),
    ]
    for a, b in pairs:
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)
        assert not a.flags.writeable


def test_another_file_is_refused_by_name(tmp_path):
    (tmp_path / "x.h5").write_text("no")
    with pytest.raises(InvalidInput, match=r"x\.h5: not a stored Outer"):
        read_dataclass(tmp_path / "x.h5", Outer)
    write_dataclass(tmp_path / "y.h5", Inner(np.zeros(2), "a"))
    with pytest.raises(InvalidInput, match=r"y\.h5: not a stored Outer \(the file is a Inner\)"):
        read_dataclass(tmp_path / "y.h5", Outer)


def replaced(path, name, value):
    """Put something else in the place of a dataset."""
    with h5py.File(path, "r+") as file:
        del file[name]
        if value is not None:
            file[name] = value


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("response", np.zeros(4)),
        ("response", np.array([b"a"] * 4)),
        ("response", h5py.Empty("f8")),
        ("response", None),
        ("flags", np.array([1, 0])),
        ("flags", np.array([1.0, 0.0])),
        ("flags", True),
        ("flags", np.array([[True, False]])),
        ("flags", np.array([True, True])),
        ("matrices/00003", np.zeros((3, 4))),
        ("matrices/00003", np.array([[b"a"] * 4] * 2)),
        ("inner/values", "text"),
        ("plain data", "[" * 100_000),
        ("plain data", "null"),
        ("plain data", None),
    ],
)
def test_an_array_that_was_changed_is_refused(name, value, tmp_path):
    write_dataclass(tmp_path / "result.h5", example())
    replaced(tmp_path / "result.h5", name, value)
    with pytest.raises(InvalidInput, match=r"result\.h5: not a stored Outer"):
        read_dataclass(tmp_path / "result.h5", Outer)


def test_an_array_too_large_for_memory_is_refused_unread(tmp_path):
    write_dataclass(tmp_path / "result.h5", example())
    with h5py.File(tmp_path / "result.h5", "r+") as file:
        del file["response"]
        file.create_dataset("response", shape=(10**14,), dtype=complex, chunks=(1000,))
    with pytest.raises(InvalidInput, match="response is not the array that was written"):
        read_dataclass(tmp_path / "result.h5", Outer)


@dataclass(frozen=True, eq=False)
class Real:
    value: np.ndarray | None
    whole: IntArray
    real: Array
    pair: tuple[str, float]
    kind: Literal["a", "b"]
    either: Inner | float


REAL = Real(None, np.array([1]), np.array([0.5]), ("x", 1.0), "a", 2.0)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("whole", np.array([1.5]), "whole is no array of int64"),
        ("whole", [1], "whole is not the array that was written"),
        ("real", np.array([1j]), "real is no array of float64"),
        ("real", np.array(["text"], dtype="S4"), "real is no array of float64"),
        ("real", 1.5, "real is not the array that was written"),
        ("pair", ("x",), "not a stored Real"),
        ("pair", ("x", "y"), "pair/00001 is no float"),
        ("pair", ("x", True), "pair/00001 is no float"),
        ("kind", "c", "kind is no "),
        ("either", "text", "either is no float"),
        ("either", None, "either is no float"),
    ],
)
def test_a_field_of_another_type_is_refused_by_name(field, value, message, tmp_path):
    """Also in a file that is as it was written, by another form of the package, say."""
    write_dataclass(tmp_path / "x.h5", replace(REAL, **{field: value}))
    with pytest.raises(InvalidInput, match=message):
        read_dataclass(tmp_path / "x.h5", Real)


@pytest.mark.parametrize("either", [Inner(np.zeros(2), "a"), 3.0])
def test_one_of_several_types(either, tmp_path):
    write_dataclass(tmp_path / "x.h5", replace(REAL, either=either))
    assert type(read_dataclass(tmp_path / "x.h5", Real).either) is type(either)


def test_words_that_were_changed_are_refused(tmp_path):
    write_dataclass(tmp_path / "x.h5", example())
    with h5py.File(tmp_path / "x.h5", "r+") as file:
        words = file["plain data"].asstr()[()].replace('["x", "y"]', '["x", "z"]')
        del file["plain data"]
        file["plain data"] = words
    with pytest.raises(InvalidInput, match="its content is not what was written"):
        read_dataclass(tmp_path / "x.h5", Outer)


@pytest.mark.parametrize("name", ["inner", "there"])
def test_a_group_without_a_dataclass_in_its_place_is_refused(name, tmp_path):
    write_dataclass(tmp_path / "result.h5", example())
    with h5py.File(tmp_path / "result.h5", "r+") as file:
        del file[name]
        file.create_group(name)
    with pytest.raises(InvalidInput, match="not a stored Outer"):
        read_dataclass(tmp_path / "result.h5", Outer)


@pytest.mark.parametrize("kind", [Array, ComplexArray, IntArray, BoolArray])
def test_types_of_arrays_are_those_of_numpy_in_every_version(kind):
    """`numpy.typing.NDArray` is an alias of its own in numpy 2.5."""
    assert get_origin(kind) is np.ndarray
