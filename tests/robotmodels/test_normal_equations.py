"""Gauss-Newton's matrices of the kernel against plain numpy and finite differences."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numba
import numpy as np
import pytest
from derivatives import by_logarithms
from spring_networks import NETWORKS, robot

from robotmodels import kernel
from robotmodels.common.errors import InvalidInput
from robotmodels.kernel.elimination_order import layout

OMEGA = 2 * np.pi * np.linspace(2, 80, 21)
RESIDUALS = ("nls", "lls", "lls_magnitude")


@pytest.fixture(params=NETWORKS, name="network")
def _network(request):
    return NETWORKS[request.param](np.random.default_rng(7))


def _data(network, rng):
    """Return noisy FRFs, weights of which one in ten is zero, and parameters off the network's."""
    G = network.frequency_response(OMEGA)
    measured = G * (1 + 0.3 * rng.normal(size=G.shape) + 0.3j * rng.normal(size=G.shape))
    weights = rng.uniform(0, 1, G.shape) / np.abs(G).max(axis=(-2, -1), keepdims=True) ** 2
    weights[rng.uniform(size=G.shape) < 0.1] = 0.0
    measured[weights == 0] = rng.choice([0, np.nan, np.inf], np.sum(weights == 0))
    theta = network.parameters.values * np.exp(0.3 * rng.normal(size=len(network.parameters)))
    return measured, weights, theta


def _residuals(network, measured, weights, residual, theta):
    """Return the used residuals, times the roots of their weights."""
    used = weights > 0
    G, measured = network.frequency_response(OMEGA, theta)[used], measured[used]
    apart = measured - G if residual == "nls" else np.log(measured / G)
    return np.sqrt(weights[used]) * (apart.real if residual == "lls_magnitude" else apart)


def _slopes(network, weights, residual, theta):
    """Return their derivatives by ln theta, from the network's sensitivities."""
    used = weights > 0
    G, J = network.sensitivity(OMEGA, theta)
    J = -J[used] if residual == "nls" else -J[used] / G[used][:, None]
    return np.sqrt(weights[used])[:, None] * (J.real if residual == "lls_magnitude" else J)


@pytest.mark.parametrize("residual", RESIDUALS)
def test_normal_equations_agree_with_sensitivities(network, residual):
    measured, weights, theta = _data(network, np.random.default_rng(3))
    found = kernel.CostKernel(network, OMEGA, measured, weights, residual).normal_equations(theta)
    r = _residuals(network, measured, weights, residual, theta)
    J = _slopes(network, weights, residual, theta)
    hessian = 2 * (J.conj().T @ J).real
    size = np.sqrt(np.diag(hessian))
    assert found.cost == pytest.approx(np.linalg.norm(r) ** 2, rel=1e-11)
    gradient = 2 * (J.conj().T @ r).real
    np.testing.assert_allclose(
        found.gradient / size, gradient / size, rtol=0, atol=1e-11 * found.cost**0.5
    )
    outer = np.outer(size, size)
    np.testing.assert_allclose(found.hessian / outer, hessian / outer, rtol=0, atol=1e-11)


@pytest.mark.parametrize("residual", RESIDUALS)
def test_the_gradient_is_that_of_the_cost(network, residual):
    measured, weights, theta = _data(network, np.random.default_rng(5))
    cost = kernel.CostKernel(network, OMEGA, measured, weights, residual)
    found, step = cost.normal_equations(theta), 1e-5
    assert found.cost == pytest.approx(cost(theta)[0], rel=1e-12)
    steps = np.exp(step * np.eye(len(theta)))
    differences = (cost(theta * steps) - cost(theta / steps)) / (2 * step)
    size = np.sqrt(np.diag(found.hessian) * found.cost)
    np.testing.assert_allclose(found.gradient / size, differences / size, atol=5e-6)
    alone = cost.gradient(theta)  # without the matrix
    assert alone[0] == pytest.approx(found.cost, rel=1e-12)
    np.testing.assert_allclose(alone[1] / size, found.gradient / size, rtol=0, atol=1e-12)


@pytest.mark.parametrize("residual", RESIDUALS)
def test_without_residuals_the_matrix_is_the_second_derivative(residual):
    network = NETWORKS["chains"](np.random.default_rng(2))
    G, theta = network.frequency_response(OMEGA), network.parameters.values
    cost = kernel.CostKernel(network, OMEGA, G, 1 / np.abs(G) ** 2, residual)
    hessian = cost.normal_equations(theta).hessian
    differences = by_logarithms(lambda at: cost.normal_equations(at).gradient, theta, 1e-4)
    np.testing.assert_allclose(differences, hessian, atol=1e-5 * hessian.max())


@pytest.mark.parametrize("residual", RESIDUALS)
def test_a_response_that_is_zero_by_structure_may_go_without_weight(residual):
    network = NETWORKS["chains"](np.random.default_rng(2))
    mass = network.mass.copy()
    mass[:, 2, 5] = mass[:, 5, 2] = 0.0
    network = replace(network, mass=mass)
    G = network.frequency_response(OMEGA)
    weights = np.where(np.abs(G) > 0, 1.0, 0.0)
    assert not weights[..., 0, 1].any()
    cost = kernel.CostKernel(network, OMEGA, 1.1 * G, weights, residual)
    theta = 1.01 * network.parameters.values
    found = cost.normal_equations(theta)
    r = _residuals(network, 1.1 * G, weights, residual, theta)
    assert found.cost == pytest.approx(np.linalg.norm(r) ** 2, rel=1e-10)
    assert cost(theta)[0] == pytest.approx(found.cost, rel=1e-10)
    assert np.isfinite(found.hessian).all()
    assert np.isfinite(found.gradient).all()


def test_a_kernel_about_other_equilibria_is_one_made_for_them(network):
    measured, weights, theta = _data(network, np.random.default_rng(3))
    other = replace(network, mass=1.1 * network.mass, stiffness=network.stiffness + 3.0)
    found = kernel.CostKernel(network, OMEGA, measured, weights, "lls").at(other)
    expected = kernel.CostKernel(other, OMEGA, measured, weights, "lls")
    assert found(theta)[0] == expected(theta)[0]
    np.testing.assert_array_equal(
        found.normal_equations(theta).hessian, expected.normal_equations(theta).hessian
    )
    with pytest.raises(InvalidInput, match="the same positions and coordinates are needed"):
        found.at(replace(network, mass=network.mass[:1]))


@pytest.mark.parametrize("residual", RESIDUALS)
def test_slopes_by_the_matrices_agree_with_differences(network, residual):
    rng = np.random.default_rng(8)
    measured, weights, _ = _data(network, rng)
    theta, step = network.parameters.values, 1e-8
    found = kernel.CostKernel(network, OMEGA, measured, weights, residual).model_slopes()
    for name, slope in zip(("stiffness", "mass"), found, strict=True):
        factors = rng.normal(size=slope.shape)
        change = (factors + factors.swapaxes(1, 2)) * getattr(network.linear_model(), name)
        costs = []
        for sign in (1, -1):
            moved = replace(network, **{name: getattr(network, name) + sign * step * change})
            r = _residuals(moved, measured, weights, residual, theta)
            costs.append(np.linalg.norm(r) ** 2)
        expected = (costs[0] - costs[1]) / (2 * step)
        size = np.abs(slope * change).max()
        assert np.sum(slope * change) == pytest.approx(expected, abs=1e-4 * size)


def test_a_small_pivot_before_the_free_springs_is_met_with_pivoting():
    """The first coordinate to be eliminated has no stiffness and no mass of its own there."""
    network = robot(np.random.default_rng(3), n_positions=1, n=3, n_torsions=5, n_free_torsions=2)
    plan = layout(network)
    c, w = plan.order[plan.pad], OMEGA[4]
    a = network.incidence()
    K = network.stiffness[0] + (a.T * network.spring_stiffness[0]) @ a
    stiffness, damping = network.stiffness.copy(), network.damping.copy()
    stiffness[0, c, c] += w**2 * network.mass[0, c, c] - K[c, c]
    damping[0, c, c] -= (network.spring_damping[0] @ a**2)[c]
    network = replace(network, stiffness=stiffness, damping=damping)
    measured, weights, theta = _data(network, np.random.default_rng(1))
    found = kernel.CostKernel(network, OMEGA, measured, weights).normal_equations(theta)
    r = _residuals(network, measured, weights, "nls", theta)
    assert found.cost == pytest.approx(np.linalg.norm(r) ** 2, rel=1e-9)


def _large():
    network = robot(np.random.default_rng(4), n_positions=40)
    measured, weights, theta = _data(network, np.random.default_rng(1))
    return kernel.CostKernel(network, OMEGA, measured, weights, "lls"), theta


def test_threads_change_nothing_at_all():
    cost, theta = _large()
    before = numba.get_num_threads()
    found = []
    for threads in (1, numba.config.NUMBA_NUM_THREADS):
        numba.set_num_threads(threads)
        found.append(cost.normal_equations(theta))
    numba.set_num_threads(before)
    np.testing.assert_array_equal(found[0].gradient, found[1].gradient)
    np.testing.assert_array_equal(found[0].hessian, found[1].hessian)


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_forked_processes_compute_the_same():
    cost, theta = _large()
    here = cost.normal_equations(theta)
    with ProcessPoolExecutor(2) as pool:
        for there in pool.map(cost.normal_equations, [theta, theta]):
            np.testing.assert_array_equal(there.gradient, here.gradient)


@pytest.mark.parametrize(("residual", "value"), [("lls", 0.0), ("nls", np.nan)])
def test_a_measured_value_that_cannot_be_compared_is_named(residual, value):
    network = NETWORKS["chains"](np.random.default_rng(2))
    measured = network.frequency_response(OMEGA)
    measured[1, 3, 0, 1] = value
    with pytest.raises(InvalidInput, match=r"input \(1, 3, 0, 1\); a finite FRF"):
        kernel.CostKernel(network, OMEGA, measured, np.ones(measured.shape), residual)


def test_wrong_parameters_are_named():
    cost, theta = _large()
    with pytest.raises(InvalidInput, match=r"\(26,\) is needed"):
        cost.normal_equations(theta[:-1])
    with pytest.raises(InvalidInput, match="parameter k0: -1 is not a positive number"):
        cost.normal_equations(np.where(np.arange(26) == 0, -1.0, theta))
