"""The compiled likelihood of runs with other outputs than the motors' motions, against numpy."""

from pathlib import Path

import numpy as np
import pytest

import robotmodels
from estimators import RunSpectra
from estimators.fitting import fixed_equilibrium_search
from estimators.fitting.fixed_equilibrium_search import can_compile, frozen_search
from estimators.fitting.run_problem import RunProblem
from estimators.fitting.trust_region import exact_search
from robotmodels import ElasticRobot
from robotmodels.description.robot_file import RobotFile, read_robot_file

LIBRARY = Path(robotmodels.__file__).parent / "library"
OMEGA = 2 * np.pi * np.linspace(3.0, 60.0, 11)
MOTORS = [{"motor": f"m{i}", "quantity": "angle"} for i in range(1, 7)]
LINKS = [{"joint": f"joint{i}", "quantity": "angle"} for i in range(1, 4)]
TORQUES = [{"spring": name, "quantity": "torque"} for name in ("g1", "g2", "b3y", "g6")]
LATE = {"gain": -1.1, "delay": 1e-3, "lag": 2e-3}
TIP = {"link": "link6", "quantity": "acceleration", "direction": [0.3, 0.2, 1.0]}
OUTPUTS = {
    "links": MOTORS + LINKS,
    "torques": [TORQUES[0] | LATE, *TORQUES[1:], {"motor": "m2", "quantity": "torque"}],
    "mixed": [MOTORS[1] | LATE, LINKS[2], TORQUES[2], TIP],
    "one": [TIP],
}


def robot_with(outputs, name="manutec_r3_26"):
    content = read_robot_file(LIBRARY / f"{name}.yaml").model_dump(
        by_alias=True, exclude_unset=True
    )
    return ElasticRobot(RobotFile.model_validate(content | {"outputs": outputs}), LIBRARY)


def circular(rng, *shape):
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


def problem_of(outputs, runs, weighting, name="manutec_r3_26"):
    rng = np.random.default_rng(runs)
    robot = robot_with(OUTPUTS[outputs], name)
    positions = rng.uniform(-0.4, 0.4, (2, 6))
    G = robotmodels.frequency_response(robot, positions, OMEGA)
    m, F = G.shape[2], len(OMEGA)
    U = circular(rng, 2, runs, F, 6)
    Y = np.einsum("qfmn,qefn->qefm", G, U)
    std = np.concatenate([0.1 * np.sqrt((np.abs(Y) ** 2).mean((0, 1, 2))), np.full(6, 0.3)])
    T = std[:, None] * (np.eye(m + 6) + 0.3 * circular(rng, m + 6, m + 6))
    N = np.einsum("ij,qefj->qefi", T, circular(rng, 2, runs, F, m + 6))
    C = np.broadcast_to(T @ np.conj(T.T), (2, F, m + 6, m + 6))
    data = RunSpectra(positions, OMEGA, U + N[..., m:], Y + N[..., :m], C)
    bounds = np.outer([1e-3, 1e3], robot.parameters.values)
    return RunProblem(model=robot, data=data, weighting=weighting, bounds=bounds)


CASES = [
    ("links", 1, "joint"),
    ("links", 7, "row_wise"),
    ("torques", 2, "joint"),
    ("torques", 1, "row_wise"),
    ("mixed", 6, "joint"),
    ("mixed", 1, "row_wise"),
    ("one", 3, "joint"),
]


@pytest.mark.parametrize(("outputs", "runs", "weighting"), CASES)
def test_cost_and_derivatives_are_those_of_numpy(outputs, runs, weighting):
    problem = problem_of(outputs, runs, weighting)
    theta = problem.model.parameters.values
    network = problem.model.network(problem.positions, theta)
    assert problem.compiles(network)
    values = theta * np.exp(0.1 * np.cos(np.arange(len(theta))))
    G, J = network.sensitivity(OMEGA, values)
    errors = problem.likelihood.errors(G)
    white = errors.whitened.reshape(-1)
    slopes = -problem.likelihood.whitened_changes(errors, J).reshape(len(white), -1)
    cost, gradient = np.sum(np.abs(white) ** 2), 2 * (np.conj(slopes).T @ white).real
    hessian = 2 * (np.conj(slopes).T @ slopes).real
    size = np.sqrt(np.diag(hessian))

    kernel = problem.kernel(network)
    assert kernel(values[None])[0] == pytest.approx(cost, rel=1e-10)
    normal = kernel.normal_equations(values)
    assert normal.cost == pytest.approx(cost, rel=1e-10)
    np.testing.assert_allclose(normal.gradient, gradient, atol=1e-9 * np.abs(gradient).max())
    assert np.abs((normal.hessian - hessian) / np.outer(size, size)).max() < 1e-9


@pytest.mark.parametrize(("outputs", "weighting"), [("links", "joint"), ("torques", "row_wise")])
def test_slopes_by_stiffness_and_mass_are_those_of_numpy(outputs, weighting):
    problem = problem_of(outputs, 2, weighting)
    network = problem.model.network(problem.positions)
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
        np.testing.assert_allclose(computed, numpy_slope, atol=1e-9 * np.abs(numpy_slope).max())


def test_compiled_and_exact_searches_end_in_one_minimum(monkeypatch):
    problem = problem_of("links", 2, "joint", "manutec_r3")
    start = problem.model.parameters.values * np.exp(0.1 * np.cos(np.arange(6)))
    network = problem.model.network(problem.positions)
    monkeypatch.setattr(fixed_equilibrium_search, "WORTHWHILE", 0)
    assert can_compile(problem, network)
    fast = frozen_search(problem, start, network, 100, 1e-10)
    exact = exact_search(problem, start, 100, 1e-10)
    assert fast.cost == pytest.approx(exact.cost, rel=1e-8)
    np.testing.assert_allclose(fast.values, exact.values, rtol=1e-4)
    turning = problem_of("one", 1, "joint", "manutec_r3")
    assert not can_compile(turning, turning.model.network(turning.positions))
