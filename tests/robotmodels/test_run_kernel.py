"""The compiled likelihood of runs, of motors' motions and of other outputs, against numpy."""

from pathlib import Path

import numpy as np
import pytest
from derivatives import circular

import robotmodels
from estimators import RunSpectra
from estimators.fitting import fixed_equilibrium_search
from estimators.fitting.fixed_equilibrium_search import can_compile, frozen_search
from estimators.fitting.run_problem import RunProblem
from estimators.fitting.search import exact_search
from robotmodels import ElasticRobot, InvalidInput
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
    """A robot of the library, with other outputs where they are named."""
    if outputs is None:
        return robotmodels.load_robot(name)
    content = read_robot_file(LIBRARY / f"{name}.yaml").model_dump(
        by_alias=True, exclude_unset=True
    )
    content["outputs"] = OUTPUTS[outputs]
    return ElasticRobot(RobotFile.model_validate(content), LIBRARY)


def problem_of(robot, runs, weighting, rank=None):
    """Noisy runs in two positions; errors of covariances of rank `rank`, full by default."""
    rng = np.random.default_rng(runs)
    n, F = len(robot.motor_names), len(OMEGA)
    positions = rng.uniform(-0.4, 0.4, (2, n))
    G = robotmodels.frequency_response(robot, positions, OMEGA)
    m = G.shape[2]
    U = circular(rng, 2, runs, F, n)
    Y = np.einsum("qfmn,qefn->qefm", G, U)
    std = np.concatenate([0.1 * np.sqrt((np.abs(Y) ** 2).mean((0, 1, 2))), np.full(n, 0.3)])
    mix = (np.eye(m + n) + 0.3 * circular(rng, m + n, m + n))[:, : rank or m + n]
    T = std[:, None] * mix
    N = np.einsum("ij,qefj->qefi", T, circular(rng, 2, runs, F, T.shape[1]))
    C = np.broadcast_to(T @ np.conj(T.T), (2, F, m + n, m + n))
    data = RunSpectra(positions, OMEGA, U + N[..., m:], Y + N[..., :m], C)
    bounds = np.outer([1e-3, 1e3], robot.parameters.values)
    return RunProblem(model=robot, data=data, weighting=weighting, bounds=bounds)


CASES = [
    (None, "moberg_axis1", 1, "joint", None),
    (None, "moberg_axis1", 3, "row_wise", None),
    (None, "manutec_r3", 1, "joint", None),
    (None, "manutec_r3", 2, "row_wise", None),
    (None, "manutec_r3", 6, "joint", 6),
    (None, "manutec_r3_26", 9, "joint", None),
    (None, "manutec_r3_26", 15, "row_wise", None),
    ("links", "manutec_r3_26", 1, "joint", None),
    ("links", "manutec_r3_26", 7, "row_wise", None),
    ("torques", "manutec_r3_26", 2, "joint", None),
    ("torques", "manutec_r3_26", 1, "row_wise", None),
    ("mixed", "manutec_r3_26", 6, "joint", None),
    ("mixed", "manutec_r3_26", 1, "row_wise", None),
    ("one", "manutec_r3_26", 3, "joint", None),
]


def accuracy(outputs):
    """Matrices of other outputs are worse conditioned."""
    return 1e-11 if outputs is None else 1e-10


@pytest.mark.parametrize(("outputs", "name", "runs", "weighting", "rank"), CASES)
def test_cost_and_derivatives_are_those_of_numpy(outputs, name, runs, weighting, rank):
    problem, accurate = (
        problem_of(robot_with(outputs, name), runs, weighting, rank),
        accuracy(outputs),
    )
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
    both = kernel(np.stack([values, theta]))
    assert both[0] == pytest.approx(cost, rel=accurate)
    normal = kernel.normal_equations(values)
    assert normal.cost == pytest.approx(cost, rel=accurate)
    scale = np.abs(gradient).max()
    np.testing.assert_allclose(normal.gradient, gradient, atol=10 * accurate * scale)
    np.testing.assert_allclose(kernel.gradient(values)[1], gradient, atol=10 * accurate * scale)
    assert np.abs((normal.hessian - hessian) / np.outer(size, size)).max() < 10 * accurate


@pytest.mark.parametrize(
    ("outputs", "weighting"),
    [(None, "joint"), (None, "row_wise"), ("links", "joint"), ("torques", "row_wise")],
)
def test_slopes_by_stiffness_and_mass_are_those_of_numpy(outputs, weighting):
    name = "manutec_r3_26" if outputs else "manutec_r3"
    problem = problem_of(robot_with(outputs, name), 2, weighting)
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
        np.testing.assert_allclose(
            computed, numpy_slope, atol=10 * accuracy(outputs) * np.abs(numpy_slope).max()
        )


def test_other_networks_are_refused():
    problem = problem_of(robot_with(None, "manutec_r3"), 1, "joint")
    network = problem.model.network(problem.positions)
    bent = network.__class__(**{**network.__dict__, "selector": np.ones_like(network.selector)})
    with pytest.raises(InvalidInput, match="motors that act on one coordinate"):
        problem.kernel(bent)
    assert not problem.compiles(bent)


def test_compiled_and_exact_searches_end_in_one_minimum(monkeypatch):
    problem = problem_of(robot_with("links", "manutec_r3"), 2, "joint")
    start = problem.model.parameters.values * np.exp(0.1 * np.cos(np.arange(6)))
    network = problem.model.network(problem.positions)
    monkeypatch.setattr(fixed_equilibrium_search, "WORTHWHILE", 0)
    assert can_compile(problem, network)
    fast = frozen_search(problem, start, network, 100, 1e-10)
    exact = exact_search(problem, start, 100, 1e-10)
    assert fast.cost == pytest.approx(exact.cost, rel=1e-8)
    np.testing.assert_allclose(fast.values, exact.values, rtol=1e-4)
    turning = problem_of(robot_with("one", "manutec_r3"), 1, "joint")
    assert not can_compile(turning, turning.model.network(turning.positions))
