import numpy as np
import pytest
from arviz_stats.base.array import array_stats

from estimators.sampling.convergence import (
    StoppingCriterion,
    assess_convergence,
    autocorrelation_time,
    burn_in,
    effective_size,
    has_converged,
    r_hat,
)
from estimators.sampling.mixing import bulk_size, rank_r_hat
from robotmodels import InvalidInput

NAMES = ("a", "b")


def autoregression(a, snapshots=80, ensembles=4, walkers=50, seed=0):
    """x' = a x + noise, stationary: its autocorrelation time is (1 + a)/(1 - a)."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((ensembles, snapshots, walkers, 2))
    for t in range(1, snapshots):
        x[:, t] = a * x[:, t - 1] + np.sqrt(1 - a**2) * x[:, t]
    return x


def test_autocorrelation_times_of_an_autoregression_are_known():
    x = autoregression(0.8, walkers=200)
    assert autocorrelation_time(x) == pytest.approx([9.0, 9.0], rel=0.1)
    long = autoregression(0.8, 600)
    assert effective_size(long) == pytest.approx(np.full(2, 4 * 600 * 50 / 9.0), rel=0.15)


def test_r_hat_and_effective_sizes_are_those_of_arviz_stats():
    x = autoregression(0.5)
    for i in range(2):
        by_walker = x[..., i].transpose(0, 2, 1).reshape(-1, 80)
        by_ensemble = x[..., i].reshape(4, -1)
        assert effective_size(x)[i] == array_stats.ess(by_walker, chain_axis=0, draw_axis=1)
        assert r_hat(x)[i] == array_stats.rhat(by_ensemble, chain_axis=0, draw_axis=1)


@pytest.mark.parametrize("a", [-0.9, 0.0, 0.7, 0.98])
@pytest.mark.parametrize("snapshots", [5, 12, 61])
def test_mixing_is_that_of_arviz_stats_with_shifts_and_equal_values(a, snapshots):
    x = autoregression(a, snapshots, 1, 6, seed=snapshots)[0].transpose(2, 1, 0)
    rejected = np.repeat(x, 2, axis=2)
    for series in (*x, *rejected, *np.round(x, 1), x[0] + np.arange(6)[:, None], np.zeros((4, 8))):
        assert bulk_size(series) == pytest.approx(float(array_stats.ess(series)), rel=1e-9)
        if np.ptp(series):
            assert rank_r_hat(series) == pytest.approx(float(array_stats.rhat(series)), rel=1e-9)


def test_long_chains_are_enough_and_short_ones_are_not():
    long, short = autoregression(0.5, 200), autoregression(0.95, 60)
    assert has_converged(long, StoppingCriterion())
    assert assess_convergence(NAMES, long, StoppingCriterion()).faults == ()
    assert not has_converged(short, StoppingCriterion())
    found = assess_convergence(NAMES, short, StoppingCriterion())
    assert "fewer than 10 autocorrelation times" in found.faults[-1]
    assert found.needed > 60
    # What it says is needed is enough.
    assert has_converged(autoregression(0.95, 4 * found.needed), StoppingCriterion())


def test_targets_that_are_missed_are_named():
    x = autoregression(0.5, 200)
    found = assess_convergence(NAMES, x, StoppingCriterion(ess=1e6))
    assert found.faults == ()
    assert found.short == "short of R-hat 1.01 and effective size 1000000"
    assert found.needed > 10_000
    assert not has_converged(x, StoppingCriterion(ess=1e6))
    assert not has_converged(x, StoppingCriterion(r_hat=1.0 + 1e-9))
    with pytest.raises(InvalidInput, match=r"target: R-hat 0\.9 and effective size 10"):
        StoppingCriterion(0.9, 10.0)


def test_ensembles_that_disagree_do_not_claim_convergence():
    x = autoregression(0.5, 200)
    x[0, ..., 1] += 1.0
    found = assess_convergence(NAMES, x, StoppingCriterion())
    assert "R-hat" in found.faults[0]
    assert "for b" in found.faults[0]
    assert not has_converged(x, StoppingCriterion())


def test_few_draws_are_a_fault():
    found = assess_convergence(NAMES, autoregression(0.5, 60, 2, 2), StoppingCriterion())
    assert any("effective sample size" in fault for fault in found.faults)


def test_burn_in_is_three_autocorrelation_times_and_at_most_half():
    burn, _ = burn_in(autoregression(0.5, 200))
    assert 8 <= burn <= 11
    assert burn_in(autoregression(0.99, 60))[0] == 30
