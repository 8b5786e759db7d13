import numpy as np
import pytest
from mass_springs import OMEGA, POSITIONS, MassSprings
from scipy.stats import chi2
from test_frf_estimate import full_covariance
from test_least_squares import MODEL, TRUTH, exact, noisy

from estimators import Uncertainty, covariance, fit, information, multistart, simulate_frf
from estimators.fitting.residuals import find_residual
from estimators.fitting.sandwich import weighted_noise
from estimators.trust.linearised_fit import sandwich
from robotmodels import (
    InvalidInput,
    NotIdentifiable,
    Parameters,
    RelativeNoise,
    SolverFailed,
    SpringNetwork,
    sensitivity,
)

NAMES = ("a", "b", "c")


def psi_t(jacobian, q, f):
    """[WM]'s Psi^T: (m n, p), columns of G stacked."""
    return np.stack(
        [jacobian[q, f, :, :, i].flatten(order="F") for i in range(jacobian.shape[-1])], axis=1
    )


def brute_information(jacobian, inverse):
    total = np.zeros((jacobian.shape[-1],) * 2)
    for q, f in np.ndindex(jacobian.shape[:2]):
        t = psi_t(jacobian, q, f)
        total += 2 * (t.conj().T @ inverse[q, f] @ t).real
    return total


def test_information_equals_the_written_out_sum():
    rng = np.random.default_rng(0)
    J = rng.standard_normal((2, 3, 2, 3, 4)) + 1j * rng.standard_normal((2, 3, 2, 3, 4))
    full = full_covariance((2, 3, 2, 3))
    found = information(J, full)
    assert found.shape == (2, 4, 4)
    assert np.allclose(found.sum(axis=0), brute_information(J, full))
    elements = rng.random((2, 3, 2, 3))
    as_full = np.zeros((2, 3, 6, 6))
    for q, f in np.ndindex(2, 3):
        as_full[q, f] = np.diag(elements[q, f].flatten(order="F"))
    assert np.allclose(information(J, elements), information(J, as_full))
    assert np.allclose(information(J.real, full), information(J.real, full.real))
    with pytest.raises(InvalidInput, match="does not fit"):
        information(J, elements[..., :2])


def wm_5(J, xi, sigma):
    """P_theta / N_f of [WM] (5), as printed."""
    bread = brute_information(J, xi) / 2
    meat = brute_information(J, sigma) / 2
    return np.linalg.inv(bread) @ meat @ np.linalg.inv(bread) / 2


@pytest.mark.parametrize("weights", ["user", "optimal", "full"])
@pytest.mark.parametrize("noise", ["elements", "full"])
@pytest.mark.parametrize("residual", ["nls", "lls"])
def test_wm_theorem_1_as_printed(residual, noise, weights):
    given = full_covariance((3, 23, 2, 2)) if noise == "full" else None
    estimate = exact(given)
    if weights == "full":
        weights = full_covariance((3, 23, 2, 2), seed=9)
    found = fit(MODEL, estimate, residual, weights)
    G, J = sensitivity(MODEL, POSITIONS, OMEGA, found.parameters.values)
    xi = np.zeros((3, 23, 4, 4), dtype=complex)
    sigma = xi.copy()
    for q, f in np.ndindex(3, 23):
        lambda_0 = estimate.covariance[q, f]
        lambda_0 = lambda_0 if noise == "full" else np.diag(lambda_0.flatten(order="F"))
        inverse = found.weights[q, f]
        if found.weights.shape == G.shape:
            # Full matrices only where the noise or the user gives them.
            inverse = np.diag(inverse.flatten(order="F"))
        if residual == "lls":
            g_d = np.diag(G[q, f].flatten(order="F"))
            inverse = np.linalg.inv(g_d @ np.linalg.inv(inverse) @ g_d.conj().T)
        xi[q, f], sigma[q, f] = inverse, inverse @ lambda_0 @ inverse
    assert np.allclose(covariance(found).covariance, wm_5(J, xi, sigma), rtol=1e-6)


@pytest.mark.parametrize("noise", ["elements", "full"])
def test_optimal_lls_and_nls_have_the_same_covariance(noise):
    estimate = exact(full_covariance((3, 23, 2, 2)) if noise == "full" else None)
    nls, lls = (covariance(fit(MODEL, estimate, r, "optimal")) for r in ("nls", "lls"))
    assert np.allclose(nls.covariance, lls.covariance, rtol=1e-6)
    # Under optimal weights (5) is the inverse information.
    _, J = sensitivity(MODEL, POSITIONS, OMEGA)
    w = np.linalg.inv(estimate.covariance) if noise == "full" else 1 / estimate.covariance
    assert np.allclose(nls.covariance, np.linalg.inv(information(J, w).sum(axis=0)), rtol=1e-6)


def test_optimal_weights_are_best_and_phases_help():
    estimate = noisy()
    best = covariance(fit(MODEL, estimate, "nls", "optimal")).covariance
    for residual in ("nls", "lls", "lls_magnitude"):
        other = covariance(fit(MODEL, estimate, residual, "user")).covariance
        assert np.linalg.eigvalsh(other - 0.95 * best).min() > 0
    magnitude = covariance(fit(MODEL, estimate, "lls_magnitude", "optimal")).std
    assert (magnitude > np.sqrt(np.diag(best))).all()


@pytest.mark.parametrize("real", [False, True])
@pytest.mark.parametrize("full", [False, True])
def test_sandwich_equals_the_scatter_of_a_linear_problem(real, full):
    """The residual noise - Psi x has its minimum at x = bread^-1 2 Re(Psi^H W noise)."""
    rng = np.random.default_rng(4)
    shape = (1, 3, 2, 2)
    psi = rng.standard_normal((*shape, 3)) + 1j * rng.standard_normal((*shape, 3))
    W = full_covariance(shape, seed=6) if full else rng.random(shape) + 0.1
    R = full_covariance(shape, seed=7)
    if real:
        psi, W, noise_law = psi.real, W.real, R.real
    else:
        noise_law = R
    bread = information(psi, W)[0]
    claimed = sandwich(bread, information(psi, weighted_noise(W, noise_law, shape))[0], NAMES)
    n, gradient = 20000, 0.0
    for f in range(3):
        root = np.linalg.cholesky(R[0, f])
        z = rng.standard_normal((4, n)) + 1j * rng.standard_normal((4, n))
        eta = root @ z / np.sqrt(2)  # circular, covariance R
        w = W[0, f] if full else np.diag(W[0, f].flatten(order="F"))
        t = psi_t(psi, 0, f)
        gradient = gradient + 2 * (t.conj().T @ w @ (eta.real if real else eta)).real
    scatter = np.cov(np.linalg.solve(bread, gradient))
    inner = np.linalg.inv(np.linalg.cholesky(claimed))
    ratio = np.linalg.eigvalsh(inner @ scatter @ inner.T)
    assert ratio.min() > 0.94
    assert ratio.max() < 1.06
    assert not np.allclose(claimed, np.linalg.inv(bread), rtol=0.1)  # the meat matters


def test_element_noise_in_full_weights():
    shape = (1, 1, 2, 2)
    W, r = full_covariance(shape), np.array([[[[1.0, 2.0], [3.0, 4.0]]]])
    expected = W @ np.diag([1.0, 3.0, 2.0, 4.0]) @ W
    assert np.allclose(weighted_noise(W, r, shape), expected)


def coverage(errors, std):
    return float(np.mean(np.abs(errors) < 1.96 * std))


@pytest.mark.parametrize(
    ("residual", "weights", "noise", "n"),
    [
        ("nls", "optimal", RelativeNoise(0.05, 0.02), 30),
        pytest.param("lls", "user", RelativeNoise(0.02, 0.0), 100, marks=pytest.mark.slow),
    ],
)
def test_fits_scatter_about_the_truth_as_theorem_1_claims(residual, weights, noise, n):
    rng = np.random.default_rng(11)
    omega, positions = OMEGA[::2], POSITIONS[:2]
    errors, stds, squares = [], [], []
    for _ in range(n):
        estimate = simulate_frf(MODEL, positions, omega, noise, rng)
        found = fit(MODEL, estimate, residual, weights, tolerance=1e-8)
        u = covariance(found)
        error = np.log(found.parameters.values / TRUTH)
        errors.append(error)
        stds.append(u.std)
        squares.append(error @ np.linalg.solve(u.covariance, error))
    low, high = chi2.ppf([0.001, 0.999], 6 * n)
    assert low < np.sum(squares) < high
    assert not low < np.sum(squares) / 0.25 < high  # negative control: a quarter of the covariance
    within = 3 * np.sqrt(0.95 * 0.05 / (6 * n))
    assert abs(coverage(np.array(errors), np.array(stds)) - 0.95) < within
    assert coverage(np.array(errors), 0.5 * np.array(stds)) < 0.80


class Blind(MassSprings):
    """Its second motor is locked away: nothing is seen of c2 in any element, or k1 = k2 share."""

    def __init__(self, exponents):
        super().__init__()
        object.__setattr__(self, "_exponents", exponents)

    def network(self, positions, parameters=None):
        network = super().network(positions, parameters)
        k = np.exp(self._exponents @ np.log(network.parameters.values))
        q = len(positions)
        return SpringNetwork(
            **vars(network)
            | {
                "spring_stiffness": np.tile(k[:3], (q, 1)),
                "spring_damping": np.tile(k[3:], (q, 1)),
                "exponents": np.tile(self._exponents, (q, 1, 1)),
            }
        )


def _exponents(change):
    e = np.eye(6)
    if change != "product":
        e[4, 4] = 0.0  # c2 acts nowhere
    if change != "absent":
        e[0, :2] = 0.5  # only the product k1 k2 acts
        e[1, :2] = 0.5
    return e


@pytest.mark.parametrize(
    ("change", "names"),
    [("absent", ("c2",)), ("product", ("k1", "k2")), ("both", ("k1", "k2", "c2"))],
)
def test_parameters_without_information_are_named(change, names):
    model = Blind(_exponents(change))
    estimate = simulate_frf(model, POSITIONS, OMEGA, RelativeNoise(), np.random.default_rng(0))
    with pytest.raises(NotIdentifiable, match="add positions") as caught:
        covariance(fit(model, estimate))
    assert caught.value.names == names


def test_a_search_that_did_not_begin_has_no_covariance():
    (failed,) = multistart(MassSprings(weakest=1e3), exact(), [TRUTH])
    with pytest.raises(SolverFailed, match="k1 = 900 is below 1000"):
        covariance(failed)


def test_a_fit_that_has_not_converged_says_so():
    found = fit(MODEL, noisy(), start=TRUTH * 1.2, max_evaluations=2)
    assert "has not converged" in covariance(found).method


def test_parameters_at_a_bound_are_named():
    bounds = np.outer([0.5, 2.0], TRUTH)
    bounds[0, 0] = 1.05 * TRUTH[0]
    found = fit(MODEL, noisy(), start=1.1 * TRUTH, bounds=bounds)
    assert covariance(found).method.endswith("(at a bound, as if free: k1)")
    assert "bound" not in covariance(fit(MODEL, noisy())).method


def test_uncertainty_in_other_words():
    u = Uncertainty(("k", "c"), np.array([[0.04, 0.01], [0.01, 0.09]]), "test")
    assert np.allclose(u.std, [0.2, 0.3])
    assert np.allclose(u.correlation, [[1, 1 / 6], [1 / 6, 1]])
    interval = u.interval(np.array([100.0, 10.0]), 0.95)
    assert np.allclose(np.log(interval[0] / 100), [-0.2 * 1.959964, 0.2 * 1.959964])
    assert "test" in str(u)
    assert "0.3" in str(u)
    with pytest.raises(InvalidInput, match="level 1"):
        u.interval(np.ones(2), 1.0)
    with pytest.raises(ValueError, match="read-only"):
        u.covariance[0] = 0


@pytest.mark.parametrize(
    ("matrix", "message"),
    [(np.eye(3), "shape"), (np.diag([1.0, -1.0]), "variance of c is -1")],
)
def test_uncertainty_refuses(matrix, message):
    with pytest.raises(InvalidInput, match=message):
        Uncertainty(("k", "c"), matrix, "test")


def test_relative_noise_of_magnitudes_is_the_real_part():
    kind = find_residual("lls_magnitude")
    g = np.full((1, 1, 1, 1), 2j)
    assert kind.noise(np.full((1, 1, 1, 1), 8.0), g).item() == 2.0
    assert Parameters(("k",), np.ones(1), ("",)).names == ("k",)
