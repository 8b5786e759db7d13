"""Whoever computes, the results are the same to the last bit, and a killed worker costs nothing."""

import multiprocessing
import os
import signal
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from two_axes import TwoAxes

import estimators
import oed
from robotmodels import ProcessPool, RelativeNoise
from robotmodels.linear.derived_models import FixedEquilibriumModel

OMEGA = 2 * np.pi * np.geomspace(3.0, 30.0, 8)
NOISE = RelativeNoise(0.03, 0.01)
POSITIONS = np.column_stack([np.linspace(-1, 1, 40), np.linspace(-2, 2, 40)])
STARTS = TwoAxes.parameters.values * np.array([[0.8, 1.1], [1.2, 0.9], [1.0, 1.3]])


@dataclass(frozen=True, eq=False)
class Deadly:
    """Two axes whose first use in another process kills that process, and whose second does not."""

    mark: Path | None = None

    parameters = TwoAxes.parameters

    def network(self, positions, parameters=None):
        elsewhere = multiprocessing.parent_process() is not None
        if self.mark is not None and elsewhere and not self.mark.exists():
            self.mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return FixedEquilibriumModel(TwoAxes().network(positions)).network(positions, parameters)


def information(model, executor):
    return [oed.information(model, POSITIONS, OMEGA, NOISE, 10, executor).matrices]


def multistart(model, executor):
    data = estimators.simulate_frf(Deadly(), POSITIONS[:2], OMEGA, NOISE, np.random.default_rng(1))
    fits = estimators.multistart(model, data, STARTS, "nls", "optimal", executor=executor)
    return [np.append(one.parameters.values, one.cost) for one in fits]


def repeated(model, executor):
    experiment = estimators.FrfExperiment(Deadly(), POSITIONS[:2], OMEGA, NOISE)
    rng = np.random.default_rng(2)
    found = estimators.monte_carlo(experiment, model, rng=rng, runs=4, executor=executor)
    return [found.estimates, found.stds, found.costs]


WORK = (information, multistart, repeated)


def same(one, other):
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def killed_in(killed, tmp_path):
    with ProcessPool(1) as pool:  # more would take longer to begin than to compute
        for work in WORK:
            model = Deadly(tmp_path / work.__name__ if work in killed else None)
            assert same(work(model, pool), work(Deadly(), None)), work.__name__
            assert model.mark is None or model.mark.exists()


def test_a_pool_whose_workers_are_killed_gives_the_same_to_the_last_bit(tmp_path):
    killed_in(WORK[-1:], tmp_path)


@pytest.mark.slow  # every new worker imports the libraries anew
def test_a_pool_whose_workers_are_killed_in_every_kind_of_work(tmp_path):
    killed_in(WORK, tmp_path)


@pytest.fixture
def dask():
    return pytest.importorskip("distributed")


def test_a_dask_executor_gives_the_same_to_the_last_bit(dask):
    with (
        dask.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0"
        ) as cluster,
        dask.Client(cluster) as client,
    ):
        for work in WORK:
            found = work(Deadly(), client.get_executor(pure=False))
            assert same(found, work(Deadly(), None)), work.__name__


@pytest.mark.slow
def test_dask_workers_that_are_killed_cost_nothing(dask, tmp_path):
    with (
        dask.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
        ) as cluster,
        dask.Client(cluster) as client,
    ):
        executor = client.get_executor(pure=False, retries=3)
        for work in WORK:
            model = Deadly(tmp_path / work.__name__)
            assert same(work(model, executor), work(Deadly(), None)), work.__name__
            assert model.mark.exists()
