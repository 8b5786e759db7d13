"""The compiled likelihood of runs, against numpy."""

import numpy as np
import pytest

import robotmodels
from estimators import RunSpectra
from estimators.fitting.run_problem import RunProblem
from robotmodels import InvalidInput

OMEGA = 2 * np.pi * np.linspace(3.0, 60.0, 11)


def circular(rng, *shape):
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


def problem_of(name, runs, weighting, rank=None):
    """Noisy runs of a robot in two positions; errors of covariances of rank `rank` at least n."""
    rng = np.random.default_rng(runs)
    robot = robotmodels.load_robot(name)
    n, F = len(robot.motor_names), len(OMEGA)
    positions = rng.uniform(-0.4, 0.4, (2, n))
    G = robotmodels.frequency_response(robot, positions, OMEGA)
    U = circular(rng, 2, runs, F, n)
    Y = np.einsum("qfmn,qefn->qefm", G, U)
    std = np.concatenate([0.1 * np.sqrt((np.abs(Y) ** 2).mean((0, 1, 2))), np.full(n, 0.3)])
    mix = (np.eye(2 * n) + 0.3 * circular(rng, 2 * n, 2 * n))[:, : rank or 2 * n]
    T = std[:, None] * mix
    N = np.einsum("ij,qefj->qefi", T, circular(rng, 2, runs, F, T.shape[1]))
    C = np.broadcast_to(T @ np.conj(T.T), (2, F, 2 * n, 2 * n))
    data = RunSpectra(positions, OMEGA, U + N[..., n:], Y + N[..., :n], C)
    bounds = np.outer([1e-3, 1e3], robot.parameters.values)
    return RunProblem(model=robot, data=data, weighting=weighting, bounds=bounds)


CASES = [
    ("moberg_axis1", 1, "joint", None),
    ("moberg_axis1", 3, "row_wise", None),
    ("manutec_r3", 1, "joint", None),
    ("manutec_r3", 2, "row_wise", None),
    ("manutec_r3", 6, "joint", 6),
    ("manutec_r3_26", 9, "joint", None),
    ("manutec_r3_26", 15, "row_wise", None),
]


@pytest.mark.parametrize(("name", "runs", "weighting", "rank"), CASES)
def test_cost_and_derivatives_are_those_of_numpy(name, runs, weighting, rank):
    problem = problem_of(name, runs, weighting, rank)
    theta = problem.model.parameters.values
    network = problem.model.network(problem.positions, theta)
    values = theta * np.exp(0.1 * np.cos(np.arange(len(theta))))
    G, J = network.sensitivity(OMEGA, values)
    errors = problem.likelihood.errors(G)
    white = errors.whitened.reshape(-1)
    slopes = -problem.likelihood.whitened_changes(errors, J).reshape(len(white), -1)
    cost, gradient = np.sum(np.abs(white) ** 2), 2 * (np.conj(slopes).T @ white).real
    hessian = 2 * (np.conj(slopes).T @ slopes).real
    size = np.sqrt(np.diag(hessian))

    kernel = problem.kernel(network)
    both = kernel(np.stack([values, theta]))
    assert both[0] == pytest.approx(cost, rel=1e-11)
    normal = kernel.normal_equations(values)
    assert normal.cost == pytest.approx(cost, rel=1e-11)
    scale = np.abs(gradient).max()
    np.testing.assert_allclose(normal.gradient, gradient, atol=1e-10 * scale)
    np.testing.assert_allclose(kernel.gradient(values)[1], gradient, atol=1e-10 * scale)
    assert np.abs((normal.hessian - hessian) / np.outer(size, size)).max() < 1e-10


@pytest.mark.parametrize("weighting", ["joint", "row_wise"])
def test_slopes_by_stiffness_and_mass_are_those_of_numpy(weighting):
    problem = problem_of("manutec_r3", 2, weighting)
    theta = problem.model.parameters.values
    network = problem.model.network(problem.positions, theta)
    model = network.linear_model()
    X, Z = model.receptances(OMEGA)
    errors = problem.likelihood.errors(model.frequency_response(OMEGA))
    if weighting == "joint":
        s = np.linalg.solve(np.conj(np.swapaxes(errors.root, -1, -2)), errors.whitened)
        slope = -s @ np.conj(np.swapaxes(errors.inputs, -1, -2))
    else:
        s = errors.whitened / errors.root[..., None]
        slope = -np.einsum("qfme,qfmne->qfmn", s, np.conj(errors.inputs))
    T = (Z @ np.conj(slope) @ np.swapaxes(X, -1, -2)).real
    T = (T + np.swapaxes(T, -1, -2)) / 2
    by_stiffness, by_mass = problem.kernel(network).model_slopes()
    expected = -2 * T.sum(axis=1), 2 * np.einsum("f,qfij->qij", OMEGA**2, T)
    for computed, numpy_slope in zip((by_stiffness, by_mass), expected, strict=True):
        np.testing.assert_allclose(computed, numpy_slope, atol=1e-10 * np.abs(numpy_slope).max())


def test_other_networks_are_refused():
    problem = problem_of("manutec_r3", 1, "joint")
    network = problem.model.network(problem.positions)
    bent = network.__class__(**{**network.__dict__, "selector": np.ones_like(network.selector)})
    with pytest.raises(InvalidInput, match="motors that act on one coordinate"):
        problem.kernel(bent)
    assert not problem.compiles(bent)
