"""Moves, running ensembles side by side, and files of chains that survive a kill."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import emcee
import h5py
import numpy as np
import pytest
from killed import killed_again_and_again

from estimators.sampling.chain_checkpoint import Store
from estimators.sampling.ensemble import Sampler, marks, run_ensembles
from estimators.sampling.moves import IndependentMove, SnookerMove
from estimators.sampling.student_t_proposal import StudentT
from robotmodels import InvalidInput

P = 5


def standard_normal(x):
    return -0.5 * np.sum(x**2, axis=1)


def sampled_variance(move, seed=0, steps=400, walkers=20):
    """Variance that a move gives to N(0, I); its truth is 1."""
    state = np.random.RandomState(seed)
    sampler = emcee.EnsembleSampler(walkers, P, standard_normal, vectorize=True, moves=[move])
    start = emcee.State(state.randn(walkers, P), random_state=state.get_state())
    sampler.run_mcmc(start, steps, skip_initial_state_check=True)
    return sampler.get_chain()[100:].var()


def test_the_snooker_move_keeps_the_normal_and_the_stock_one_does_not():
    assert abs(sampled_variance(SnookerMove()) - 1) < 0.1
    assert sampled_variance(emcee.moves.DESnookerMove()) < 0.85


def test_independent_moves_keep_the_normal_even_from_a_wrong_proposal():
    wrong = StudentT(np.full(P, 0.5), 1.5 * np.eye(P) + 0.1)
    move = IndependentMove(wrong)
    assert abs(sampled_variance(emcee.moves.MHMove(move)) - 1) < 0.1

    def without_factor(walkers, random):
        proposal, factor = move(walkers, random)
        return proposal, 0 * factor

    assert abs(sampled_variance(emcee.moves.MHMove(without_factor)) - 1) > 0.2


def test_a_walker_on_its_anchor_stays():
    random = np.random.RandomState(0)
    sample = np.zeros((1, 2))
    proposal, factor = SnookerMove().get_proposal(sample, [np.zeros((1, 2))] * 3, random)
    assert (proposal == sample).all()
    assert factor[0] == -np.inf


def test_student_t_draws_have_the_density_they_say():
    root = np.array([[1.0, 0.0], [0.6, 0.3]])
    t = StudentT(np.array([1.0, -2.0]), root, dof=7.0)
    draws = t.draw(200_000, np.random.default_rng(0))
    assert np.allclose(np.cov(draws.T), root @ root.T * 7 / 5, rtol=0.03, atol=0.01)
    wide = StudentT(t.center, 1.3 * root, dof=5.0)
    # The ratio of two densities has the mean one under the lower.
    ratio = np.exp(t.log_density(other := wide.draw(50_000, np.random.default_rng(1))))
    assert np.mean(ratio / np.exp(wide.log_density(other))) == pytest.approx(1, abs=0.02)


def run(steps=160, seed=0, ensembles=2, log_probability=standard_normal, **arguments):
    rng = np.random.default_rng(seed)
    starts = rng.standard_normal((ensembles, 16, P))
    seeds = rng.integers(2**32, size=ensembles)
    sampler = Sampler(log_probability, 2, StudentT(np.zeros(P), np.eye(P)))
    return run_ensembles(sampler, starts, seeds, steps // 2, **arguments)


def test_ensembles_are_reproducible_and_independent_of_the_executor():
    first, acceptance = run()
    second, _ = run()
    with ThreadPoolExecutor(2) as executor:
        third, same = run(executor=executor)
    other, _ = run(seed=1)
    assert (first == second).all()
    assert (first == third).all()
    assert acceptance == same
    assert 0.2 < acceptance < 1.0
    assert (first != other).all()
    assert not np.allclose(first[0], first[1])


def test_chunks_grow_with_the_chain_and_end_at_the_limit():
    found = list(marks(1000))
    assert found[:4] == [20, 25, 30, 35]
    assert found[-1] == 1000
    assert max(np.diff(found)) <= 100
    assert len(found) <= 40


def test_ensembles_stop_when_told_and_say_how_far_they_came():
    told = []
    chains, _ = run(
        steps=2000,
        has_converged=lambda chains: chains.shape[1] >= 50,
        progress=lambda done, total: told.append((done, total)),
    )
    assert chains.shape == (2, 50, 16, P)
    assert told[0] == (80, 4000)
    assert told[-1] == (200, 200)
    whole, _ = run(steps=200)
    assert (chains == whole[:, :50]).all()


def test_an_interrupted_run_goes_on_as_if_nothing_had_happened(tmp_path):
    def stop(done, total):
        if done >= 240:
            raise KeyboardInterrupt

    whole, acceptance = run()
    path = tmp_path / "chains.h5"
    store = Store(path, "this one")
    with pytest.raises(KeyboardInterrupt):
        run(store=store, progress=stop)
    reader = emcee.backends.HDFBackend(str(path), name="ensemble_1", read_only=True)
    assert reader.iteration == 60
    resumed, same = run(store=store)
    assert (resumed == whole).all()
    assert same == acceptance
    assert (reader.get_chain() == whole[1]).all()
    assert (run(store=store)[0] == whole).all()  # nothing left to do
    longer, _ = run(steps=200, store=store)
    assert (longer == run(steps=200)[0]).all()
    assert (run(store=store)[0] == whole).all()  # more than is needed


def kept_run(path, **arguments):
    """A run of several chunks that are kept one after the other."""
    return run(steps=120, store=Store(Path(path), "killed"), **arguments)[0]


def test_killed_runs_lose_at_most_one_chunk_each(tmp_path):
    path = tmp_path / "chains.h5"
    # A chunk is two changes: a file is sealed and renamed. Kills come before the second chunk is in
    # its place, after that, and before the third is in its place.
    killed_again_and_again(kept_run, [str(path)], tmp_path, [4, 3, 2])
    kept = emcee.backends.HDFBackend(str(path), name="ensemble_0", read_only=True).iteration
    assert kept == 25
    # A kill amid the writing leaves half a file.
    (part,) = tmp_path.glob("*.part.h5")
    part.write_bytes(part.read_bytes()[:1000])
    told = []
    resumed = kept_run(path, progress=lambda done, _: told.append(done // 4))
    assert told[0] == 30
    assert (resumed == run(steps=120)[0]).all()


def test_files_that_hold_something_else_are_refused(tmp_path):
    path = tmp_path / "chains.h5"
    run(steps=40, store=Store(path, "one"))
    with pytest.raises(InvalidInput, match=r"chains\.h5: holds chains of another fit, seed"):
        run(steps=40, store=Store(path, "two"))
    with h5py.File(path, "a") as file:
        del file["ensemble_1/chain"]
    with pytest.raises(InvalidInput, match="not an HDF5 file of chains"):
        run(steps=40, store=Store(path, "one"))
    path.write_text("no chains")
    with pytest.raises(InvalidInput, match="not an HDF5 file of chains"):
        run(steps=40, store=Store(path, "one"))
    with pytest.raises(InvalidInput, match="cannot be written"):
        run(steps=40, store=Store(tmp_path / "nowhere" / "chains.h5", "one"))
