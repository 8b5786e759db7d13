from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from robotmodels import InvalidInput, Records, iterate_records, save_records

Q, B, E, P, N, n = 3, 2, 2, 2, 16, 2


def some_records() -> Records:
    rng = np.random.default_rng(3)
    shape = (Q, B, E, P, N, n)
    return Records(
        positions=rng.normal(size=(Q, n)),
        sample_time=0.01,
        reference=rng.normal(size=(Q, B, E, 1, N, n)),
        torque=rng.normal(size=shape),
        angle=rng.normal(size=(*shape[:-1], 3)),
        lines=np.array([1, 5, 7]),
        detection=np.array([3]),
        saturated=rng.random((Q, B, E, P, n)) < 0.5,
    )


def assert_same(a: Records, b: Records) -> None:
    for name in ("positions", "reference", "torque", "angle", "lines", "detection", "saturated"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert a.sample_time == b.sample_time


def test_frequencies() -> None:
    np.testing.assert_allclose(some_records().omega, 2 * np.pi * np.array([1, 5, 7]) / 0.16)


def test_positions_are_parted_and_joined() -> None:
    records = some_records()
    assert_same(Records.join([records.at(0), records.at(1), records.at(-1)]), records)
    np.testing.assert_array_equal(records.at(-1).torque, records.torque[2:])


def test_arrays_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        some_records().torque[0] = 0.0


def test_a_file_gives_back_what_was_saved(tmp_path: Path) -> None:
    records = some_records()
    records.save(tmp_path / "whole.h5")
    assert_same(Records.load(tmp_path / "whole.h5"), records)
    parts = (records.at(i) for i in range(Q))
    assert save_records(tmp_path / "parts.h5", parts) == Q
    assert_same(Records.load(tmp_path / "parts.h5"), records)
    assert [len(part) for part in iterate_records(tmp_path / "parts.h5")] == [1, 1, 1]


def test_the_layout_of_the_file(tmp_path: Path) -> None:
    records = some_records()
    records.save(tmp_path / "r.h5")
    with h5py.File(tmp_path / "r.h5") as file:
        assert file.attrs["schema"] == "records/1"
        assert file.attrs["sample_time"] == 0.01
        np.testing.assert_array_equal(file["position_00002/torque"][()], records.torque[2])
        np.testing.assert_array_equal(file["position_00001/position"][()], records.positions[1])


def test_an_interrupted_save_leaves_nothing(tmp_path: Path) -> None:
    def parts():  # type: ignore[no-untyped-def]
        yield some_records().at(0)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        save_records(tmp_path / "r.h5", parts())
    assert not list(tmp_path.iterdir())


def test_a_whole_experiment_may_be_missing(tmp_path: Path) -> None:
    records = some_records()
    torque, angle = records.torque.copy(), records.angle.copy()
    torque[1, 0, 1] = angle[1, 0, 1] = np.nan
    gap = replace(records, torque=torque, angle=angle)
    assert np.argwhere(gap.missing).tolist() == [[1, 0, 1]]
    gap.save(tmp_path / "r.h5")
    assert_same(Records.load(tmp_path / "r.h5"), gap)


@pytest.mark.parametrize("signal", ["torque", "angle"])
def test_part_of_an_experiment_may_not(signal: str) -> None:
    records = some_records()
    broken = getattr(records, signal).copy()
    broken[2, 1, 0, 1, 4, 1] = np.nan
    where = f"{signal}: .* position 2, block 1, run 0, period 1, sample 4, motor 1"
    with pytest.raises(InvalidInput, match=where):
        replace(records, **{signal: broken})
    broken[2, 1, 0] = np.nan  # all of one signal, nothing of the other
    with pytest.raises(InvalidInput, match=f"{signal}: .*torque and angle alike"):
        replace(records, **{signal: broken})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sample_time": 0.0}, r"sample_time \[s\]: 0.0"),
        ({"torque": np.zeros((2, 3))}, "torque: shape"),
        ({"positions": np.zeros((2, n))}, r"positions: shape \(2, 2\)"),
        ({"reference": np.zeros((Q, B, E, P, N - 1, n))}, "reference: shape .* is needed"),
        ({"angle": np.zeros((Q, B, E, 1, N, n))}, "angle: shape"),
        ({"saturated": np.zeros((Q, B, E, P, N, n))}, "saturated: shape"),
        ({"lines": np.array([0, 1])}, "lines: .* between 1 and 7"),
        ({"lines": np.array([5, 1])}, "lines: .* must increase"),
        ({"lines": np.array([1, 8])}, "lines"),
        ({"lines": np.array([], dtype=int)}, "lines: none"),
        ({"detection": np.array([5])}, "detection: line 5"),
        ({"reference": np.full((Q, B, E, 1, N, n), np.inf)}, "reference: not a finite number"),
        ({"positions": np.full((Q, n), np.nan)}, "positions: .* position 0, motor 0"),
    ],
)
def test_what_does_not_fit_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        replace(some_records(), **change)


def test_unlike_records_are_not_joined(tmp_path: Path) -> None:
    records = some_records()
    first = records.at(0)
    others = {
        "sample time": replace(first, sample_time=0.02),
        "lines": replace(first, lines=np.array([1, 7])),
        "reference": replace(
            first,
            torque=first.torque[:, :1],
            angle=first.angle[:, :1],
            reference=first.reference[:, :1],
            saturated=first.saturated[:, :1],
        ),
    }
    for what, other in others.items():
        with pytest.raises(InvalidInput, match=f"records 1: .*{what}"):
            Records.join([first, other])
        with pytest.raises(InvalidInput, match=what):
            save_records(tmp_path / "r.h5", [first, other])
    with pytest.raises(InvalidInput, match="nothing to join"):
        Records.join([])
    with pytest.raises(InvalidInput, match="no records to write"):
        save_records(tmp_path / "r.h5", [])
    assert not list(tmp_path.iterdir())


def test_files_at_fault_are_named(tmp_path: Path) -> None:
    path = tmp_path / "r.h5"
    with pytest.raises(InvalidInput, match=r"r\.h5: no such file"):
        Records.load(path)
    path.write_text("no HDF5")
    with pytest.raises(InvalidInput, match=r"r\.h5: not an HDF5 file"):
        Records.load(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f.attrs.pop("schema"), "'schema' is None"),
        (lambda f: f.attrs.pop("sample_time"), "'sample_time'"),
        (lambda f: f.pop("lines"), "'lines' is missing"),
        (lambda f: f.pop("position_00001"), "'position_00001' is missing"),
        (lambda f: f.pop("position_00002/angle"), "position_00002: 'angle' is missing"),
        (lambda f: f["position_00000/torque"].write_direct(
            np.full((B, E, P, N, n), np.inf)), "position_00000: torque"),
    ],
)  # fmt: skip
def test_files_with_holes(tmp_path: Path, change, message: str) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "r.h5"
    some_records().save(path)
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(InvalidInput, match=message):
        Records.load(path)
