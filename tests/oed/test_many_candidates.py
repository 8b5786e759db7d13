"""Designs over very many candidates, which are found by pools of them, against all at once."""

import numpy as np
import pytest
from random_candidates import random_set

import oed
from oed.criteria.criteria import objective_of
from oed.design.active_set import solve
from oed.design.optimal_design import allowed_weights
from oed.design.problem import DesignProblem
from oed.design.solvers import design_solvers
from oed.information_sets.stored_information import StoredInformation, write_store
from robotmodels import InvalidInput

P = 3
MANY = 7_000


@pytest.fixture(autouse=True)
def small_pools(monkeypatch):
    monkeypatch.setattr("oed.design.many_candidates._POOL_BYTES", 300 * 8 * P**2)


def at_once(info, criterion="D", constraints=None, prior=None):
    """Return the design by active sets of all candidates."""
    objective = objective_of(criterion, info.names, info.samples)
    allowed = allowed_weights(constraints, len(info))
    solvers = design_solvers("auto", None, objective)
    return solve(DesignProblem(info, objective, allowed, prior), 1e-6, 50, solvers)


def counted(monkeypatch):
    """Count the passes over more candidates than a pool has."""
    passes = []
    derivatives = oed.InformationSet.directional_derivatives

    def counting(info, weight):
        passes.append(len(info))
        return derivatives(info, weight)

    monkeypatch.setattr(oed.InformationSet, "directional_derivatives", counting)
    return passes


@pytest.mark.parametrize("criterion", ["D", "A", "E"])
def test_pools_lead_to_the_design_over_all(monkeypatch, criterion):
    info = random_set(2, MANY, P, 2)
    expected = at_once(info, criterion)
    passes = counted(monkeypatch)
    design = oed.optimal_design(info, criterion)
    assert len(passes) == design.rounds <= 5
    assert design.gap <= 1e-6
    assert design.value == pytest.approx(expected.value, rel=2e-6)
    weights = design.weights
    size = 1e-12 * np.abs(design.information).max()
    np.testing.assert_allclose(info.combined(weights), design.information, rtol=1e-9, atol=size)
    assert weights.sum() == pytest.approx(1.0)
    assert oed.optimality_gap(weights, info.matrices, criterion, witness=design.witness) <= 1e-6


def test_the_certificate_over_all_is_that_of_the_equivalence_theorem():
    info = random_set(3, MANY, P, 1)
    design = oed.optimal_design(info)
    inverse = np.linalg.inv(np.tensordot(design.weights, info.matrices, axes=1))
    derivatives = np.einsum("ab,qba->q", inverse, info.matrices) / P
    assert derivatives.max() - 1 == pytest.approx(design.gap, abs=1e-9)
    np.testing.assert_allclose(design.sensitivity, derivatives, rtol=1e-6)


def test_lower_weights_times_and_a_prior_are_those_of_all():
    info, rng = random_set(4, MANY, P, 2), np.random.default_rng(4)
    durations, least = rng.uniform(5, 20, MANY), {5: 0.5, 6_000: 1.0}
    limits = oed.Constraints(time=100.0, durations=durations, mandatory=least)
    prior = 0.3 * info.matrices[7]
    expected = at_once(info, "D", limits, prior)
    design = oed.optimal_design(info, "D", limits, prior)
    assert design.value == pytest.approx(expected.value, abs=3e-6)
    assert all(design.weights[i] >= weight for i, weight in least.items())
    assert durations @ design.weights == pytest.approx(100.0)
    assert design.multipliers == pytest.approx(expected.multipliers, rel=1e-4)
    information = prior + np.tensordot(design.weights, info.matrices, axes=1)
    np.testing.assert_allclose(design.information, information, rtol=1e-9)


def test_samples_of_the_parameters_are_averaged_over_in_pools():
    samples = oed.InformationSamples((random_set(5, MANY, P, 2), random_set(6, MANY, P, 2)))
    design = oed.optimal_design(samples, "D")
    assert design.gap <= 1e-6
    assert design.value == pytest.approx(at_once(samples, "D").value, rel=2e-6)


def test_a_parameter_that_one_candidate_informs_on_is_not_missed():
    info = random_set(7, MANY, P, 2)
    matrices = np.array(info.matrices)
    matrices[:, 2, :] = matrices[:, :, 2] = 0.0
    matrices[4_321, 2, 2] = 1.0
    rare = oed.InformationSet(info.positions, matrices, info.names)
    design = oed.optimal_design(rare)
    assert 4_321 in design.support
    assert design.gap <= 1e-6


def test_a_store_is_passed_over_a_few_times_only(tmp_path, monkeypatch):
    info = random_set(8, MANY, P, 2)
    store = write_store(tmp_path / "a.oed", info.positions, info.names, [info.matrices])
    passes = []
    times = StoredInformation._times

    def counting(one, packed, start, end):
        passes.append(end - start)
        return times(one, packed, start, end)

    monkeypatch.setattr(StoredInformation, "_times", counting)
    design = oed.optimal_design(store)
    assert len(passes) == design.rounds <= 5
    np.testing.assert_allclose(design.weights, oed.optimal_design(info).weights, atol=1e-6)


def test_where_pools_do_not_end_active_sets_of_all_go_on(monkeypatch):
    info = random_set(9, MANY, P, 2)
    with pytest.raises(InvalidInput, match="max_rounds: 0"):
        oed.optimal_design(info, max_rounds=0)
    passes = counted(monkeypatch)
    design = oed.optimal_design(info, max_rounds=1)
    assert len(passes) > 2
    assert design.value == pytest.approx(oed.optimal_design(info).value, rel=2e-6)
