import pickle
import signal
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mass_springs import OMEGA, POSITIONS, MassSprings
from test_least_squares import MODEL, TRUTH, exact, noisy

import estimators.fitting.multistart as multistart_module
from estimators import EarlyStop, Prior, fit, multistart, perturbed_starts
from estimators.fitting.multistart import order_of_costs
from robotmodels import InvalidInput, NoEquilibrium, SpringNetwork
from robotmodels.common.checkpoint_file import CheckpointFile


def starts(n=4, decades=0.2, seed=1):
    return perturbed_starts(MODEL.parameters, n, decades, np.random.default_rng(seed))


def same(a, b):
    return all(
        (x.parameters.values == y.parameters.values).all()
        and (x.cost, x.status, x.message, x.evaluations)
        == (y.cost, y.status, y.message, y.evaluations)
        for x, y in zip(a, b, strict=True)
    )


class Counting(MassSprings):
    """Counts how often it is asked."""

    calls = 0

    def network(self, positions, parameters=None):
        type(self).calls += 1
        return super().network(positions, parameters)


def test_perturbed_starts_span_the_decades():
    found = perturbed_starts(MODEL.parameters, 500, 1.0, np.random.default_rng(0))
    exponents = np.log10(found / TRUTH)
    assert found.shape == (500, 6)
    assert np.abs(exponents).max() <= 1
    assert np.isclose(exponents.std(), 1 / np.sqrt(3), rtol=0.05)
    again = perturbed_starts(MODEL.parameters, 500, 1.0, np.random.default_rng(0))
    assert (found == again).all()
    for n, decades in ((0, 1.0), (1, -1.0), (1, np.nan)):
        with pytest.raises(InvalidInput, match="perturbed_starts"):
            perturbed_starts(MODEL.parameters, n, decades, np.random.default_rng(0))


def test_multistart_sorts_and_keeps_failures_with_their_reason():
    model = MassSprings(weakest=500.0)
    points = TRUTH * np.array([[1.3] * 6, [0.5] + [1.0] * 5, [1.0] * 6])
    told = []
    fits = multistart(
        model,
        noisy(),
        points,
        "nls",
        "optimal",
        progress=lambda done, total: told.append((done, total)),
    )
    # Both that converged are at one minimum, and come as their starts.
    assert [fits[i].start.tolist() for i in (0, 1)] == points[[0, 2]].tolist()
    assert [found.converged for found in fits] == [True, True, False]
    assert np.isclose(fits[0].cost, fits[1].cost)
    assert fits[2].status == -1
    assert "k1 = 450 is below 500" in fits[2].message
    assert np.isinf(fits[2].cost)
    assert (fits[2].parameters.values == points[1]).all()
    assert told == [(1, 3), (2, 3), (3, 3)]
    with pytest.raises(NoEquilibrium):
        fit(model, noisy(), start=points[1])


class Broken(MassSprings):
    def network(self, positions, parameters=None):
        network = super().network(positions, parameters)
        return SpringNetwork(**(vars(network) | {"mass": np.full_like(network.mass, np.nan)}))


class Overflowing(MassSprings):
    def network(self, positions, parameters=None):
        raise OverflowError("math range error")


@pytest.mark.parametrize(("model", "reason"), [(Broken(), "not finite"), (Overflowing(), "range")])
def test_whatever_a_start_can_cause_is_kept(model, reason):
    (found,) = multistart(model, exact(), [TRUTH], "nls")
    assert not found.converged
    assert reason in found.message


def test_non_convergence_is_kept_with_its_status():
    found = multistart(MODEL, exact(), starts(2), max_evaluations=2)
    assert [one.status for one in found] == [0, 0]
    assert all("maximum number" in one.message for one in found)


@pytest.mark.parametrize("pool", [ThreadPoolExecutor, ProcessPoolExecutor])
def test_an_executor_changes_nothing(pool):
    estimate = noisy()
    alone = multistart(MODEL, estimate, starts())
    told = []
    with pool(2) as executor:
        together = multistart(
            MODEL, estimate, starts(), executor=executor, progress=lambda *a: told.append(a)
        )
    assert same(alone, together)
    assert told == [(i, 4) for i in range(1, 5)]
    # What comes back shares model and estimate instead of bringing copies.
    assert all(one.estimate is estimate and one.model is MODEL for one in together)
    pickle.loads(pickle.dumps(together[0]))


def test_failures_in_a_pool_are_kept_too():
    model = MassSprings(weakest=500.0)
    points = TRUTH * np.array([[0.5] + [1.0] * 5, [1.0] * 6])
    with ProcessPoolExecutor(1) as executor:
        good, bad = multistart(model, exact(), points, executor=executor)
    assert good.converged
    assert "k1 = 450 is below 500" in bad.message


def test_multistart_needs_a_start():
    with pytest.raises(InvalidInput, match="no starts"):
        multistart(MODEL, exact(), [])
    with pytest.raises(InvalidInput, match="k1 = 9e\\+06 lies outside"):
        multistart(MODEL, exact(), [TRUTH, TRUTH * 1e4])


def test_hopeless_searches_stop_and_say_so():
    estimate = noisy()
    far = starts(12, decades=1.0, seed=3)
    rule = EarlyStop(evaluations=6, factor=5.0)
    whole = multistart(MODEL, estimate, far, "nls", "optimal")
    some = multistart(MODEL, estimate, far, "nls", "optimal", early_stop=rule)
    stopped = [one for one in some if one.status == -2]
    assert 0 < len(stopped) < 12
    assert not any(one.converged for one in stopped)
    assert all("stopped early: cost" in one.message for one in stopped)
    assert all("5 times the least of all starts" in one.message for one in stopped)
    assert all(np.isfinite(one.cost) and one.evaluations <= 6 for one in stopped)
    assert np.isclose(some[0].cost, whole[0].cost, rtol=1e-6)
    # Order and executor do not matter.
    with ThreadPoolExecutor(2) as executor:
        again = multistart(
            MODEL, estimate, far[::-1], "nls", "optimal", early_stop=rule, executor=executor
        )

    def by_start(fits):
        return sorted(fits, key=lambda one: one.start.tolist())

    assert same(by_start(some), by_start(again))


def test_early_stop_without_room_to_go_on():
    rule = EarlyStop(evaluations=6, factor=5.0)
    with ThreadPoolExecutor(1) as executor:
        found = multistart(
            MODEL, noisy(), starts(3), max_evaluations=3, early_stop=rule, executor=executor
        )
    assert [one.status for one in found] == [0, 0, 0]
    assert all("maximum number" in one.message for one in found)


@pytest.mark.parametrize("arguments", [{"evaluations": 1}, {"factor": 1.0}, {"factor": np.nan}])
def test_early_stop_refuses(arguments):
    with pytest.raises(InvalidInput, match="early_stop: evaluations"):
        EarlyStop(**arguments)


def test_a_store_resumes_and_grows(tmp_path):
    path, estimate, points = tmp_path / "searches.h5", noisy(), starts(5)
    whole = multistart(MODEL, estimate, points)
    multistart(MODEL, estimate, points[:3], store=path)
    Counting.calls = 0
    model = Counting()
    again = multistart(model, estimate, points[:3], store=path)
    assert Counting.calls <= 1  # for the fingerprint
    assert same(again, multistart(MODEL, estimate, points[:3]))
    told = []
    assert same(
        whole,
        multistart(
            model, estimate, points, store=path, progress=lambda done, total: told.append(done)
        ),
    )
    assert told == [1, 2, 3, 4, 5]
    with ThreadPoolExecutor(1) as executor:  # nothing is left to do
        assert same(whole, multistart(MODEL, estimate, points, store=path, executor=executor))


def test_a_store_keeps_early_stops(tmp_path):
    far, rule = starts(6, decades=1.0, seed=3), EarlyStop(6, 5.0)
    arguments = {"early_stop": rule, "store": tmp_path / "searches.h5"}
    first = multistart(MODEL, noisy(), far, "nls", "optimal", **arguments)
    Counting.calls = 0
    assert same(first, multistart(Counting(), noisy(), far, "nls", "optimal", **arguments))
    assert Counting.calls <= 1
    # The rule looks at all starts: only those that have ended are kept for good.
    assert any(one.status == -2 for one in first)


INTERRUPTED = """
import sys, os, signal
sys.path.insert(0, {tests!r})
from test_multistart import MODEL, starts, noisy
from estimators import multistart
def kill(done, total):
    if done == 2:
        os.kill(os.getpid(), signal.SIGKILL)
multistart(MODEL, noisy(), starts(5), store={path!r}, progress=kill)
"""


def test_a_killed_run_loses_nothing_that_had_ended(tmp_path):
    path = tmp_path / "searches.h5"
    script = INTERRUPTED.format(tests=str(Path(__file__).parent), path=str(path))
    ended = subprocess.run([sys.executable, "-c", script], check=False)
    assert ended.returncode == -signal.SIGKILL
    told = []
    Counting.calls = 0
    fits = multistart(
        Counting(), noisy(), starts(5), store=path, progress=lambda *_: told.append(Counting.calls)
    )
    assert told[:2] == [1, 1]  # the first two come from the file
    assert same(fits, multistart(MODEL, noisy(), starts(5)))


@pytest.mark.parametrize(
    "change",
    [
        {"residual": "nls"},
        {"weights": "optimal"},
        {"bounds": (1e-2, 1e2)},
        {"max_evaluations": 100},
        {"positions": [0, 1]},
        {"prior": Prior(("k1",), np.array([900.0]), np.array([0.1]))},
        {"loss": "huber"},
        {"estimate": noisy(1)},
    ],
)
def test_a_store_of_another_problem_is_refused(tmp_path, change):
    path = tmp_path / "searches.h5"
    arguments = {"model": MODEL, "estimate": noisy(), "starts": starts(1)}
    multistart(**arguments, store=path)
    with pytest.raises(InvalidInput, match=r"searches\.h5: holds searches of another model"):
        multistart(**arguments | change, store=path)


def test_a_store_that_is_something_else_is_refused(tmp_path):
    import h5py

    path = tmp_path / "searches.h5"
    path.write_text("not this")
    with pytest.raises(InvalidInput, match=r"searches\.h5: is not an HDF5 file"):
        multistart(MODEL, noisy(), starts(1), store=path)
    with h5py.File(path, "w") as file:
        file.attrs["schema"] = "records/1"
    with pytest.raises(InvalidInput, match=r"searches\.h5: is not .* name another file"):
        multistart(MODEL, noisy(), starts(1), store=path)
    with CheckpointFile(path, "", "runs", "").writing():
        pass
    with pytest.raises(InvalidInput, match="'schema' is 'runs/1'; 'searches/1' is needed"):
        multistart(MODEL, noisy(), starts(1), store=path)


def test_a_model_of_other_masses_is_another_problem(tmp_path):
    path = tmp_path / "searches.h5"
    multistart(MODEL, noisy(), starts(1), store=path)

    class Heavier(MassSprings):
        def network(self, positions, parameters=None):
            network = super().network(positions, parameters)
            return SpringNetwork(**(vars(network) | {"mass": 2 * network.mass}))

    with pytest.raises(InvalidInput, match="another model"):
        multistart(Heavier(), noisy(), starts(1), store=path)


def test_costs_that_only_rounding_tells_apart_come_as_their_starts():
    costs = np.array([3.0, np.inf, 2.0 * (1 + 3e-12), 2.0, 5.0, 2.0 * (1 - 2e-12), np.inf, 2.1])
    assert order_of_costs(costs) == [2, 3, 5, 7, 0, 4, 1, 6]
    assert order_of_costs([]) == []


def test_the_order_of_fits_does_not_hang_on_rounding(monkeypatch):
    """The same searches with costs that differ in the last digits come in the same order."""
    rng, searched = np.random.default_rng(0), multistart_module._search_several

    def rounded_otherwise(*arguments, **options):
        outcomes = searched(*arguments, **options)
        return [replace(o, cost=o.cost * (1 + 1e-12 * rng.normal())) for o in outcomes]

    points = starts(8)
    whole = [fit.start.tolist() for fit in multistart(MODEL, noisy(), points)]
    monkeypatch.setattr(multistart_module, "_search_several", rounded_otherwise)
    for _ in range(3):
        again = multistart(MODEL, noisy(), points)
        assert [fit.start.tolist() for fit in again] == whole


def test_positions_are_an_axis():
    estimate = noisy()
    one = fit(MODEL, estimate, positions=[1])
    assert np.allclose(
        one.parameters.values, fit(MODEL, estimate.subset([1])).parameters.values, rtol=1e-12
    )
    weights = np.ones((3, len(OMEGA), 2, 2))
    weights[1] = 2.0
    assert (fit(MODEL, estimate, "nls", weights, positions=[1]).weights == 2.0).all()
    assert len(one.estimate.positions) == 1
    assert (one.estimate.positions == POSITIONS[1]).all()
    with pytest.raises(InvalidInput, match="does not choose from positions 0 to 2"):
        fit(MODEL, estimate, positions=[3])


@pytest.mark.parametrize("residual", ["nls", "lls"])
@pytest.mark.parametrize("seed", range(3))
def test_quasi_newton_ends_in_the_minimum_that_gauss_newton_finds(residual, seed):
    estimate, points = noisy(), starts(2, decades=0.05, seed=seed)
    ends = [
        multistart(MODEL, estimate, points, residual, "user", tolerance=1e-14, minimiser=name)
        for name in ("trust_region", "quasi_newton")
    ]
    for one, other in zip(*ends, strict=True):
        assert np.isclose(one.cost, other.cost, rtol=1e-9)
        np.testing.assert_allclose(one.parameters.values, other.parameters.values, rtol=1e-3)
    assert not same(*ends)


def test_quasi_newton_stays_inside_the_bounds_and_where_there_is_a_model():
    bounds = np.outer([0.9, 1.1], TRUTH)
    bounds[:, 0] = TRUTH[0] * np.array([1.05, 1.1])  # the truth lies outside
    (end,) = multistart(
        MODEL, noisy(), [1.08 * TRUTH], "lls", "user", bounds, minimiser="quasi_newton"
    )
    assert end.parameters.values[0] == pytest.approx(bounds[0, 0])
    assert ((end.parameters.values >= bounds[0]) & (end.parameters.values <= bounds[1])).all()
    model = MassSprings(weakest=0.95 * TRUTH[0])  # a step below it has no equilibrium
    (end,) = multistart(model, exact(), [3.0 * TRUTH], "lls", "user", minimiser="quasi_newton")
    assert end.parameters.values[0] >= 0.95 * TRUTH[0]
    assert np.isfinite(end.cost)


def test_quasi_newton_minimises_robust_losses_too():
    for loss in ("soft_l1", "huber", "cauchy"):
        problem = (MODEL, noisy(), [1.02 * TRUTH], "nls", "optimal")
        one, other = (
            multistart(*problem, tolerance=1e-14, loss=loss, minimiser=name)[0]
            for name in ("trust_region", "quasi_newton")
        )
        assert np.isclose(one.cost, other.cost, rtol=1e-8)


def test_an_unknown_minimiser_is_refused():
    with pytest.raises(InvalidInput, match=r"minimiser 'quasinewton' is unknown .*quasi_newton"):
        multistart(MODEL, noisy(), starts(1), minimiser="quasinewton")
