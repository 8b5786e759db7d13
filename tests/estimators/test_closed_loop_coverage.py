"""Repeated experiments from samples on: closed loop, FRF estimate, fit, intervals."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from closed_loop import _MASS, Bench, bench_records

from estimators import cross_check, estimate_frf, fit, monte_carlo
from robotmodels import Parameters, SpringNetwork

NAMES = ("k1", "k2", "k12", "c1", "c2", "c12")
TRUTH = np.array([9e3, 1.5e4, 4e3, 18.0, 30.0, 8.0])
BLOCKS = 12


@dataclass(frozen=True, eq=False)
class Pair:
    """The elastic pair of motors of `closed_loop`."""

    parameters: Parameters = field(default_factory=lambda: Parameters(NAMES, TRUTH, ("",) * 6))

    def network(self, positions, parameters=None):
        theta, q = self.parameters.check(parameters), len(positions)
        return SpringNetwork(
            mass=np.tile(_MASS, (q, 1, 1)),
            damping=np.diag([3.0, 3.0, 0.0, 0.0]),
            stiffness=np.zeros((q, 4, 4)),
            selector=np.eye(4)[:, :2],
            nodes=np.array([[0, 2], [1, 3], [2, 3]]),
            spring_stiffness=np.tile(theta[:3], (q, 1)),
            spring_damping=np.tile(theta[3:], (q, 1)),
            exponents=np.tile(np.eye(6), (q, 1, 1)),
            parameters=Parameters(NAMES, theta, ("",) * 6),
        )


@dataclass(frozen=True)
class ClosedLoop:
    """Noise goes through the feedback; a cubic spring at the motor is what no model knows."""

    cubic: float = 0.0
    noise: float = 2e-6

    def __call__(self, rng):
        seed = int(rng.integers(2**31))
        setup = Bench(blocks=BLOCKS, noise=self.noise, cubic=self.cubic, feedback=3000.0, seed=seed)
        return estimate_frf(bench_records(setup), method="jio")


def series(experiment, runs, methods=("theorem1",), **arguments):
    rng = np.random.default_rng(0)
    return monte_carlo(experiment, Pair(), rng=rng, runs=runs, methods=methods, **arguments)


def test_a_closed_loop_can_be_repeated():
    found = series(ClosedLoop(), 12)
    assert not found.failures
    assert found.overall("theorem1") > 0.7
    assert (np.abs(found.bias) < 5 * found.uncertainty().std / np.sqrt(12)).all()


def test_a_nonlinear_loop_is_flagged():
    wrong = ClosedLoop(cubic=0.05)
    found = series(wrong, 12)
    assert found.overall("theorem1") < 0.6
    one = fit(Pair(), wrong(np.random.default_rng(50)), "nls", "optimal")
    table = cross_check(one, monte_carlo=found)
    assert set(table.verdicts) == {"model error"}
    assert "theorem1" not in table.covering


@pytest.mark.slow
def test_covariances_estimated_from_few_blocks_are_allowed_for():
    found = series(ClosedLoop(), 100, ("recommended", "theorem1"))
    for method in found.methods:
        assert 0.92 < found.overall(method) < 0.98
    # Negative control: a quarter of the interval.
    half = (found.intervals[..., 1] - found.intervals[..., 0]) / 8
    error = found.estimates - np.log(found.truth)
    assert (np.abs(error[:, None]) < half).mean() < 0.60
