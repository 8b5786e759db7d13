"""Coverage over repeated experiments; the long series carry the mark `slow`."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import pytest

from estimators import FrfExperiment, cross_check, fit, monte_carlo, simulate_frf
from estimators.validation.monte_carlo import RunStore
from estimators.validation.simulated_experiment import INTERVAL_METHODS, intervals_of
from robotmodels import CoupledChains, InvalidInput, RelativeNoise, SolverFailed

OMEGA = 2 * np.pi * np.geomspace(1, 12, 30)
CHAIN = CoupledChains(
    masses=[[1.0, 2.0, 1.5]],
    springs=[[3000.0, 4000.0]],
    couplings=[[0.0]],
    dampers=[[4.0, 5.0]],
)
NOISE = RelativeNoise(0.05, 0.01)
NOWHERE = np.zeros((1, 0))
RIGHT = FrfExperiment(CHAIN, NOWHERE, OMEGA, NOISE)
# The same chain with a fourth mass at its end that the model does not know.
LONGER = CoupledChains(
    masses=[[1.0, 2.0, 1.1, 0.4]],
    springs=[[3000.0, 4000.0, 2000.0]],
    couplings=[[0.0]],
    dampers=[[4.0, 5.0, 3.0]],
)
WRONG = FrfExperiment(LONGER, NOWHERE, OMEGA, NOISE)


def series(experiment=RIGHT, runs=100, seed=0, **arguments):
    rng = np.random.default_rng(seed)
    return monte_carlo(experiment, CHAIN, rng=rng, runs=runs, **arguments)


@pytest.fixture(scope="module")
def right():
    return series(methods=("theorem1", "posterior", "profile"), runs=16)


def test_intervals_cover_the_truth_on_a_right_model(right):
    # All parameters together are 64 intervals: three standard deviations are 0.08.
    for method in right.methods:
        assert 0.87 < right.overall(method) < 0.995, method
    assert not right.failures
    assert right.uncertainty().std == pytest.approx(right.stds[:, 0].mean(axis=0), rel=0.4)
    assert (np.abs(right.bias) < 4 * right.uncertainty().std / np.sqrt(16)).all()
    assert "16 experiments, 0 without an answer" in str(right)


@pytest.fixture(scope="module")
def plain():
    return series(runs=24)


def test_too_narrow_intervals_are_noticed(plain):
    third = (plain.intervals + 2 * plain.estimates[:, None, :, None]) / 3
    narrow = type(plain)(**vars(plain) | {"intervals": third})
    assert narrow.overall("theorem1") < 0.80
    assert not narrow.covers("theorem1").any()
    assert plain.covers("theorem1").all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("residual", "weights", "methods"),
    [
        ("nls", "optimal", ("theorem1", "posterior", "profile")),
        ("lls", "user", ("theorem1",)),
        ("lls", "optimal", ("theorem1", "posterior")),
    ],
)
def test_coverage_is_93_to_97_per_cent(residual, weights, methods):
    found = series(runs=600, residual=residual, weights=weights, methods=methods)
    for method in methods:
        assert 0.93 < found.overall(method) < 0.97, method
        assert (found.coverage(method) > 0.92).all()


def test_weights_may_be_numbers():
    weights = np.full((1, len(OMEGA), 1, 1), 1e4)
    found = series(runs=2, residual="lls", weights=weights)
    assert not found.failures


def test_a_model_error_ends_coverage_and_is_flagged(plain):
    found = series(WRONG, runs=12)
    assert found.overall("theorem1") < 0.6
    assert np.abs(found.bias / found.uncertainty().std).max() > 10 / np.sqrt(12)
    one = fit(CHAIN, WRONG(np.random.default_rng(9)), "nls", "optimal")
    table = cross_check(one, monte_carlo=found)
    assert set(table.verdicts) == {"model error"}
    assert table.covering is not None
    assert "theorem1" not in table.covering
    # Negative control: the right model is not flagged.
    good = cross_check(
        fit(CHAIN, RIGHT(np.random.default_rng(9)), "nls", "optimal"),
        monte_carlo=plain,
    )
    assert set(good.verdicts) == {"trustworthy"}
    assert good.covering == ("theorem1",)


@dataclass
class Stops:
    """An experiment that is interrupted at its `last` call."""

    last: int
    calls: int = 0

    def __call__(self, rng):
        self.calls += 1
        if self.calls == self.last:
            raise KeyboardInterrupt
        return RIGHT(rng)


def test_an_interrupted_series_goes_on_as_if_nothing_had_happened(tmp_path):
    path = tmp_path / "runs.h5"
    whole = series(runs=45)
    with pytest.raises(KeyboardInterrupt):
        series(Stops(36), runs=45, store=path)
    told = []
    with ThreadPoolExecutor(2) as executor:
        resumed = series(
            runs=45,
            store=path,
            executor=executor,
            progress=lambda done, total: told.append((done, total)),
        )
    assert told[0] == (22, 45)
    assert told[-1] == (45, 45)
    assert (resumed.estimates == whole.estimates).all()
    assert (resumed.intervals == whole.intervals).all()
    counted = Stops(10)
    assert (series(counted, runs=45, store=path).costs == whole.costs).all()
    assert counted.calls == 1  # for the fingerprint


def test_another_series_is_refused(tmp_path):
    path = tmp_path / "runs.h5"
    series(runs=4, store=path)
    for arguments in ({"seed": 1}, {"experiment": WRONG}, {"level": 0.9}, {"residual": "lls"}):
        with pytest.raises(InvalidInput, match=r"runs\.h5: holds another series"):
            series(**{"runs": 4, "store": path} | arguments)
    path.write_text("no runs")
    with pytest.raises(InvalidInput, match="not an HDF5 file of runs"):
        series(runs=4, store=path)
    with pytest.raises(InvalidInput, match="cannot be written"):
        RunStore(tmp_path / "nowhere" / "runs.h5", "x").save(["no answer"])


def test_runs_without_an_answer_are_counted_with_their_reason(tmp_path):
    def experiment(rng):
        if rng.uniform() < 0.3:
            raise SolverFailed("the robot fell over")
        return RIGHT(rng)

    found = series(experiment, runs=20, seed=3, store=tmp_path / "runs.h5")
    assert 0 < len(found.failures) < 20
    assert found.failures[0] == "the robot fell over"
    assert len(found.estimates) + len(found.failures) == 20
    again = series(experiment, runs=20, seed=3, store=tmp_path / "runs.h5")
    assert again.failures == found.failures

    def never(rng):
        raise SolverFailed("the robot fell over")

    with pytest.raises(SolverFailed, match="0 of 3 runs have an answer; the robot fell over"):
        series(never, runs=3)


def test_parameters_without_a_truth_have_no_coverage():
    found = series(runs=20, truth=np.array([3000.0, np.nan, 4.0, 5.0]))
    assert np.isnan(found.coverage("theorem1")).tolist() == [False, True, False, False]
    assert np.isfinite(found.overall("theorem1"))


@pytest.mark.parametrize("method", INTERVAL_METHODS)
def test_methods_agree_on_good_data(method):
    data = simulate_frf(CHAIN, NOWHERE, OMEGA, RelativeNoise(0.01, 0), np.random.default_rng(0))
    found = fit(CHAIN, data, "nls", "optimal")
    expected, _ = intervals_of(found, "theorem1", 0.9, np.random.default_rng(0))
    std, ends = intervals_of(found, method, 0.9, np.random.default_rng(0))
    tolerance = 0.6 if method == "empirical" else 0.15
    assert std == pytest.approx(expected, rel=tolerance)
    assert ends[:, 1] - ends[:, 0] == pytest.approx(2 * 1.645 * expected, rel=tolerance)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"runs": 1}, "runs: 1; at least 2"),
        ({"methods": ("theorem2",)}, "methods: 'theorem2' is unknown .did you mean 'theorem1'"),
        ({"level": 1.0}, "level 1.0 does not lie"),
    ],
)
def test_settings_that_cannot_work_are_named(arguments, message):
    with pytest.raises(InvalidInput, match=message):
        series(**arguments)
    with pytest.raises(InvalidInput, match="'profile' is unknown; there are theorem1"):
        series(runs=2).coverage("profile")
    with pytest.raises(InvalidInput, match="'postrior' is none of"):
        intervals_of(fit(CHAIN, RIGHT(np.random.default_rng(0))), "postrior", 0.9, None)
