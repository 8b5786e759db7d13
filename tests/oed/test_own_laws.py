"""A noise law and a criterion of somebody else."""

from dataclasses import dataclass

import cvxpy as cp
import numpy as np
import pytest
from random_candidates import random_set

import estimators
import oed
import robotmodels
from robotmodels import kernel

ROBOT = robotmodels.load_robot("moberg_axis1")
POSITIONS, OMEGA = np.zeros((1, 1)), 2 * np.pi * np.linspace(2, 30, 20)


@dataclass(frozen=True)
class SensorNoise:
    std: float

    def variance(self, response):
        return np.full(response.shape, self.std**2)


class TwiceAsNoisy(robotmodels.RelativeNoise):
    def variance(self, response):
        return 4 * super().variance(response)


def test_information_of_a_law_of_ones_own():
    _, J = robotmodels.sensitivity(ROBOT, POSITIONS, OMEGA)
    J = J.reshape(-1, J.shape[-1])
    expected = 2 * (J.conj().T @ J).real / 0.3**2
    info = oed.information(ROBOT, POSITIONS, OMEGA, SensorNoise(0.3))
    np.testing.assert_allclose(info.matrices[0], expected, rtol=1e-9, atol=1e-9 * expected.max())
    network = ROBOT.network(POSITIONS)
    found = kernel.information(network, OMEGA, SensorNoise(0.3))[0]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * expected.max())


def test_the_compiled_law_does_not_stand_for_a_subclass():
    one = oed.information(ROBOT, POSITIONS, OMEGA, robotmodels.RelativeNoise()).matrices
    other = oed.information(ROBOT, POSITIONS, OMEGA, TwiceAsNoisy()).matrices
    np.testing.assert_allclose(other, one / 4, rtol=1e-9, atol=1e-9 * one.max())


def test_errors_scatter_by_the_law():
    positions, law = np.zeros((400, 1)), SensorNoise(0.3)
    truth = robotmodels.frequency_response(ROBOT, positions[:1], OMEGA)
    estimate = estimators.simulate_frf(ROBOT, positions, OMEGA, law, np.random.default_rng(0))
    error = np.abs(estimate.response - truth) ** 2
    assert error.mean() == pytest.approx(0.3**2, rel=5 / np.sqrt(error.size))
    assert (estimate.variance == 0.3**2).all()


@dataclass(frozen=True)
class LargestVariance:
    name: str = "largest variance"

    def objective(self, names, samples=1):
        means = [oed.MatrixMean("A", column[:, None]) for column in np.eye(len(names))]
        return oed.Objective(self.name, tuple((oed.Term(mean),) for mean in means))


@pytest.mark.parametrize("solver", ["newton", "cvxpy"])
def test_a_criterion_of_ones_own_against_its_convex_program(solver):
    info = random_set(4, 25, 3, 1)
    design = oed.optimal_design(info, LargestVariance(), solver=solver, tolerance=1e-6)
    w = cp.Variable(25, nonneg=True)
    M = cp.reshape(info.matrices.reshape(25, -1).T @ w, (3, 3), order="C")
    worst = cp.max(cp.hstack([cp.matrix_frac(e, M) for e in np.eye(3)]))
    best = cp.Problem(cp.Minimize(worst), [cp.sum(w) == 1]).solve(solver=cp.CLARABEL)
    largest = np.diag(np.linalg.inv(design.information)).max()
    assert largest == pytest.approx(best, rel=1e-5)
    exact = oed.exact_design(info, 9, criterion=LargestVariance())
    whole = np.diag(np.linalg.inv(info.combined(exact.repetitions / 9))).max()
    assert best * (1 - 1e-6) <= whole <= best / exact.efficiency * (1 + 1e-6)
