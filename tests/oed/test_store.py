import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from random_candidates import random_set

from oed import Constraints, InformationSet, information, optimal_design
from oed.information_sets.stored_information import StoredInformation, write_store
from robotmodels import InvalidInput, NotIdentifiable, RelativeNoise, load_robot

INFO = random_set(4, 3000, 6, 4)


@pytest.fixture
def stored(tmp_path, monkeypatch):
    monkeypatch.setattr(
        "oed.information_sets.stored_information._CHUNK_BYTES", 20_000
    )  # many chunks, the last one cut
    parts = np.array_split(INFO.matrices, 7)
    return write_store(tmp_path / "info.oed", INFO.positions, INFO.names, parts)


def test_a_store_holds_the_same_as_memory(stored):
    rng = np.random.default_rng(0)
    W = rng.standard_normal((6, 6))
    W = W @ W.T
    assert (len(stored), stored.names, stored.samples, stored.rank) == (3000, INFO.names, 1, 6)
    np.testing.assert_array_equal(stored.positions, INFO.positions)
    np.testing.assert_allclose(stored.matrices, INFO.matrices, rtol=1e-15)
    np.testing.assert_allclose(
        stored.directional_derivatives(W), INFO.directional_derivatives(W), rtol=1e-12
    )
    np.testing.assert_allclose(stored.total, INFO.total, rtol=1e-12)
    some = np.array([7, 2999, 7, 0])
    np.testing.assert_array_equal(stored.take(some), INFO.take(some))
    for weights in (np.ones(3000), rng.random(3000), np.eye(3000)[5]):
        np.testing.assert_allclose(stored.combined(weights), INFO.combined(weights), rtol=1e-11)


@pytest.mark.parametrize("constraints", [None, Constraints(experiments=10, most=0.5)])
@pytest.mark.parametrize("criterion", ["D", "A"])
def test_designs_from_a_store(stored, criterion, constraints):
    here = optimal_design(INFO, criterion, constraints, solver="newton")
    there = optimal_design(stored, criterion, constraints, solver="newton")
    assert there.value == pytest.approx(here.value, rel=1e-9)
    np.testing.assert_allclose(there.weights, here.weights, atol=1e-6)
    assert there.gap <= 1e-6


def test_what_no_stored_candidate_identifies_is_named(tmp_path):
    matrices = random_set(4, 30, 3, 2).matrices.copy()
    matrices[:, 1] = matrices[:, :, 1] = 0.0
    store = write_store(tmp_path / "open.oed", INFO.positions[:30], ("a", "b", "c"), [matrices])
    assert store.unidentifiable() == ("b",)
    with pytest.raises(NotIdentifiable, match="not identifiable: b;"):
        optimal_design(store)


def test_information_streams_into_a_store(tmp_path):
    robot = load_robot("moberg_axis1")
    positions = np.zeros((5, 1))
    omega, noise = 2 * np.pi * np.linspace(2, 30, 8), RelativeNoise()
    here = information(robot, positions, omega, noise)
    calls = []
    with ThreadPoolExecutor(1) as executor:
        there = information(
            robot,
            positions,
            omega,
            noise,
            chunk=2,
            executor=executor,
            progress=lambda done, total: calls.append((done, total)),
            store=tmp_path / "axis.oed",
        )
    assert isinstance(there, StoredInformation)
    assert calls == [(2, 5), (4, 5), (5, 5)]
    np.testing.assert_allclose(there.matrices, here.matrices, rtol=1e-12)
    again = InformationSet.open(tmp_path / "axis.oed")
    np.testing.assert_array_equal(again.matrices, there.matrices)


def test_a_pass_gives_its_pages_back(tmp_path):
    """68 MB are read while the process grows by the map of a chunk only."""
    parts = (np.broadcast_to(np.eye(26), (2500, 26, 26)) for _ in range(10))
    store = write_store(
        tmp_path / "large.oed", np.zeros((25000, 1)), [f"k{i}" for i in range(26)], parts
    )
    resident, iterator = [], store._parts()
    for _, part in iterator:
        part.sum()
        resident.append(int(Path("/proc/self/statm").read_text().split()[1]) * 4096)
    assert store.path.stat().st_size > 68e6
    assert max(resident) - min(resident) < 30e6


def test_an_interrupted_store_leaves_no_file(tmp_path):
    def broken():
        yield INFO.matrices[:10]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_store(tmp_path / "half.oed", INFO.positions, INFO.names, broken())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda H: np.where(np.arange(10)[:, None, None] == 4, np.nan, H),
            "candidate 14 has a mat",
        ),
        (lambda H: -H, r"candidate 10 has a matrix that is not positive semidefinite \(10 of 10"),
        (lambda H: H[:4], "14 matrices for 20 positions"),
    ],
)
def test_bad_matrices_name_the_candidate(tmp_path, change, message):
    parts = [INFO.matrices[:10], change(INFO.matrices[10:20])]
    with pytest.raises(InvalidInput, match=message):
        write_store(tmp_path / "bad.oed", INFO.positions[:20], INFO.names, parts)
    assert list(tmp_path.iterdir()) == []


def test_files_that_are_no_store(tmp_path, stored):
    with pytest.raises(InvalidInput, match=r"none\.oed: no such file"):
        InformationSet.open(tmp_path / "none.oed")
    for content in (b"", b"\x00\xff", b"[1]", json.dumps({"format": "other"}).encode()):
        (tmp_path / "other.oed").write_bytes(content)
        with pytest.raises(InvalidInput, match=r"other\.oed: not an information store"):
            InformationSet.open(tmp_path / "other.oed")
    (tmp_path / "cut.oed").write_bytes(stored.path.read_bytes()[:-8])
    with pytest.raises(InvalidInput, match=r"cut\.oed: \d+ bytes, \d+ are needed; it is cut off"):
        InformationSet.open(tmp_path / "cut.oed")
    with pytest.raises(InvalidInput, match="cannot be written: No such file"):
        write_store(tmp_path / "no" / "where.oed", INFO.positions, INFO.names, [])
