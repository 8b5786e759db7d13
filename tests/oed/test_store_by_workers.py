"""Stores that workers write and read, against the same made in place."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from oed import candidate_positions, information, optimal_design
from oed.information_sets import store_by_workers, stored_information
from robotmodels import InvalidInput, RelativeNoise, load_robot

OMEGA, NOISE = 2 * np.pi * np.linspace(3, 60, 8), RelativeNoise(0.03, 0.01)


@pytest.fixture(scope="module")
def pool():
    with ThreadPoolExecutor(2) as executor:
        yield executor


@pytest.fixture(scope="module")
def stores(tmp_path_factory, pool):
    """Return a store of 513 candidates written here, and one written by workers."""
    robot, folder = load_robot("manutec_r3"), tmp_path_factory.mktemp("stores")
    positions = candidate_positions(robot, [1, 19, 3, 3, 3, 1])

    def written(name, executor):
        path = folder / name
        return information(robot, positions, OMEGA, NOISE, chunk=100, executor=executor, store=path)

    return written("here.oed", None), written("there.oed", pool), written


def refusing(error):
    def getsize(path):
        raise error

    return getsize


def test_workers_write_the_same_bits(stores):
    here, there, _ = stores
    assert there.path.read_bytes() == here.path.read_bytes()


def test_matrices_travel_where_workers_do_not_see_the_file(stores, pool, monkeypatch):
    here, _, written = stores
    monkeypatch.setattr(store_by_workers.os.path, "getsize", refusing(FileNotFoundError()))
    assert written("far.oed", pool).path.read_bytes() == here.path.read_bytes()


def test_a_worker_that_cannot_write_says_so(stores, pool, monkeypatch):
    _, _, written = stores
    full = OSError(28, "No space left on device")
    monkeypatch.setattr(store_by_workers.os.path, "getsize", refusing(full))
    with pytest.raises(InvalidInput, match=r"full.*\.oed: cannot be written: No space left"):
        written("full.oed", pool)
    assert not list(stores[0].path.parent.glob("full*"))


@pytest.mark.parametrize("seen", [True, False])
def test_workers_read_it(stores, pool, monkeypatch, seen):
    here = stores[0]
    monkeypatch.setattr(stored_information, "_READ", 70)
    if not seen:
        monkeypatch.setattr(stored_information, "_times", lambda *_: None)
    there = replace(here, executor=pool)
    weight = np.linalg.inv(here.total)
    prices = there.directional_derivatives(weight)
    np.testing.assert_allclose(prices, here.directional_derivatives(weight), rtol=1e-12)
    np.testing.assert_allclose(optimal_design(there).value, optimal_design(here).value, rtol=1e-9)


def test_a_store_travels_without_its_workers(stores, pool):
    assert pickle.loads(pickle.dumps(replace(stores[0], executor=pool))).executor is None
