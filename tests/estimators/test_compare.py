import numpy as np
import pytest
from closed_loop import FEEDBACK, RESPONSE, Bench, bench_records, loop_spectra, references, truth

from estimators import Loop, compare_methods, designed_loop, measured_loop
from robotmodels import InvalidInput


def planned(std, blocks=10):
    return designed_loop(
        RESPONSE[None],
        FEEDBACK[None],
        FEEDBACK[None],
        references((blocks,), np.random.default_rng(0))[:, None],
        std**2 * np.eye(2)[None],
    )


def test_simulated_signals_are_the_closed_loops():
    loop = planned(0.2)
    Y, U, R = (a[:, 0] for a in loop.simulate(300, np.random.default_rng(1)))
    V = Y - RESPONSE @ U
    assert np.allclose(U, FEEDBACK @ (R - Y))  # the controller's law holds with the noise in Y
    assert np.mean(np.abs(V) ** 2) == pytest.approx(0.04, rel=0.05)
    assert abs(np.mean(V**2)) < 0.003  # circular


def test_ranking_is_the_published_one():
    rng = np.random.default_rng(3)
    bias = {std: compare_methods(planned(std), 1000, rng=rng) for std in (0.05, 0.3, 0.6)}
    for std, found in bias.items():
        by = dict(zip(found.methods, found.bias[:, 0], strict=True))
        assert max(by, key=by.__getitem__) == "h1"
        if std > 0.1:
            assert sorted(by, key=by.__getitem__)[-2] == "log"
    assert by["jio"] < by["ari"] < by["log"] < by["h1"]
    assert bias[0.6].best == "jio"
    assert (bias[0.6].scores > bias[0.05].scores).all()


def test_open_loops_prefer_least_squares():
    """Negative control: without feedback nothing biases h1, and it is the best there is."""
    loop = planned(0.6)
    opened = Loop(loop.response, 0 * loop.closed, loop.reference, loop.torque, loop.noise)
    found = compare_methods(opened, 1000, rng=np.random.default_rng(3))
    by = dict(zip(found.methods, found.error[:, 0], strict=True))
    assert by["h1"] < 1.1 * min(by.values())


def test_a_loop_is_recovered_from_records():
    setup = Bench(blocks=40, periods=2, noise=1e-4, feedback=20.0)
    loop = measured_loop(bench_records(setup))
    omega = bench_records(setup).omega
    G = truth(omega)
    size = np.abs(G).max(axis=(1, 2))
    assert np.median(np.abs(loop.response - G).max(axis=(1, 2)) / size) < 0.02
    # Torque per acceleration: the held proportional feedback over -omega^2.
    half = omega * 2e-3 / 2
    held = np.sinc(half / np.pi) * np.exp(-1j * half)
    F = (20.0 * held / -(omega**2))[:, None, None] * np.eye(2)
    C = np.linalg.solve(np.eye(2) + F @ G, F)
    low = slice(0, 10)
    error = np.abs(loop.closed - C).max(axis=(1, 2)) / np.abs(C).max(axis=(1, 2))
    assert np.median(error[low]) < 0.1
    # White noise of 500 samples and two periods, differentiated twice.
    expected = 1e-8 / 500 / 2 * omega**4
    found = np.trace(loop.noise, axis1=1, axis2=2).real / 2
    assert np.mean(found / expected) == pytest.approx(1, rel=0.05)


def test_measured_loops_feed_the_comparison():
    loop = measured_loop(bench_records(Bench(noise=1e-5, feedback=20.0)))
    found = compare_methods(loop, 50, rng=np.random.default_rng(1))
    assert found.methods == ("ari", "har", "log", "h1", "jio")
    assert (found.scores < 1).all()
    again = compare_methods(loop, 50, rng=np.random.default_rng(1), methods=("jio",))
    assert again.best == "jio"


def test_more_experiments_than_motors_leave_the_sums():
    loop = planned(0.1)
    wide = Loop(
        loop.response,
        loop.closed,
        np.concatenate([loop.reference] * 2, axis=-1),
        np.concatenate([loop.torque] * 2, axis=-1),
        loop.noise,
    )
    assert compare_methods(wide, 20, rng=np.random.default_rng(1)).methods == ("h1", "jio")


def test_shapes_and_too_few_blocks_are_refused():
    loop = planned(0.1)
    with pytest.raises(InvalidInput, match=r"noise: shape \(1, 2\) does not fit"):
        Loop(loop.response, loop.closed, loop.reference, loop.torque, np.ones((1, 2)))
    with pytest.raises(InvalidInput, match=r"leave 0 degrees of freedom .*measure another block"):
        measured_loop(bench_records(Bench(blocks=1)))


def test_the_planned_loop_is_the_one_of_the_methods_tests():
    _, U, _ = loop_spectra(1, 0.0, np.random.default_rng(0))
    loop = planned(0.1)
    assert np.allclose(np.abs(np.linalg.det(U[0, 0, 0])), np.abs(np.linalg.det(loop.torque[0, 0])))
