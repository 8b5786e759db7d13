from collections.abc import Mapping
from dataclasses import dataclass

import h5py
import numpy as np
import pytest

from oed.study.stages.serialisation import ARRAY, read_dataclass, write_dataclass
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
    with pytest.raises(InvalidInput, match=r"y\.h5: not a stored Outer \(inner is missing\)"):
        read_dataclass(tmp_path / "y.h5", Outer)


def test_arrays(tmp_path):
    ARRAY.save(np.array([[0.1, 0.2]]), tmp_path)
    np.testing.assert_array_equal(ARRAY.load(tmp_path), [[0.1, 0.2]])


@pytest.mark.parametrize("name", ["inner", "there"])
def test_a_group_without_a_dataclass_in_its_place_is_refused(name, tmp_path):
    write_dataclass(tmp_path / "result.h5", example())
    with h5py.File(tmp_path / "result.h5", "r+") as file:
        del file[name]
        file.create_group(name)
    with pytest.raises(InvalidInput, match="not a stored Outer"):
        read_dataclass(tmp_path / "result.h5", Outer)
