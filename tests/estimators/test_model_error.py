import numpy as np
import pytest
from derivatives import by_logarithms, circular
from scipy.stats import chi2, norm
from two_chains import drawn, truth, two_chains, with_errors

from estimators import Prior, covariance, fit, multistart, residual_analysis
from estimators.fitting.residuals import loss_factors
from robotmodels import CoupledChains, InvalidInput, RelativeNoise, SolverFailed

MODEL = two_chains()
TRUTH = MODEL.parameters.values
OMEGA = np.linspace(2.0, 30.0, 80)
FRF = truth(MODEL, OMEGA)
NOISE = RelativeNoise(0.02, 0.005)


def over_claimed(simulate, methods, n=30, seed=0, **arguments):
    """Return, per method, the mean square of ln errors over what the method claims, (p,)."""
    rng = np.random.default_rng(seed)
    errors, claimed = [], {method: [] for method in methods}
    for _ in range(n):
        found = fit(MODEL, simulate(rng), tolerance=1e-6, **arguments)
        errors.append(np.log(found.parameters.values / TRUTH))
        for method in methods:
            claimed[method].append(np.diag(covariance(found, method).covariance))
    square = np.mean(np.array(errors) ** 2, axis=0)
    return {method: square / np.mean(values, axis=0) for method, values in claimed.items()}


@pytest.mark.parametrize("residual", ["nls", "lls", "lls_magnitude"])
def test_all_methods_agree_where_the_noise_is_as_stated(residual):
    rng = np.random.default_rng(1)
    found = [fit(MODEL, drawn(FRF, rng, NOISE, OMEGA), residual, "optimal") for _ in range(10)]

    def mean(*arguments):
        return np.mean([np.diag(covariance(f, *arguments).covariance) for f in found], axis=0)

    theorem = mean("theorem1")
    assert np.allclose(mean("scaled"), theorem, rtol=0.1)
    assert np.allclose(mean("empirical", 0), theorem, rtol=0.2)
    # Lags lose a part: a fit's residuals are negatively correlated near a resonance.
    with_lags = mean("empirical") / theorem
    assert with_lags.min() > 0.6
    assert with_lags.max() < 1.1


def test_noise_stated_too_small_is_found_out():
    ratio = over_claimed(
        lambda rng: drawn(FRF, rng, NOISE, OMEGA, stated=0.25),
        ("theorem1", "scaled", "empirical"),
        residual="nls",
        weights="optimal",
    )
    assert (ratio["theorem1"] > 2.2).all()  # four times the variance claimed
    assert 0.6 < ratio["scaled"].mean() < 1.5
    assert 0.6 < ratio["empirical"].mean() < 1.5


def smooth_errors(rng):
    """Relative errors that last over several frequencies, as those of a wrong model do."""
    white = circular(rng, 1, len(OMEGA) + 8, 2, 2)
    smooth = sum(white[:, i : i + len(OMEGA)] for i in range(5)) / np.sqrt(5)
    return with_errors(FRF, 0.05 * FRF * smooth, (0.05 * np.abs(FRF)) ** 2, OMEGA)


def test_errors_that_last_over_frequencies_need_the_lags():
    rng = np.random.default_rng(2)
    errors, with_lags, without = [], [], []
    for _ in range(30):
        found = fit(MODEL, smooth_errors(rng), "lls", "user", tolerance=1e-6)
        errors.append(np.log(found.parameters.values / TRUTH))
        with_lags.append(np.diag(covariance(found, "empirical").covariance))
        without.append(np.diag(covariance(found, "empirical", lags=0).covariance))
    square = np.mean(np.array(errors) ** 2, axis=0)
    ratio, white = square / np.mean(with_lags, axis=0), square / np.mean(without, axis=0)
    assert white.mean() > 1.5
    assert ratio.mean() < 0.75 * white.mean()


def test_the_empirical_sandwich_as_written_out():
    found = fit(MODEL, drawn(FRF, np.random.default_rng(3), NOISE, OMEGA), "nls", "user")

    # Residuals over one minus their leverage, written out with finite differences.
    def stacked(values):
        apart = np.sqrt(found.weights) * (found.estimate.response - truth(MODEL.at(values), OMEGA))
        return np.concatenate([apart.real.ravel(), apart.imag.ravel()])

    at = found.parameters.values
    slope = by_logarithms(stacked, at, 1e-6)
    hat = slope @ np.linalg.pinv(slope)
    scores = 2 * slope * (stacked(at) / (1 - np.diag(hat)))[:, None]
    s = scores.reshape(2, len(OMEGA), 4, 4).sum(axis=(0, 2))
    meat = s.T @ s + (2 / 3) * (s[:-1].T @ s[1:] + s[1:].T @ s[:-1])
    meat += (1 / 3) * (s[:-2].T @ s[2:] + s[2:].T @ s[:-2])
    bread = np.linalg.inv(2 * slope.T @ slope)
    expected = bread @ meat @ bread
    assert np.allclose(covariance(found, "empirical", lags=2).covariance, expected, rtol=1e-4)


@pytest.mark.parametrize("residual", ["nls", "lls", "lls_magnitude"])
@pytest.mark.parametrize("weights", ["optimal", "user"])
def test_the_size_of_residuals_is_one_on_average(residual, weights):
    rng, n = np.random.default_rng(4), 60 if weights == "optimal" else 20
    found = [
        residual_analysis(
            fit(MODEL, drawn(FRF[:, ::20], rng, NOISE, OMEGA[::20]), residual, weights), 1
        ).ratio
        for _ in range(n)
    ]
    spread = np.std(found) / np.sqrt(n)
    assert abs(np.mean(found) - 1) < 4 * spread
    if weights == "optimal":  # without the parameters' share it would not be
        data = (1 if residual == "lls_magnitude" else 2) * 16
        assert abs(np.mean(found) * (1 - 4 / data) - 1) > 2 * spread


def test_a_prior_enters_fit_information_and_covariance():
    estimate = drawn(FRF, np.random.default_rng(5), NOISE, OMEGA)
    free = fit(MODEL, estimate, "nls", "optimal")
    bread = np.linalg.inv(covariance(free).covariance)
    prior = Prior(("K1", "c2"), 1.0005 * TRUTH[[0, 3]], np.array([1e-3, 0.02]))
    tied = fit(MODEL, estimate, "nls", "optimal", prior=prior)
    assert np.allclose(
        np.linalg.inv(covariance(tied).covariance),
        bread + prior.information(MODEL.parameters.names),
        rtol=1e-2,
    )
    # To first order the fit is the precision-weighted mean.
    mean = np.log(free.parameters.values)
    known = prior.information(MODEL.parameters.names)
    target = np.log(np.array([prior.values[0], 1, 1, prior.values[1]]))
    expected = np.linalg.solve(bread + known, bread @ mean + known @ target)
    std = covariance(tied).std
    assert (np.abs(np.log(tied.parameters.values) - expected) < 0.05 * std).all()
    z = np.log(tied.parameters.values[[0, 3]] / prior.values) / prior.std
    assert np.isclose(tied.cost - tied.data_cost, z @ z / 2)
    assert free.data_cost == free.cost
    assert tied.data_cost > free.cost


def test_a_prior_scatters_as_claimed():
    """What was measured before varies too: fits with it scatter less, and as claimed."""
    rng, squares, n = np.random.default_rng(6), 0.0, 25
    std = np.array([5e-4, 5e-3])
    for _ in range(n):
        before = TRUTH[[0, 3]] * np.exp(std * rng.standard_normal(2))
        found = fit(
            MODEL,
            drawn(FRF, rng, NOISE, OMEGA),
            "nls",
            "optimal",
            prior=Prior(("K1", "c2"), before, std),
            tolerance=1e-7,
        )
        error = np.log(found.parameters.values / TRUTH)
        squares += error @ np.linalg.solve(covariance(found).covariance, error)
    assert np.isfinite(covariance(found, "scaled").covariance).all()
    assert np.isfinite(covariance(found, "empirical").covariance).all()
    low, high = chi2.ppf([0.001, 0.999], 4 * n)
    assert low < squares < high
    assert not low < squares / 0.4 < high  # negative control: two fifths of the covariance


def test_a_prior_makes_a_blind_parameter_identifiable():
    blind = CoupledChains(np.array([[1.0, 2.0]]), np.array([[200.0]]), np.zeros((1, 1)))
    heavy = CoupledChains(
        np.array([[1.0, 2.0]]), np.array([[200.0]]), np.zeros((1, 1)), np.array([[1e-12]])
    )
    omega = np.array([3.0, 5.0])
    estimate = drawn(truth(blind, omega), np.random.default_rng(0), NOISE, omega)
    prior = Prior(("c1",), np.array([1e-12]), np.array([0.3]))
    found = fit(heavy, estimate, "nls", "optimal", prior=prior)
    assert np.isclose(covariance(found).std[1], 0.3, rtol=1e-3)


@pytest.mark.parametrize("loss", ["soft_l1", "huber", "cauchy"])
def test_a_robust_loss_bears_outliers(loss):
    rng = np.random.default_rng(7)
    estimate = drawn(FRF, rng, NOISE, OMEGA)
    response = estimate.response.copy()
    wrong = rng.random(response.shape) < 0.05
    response[wrong] *= 3.0
    spoilt = with_errors(response, 0.0, estimate.covariance, OMEGA)
    std = covariance(fit(MODEL, estimate, "nls", "optimal")).std
    plain, robust = (
        np.abs(np.log(fit(MODEL, spoilt, "nls", "optimal", loss=one).parameters.values / TRUTH))
        / std
        for one in ("linear", loss)
    )
    assert robust.max() < 4
    assert plain.max() > 10


def test_losses_are_scipys():
    from scipy.optimize import least_squares

    rng = np.random.default_rng(8)
    variance = np.full(FRF.shape, 2.0 * np.abs(FRF).mean() ** 2 * 1e-4)
    estimate = with_errors(FRF, np.sqrt(variance) * circular(rng, *FRF.shape), variance, OMEGA)

    def residuals(x):
        apart = (estimate.response - truth(MODEL.at(TRUTH * np.exp(x)), OMEGA)).ravel()
        return np.concatenate([apart.real, apart.imag]) / np.sqrt(variance.ravel()[0] / 2)

    for loss in ("soft_l1", "huber", "cauchy"):
        theirs = least_squares(residuals, np.zeros(4), loss=loss, xtol=1e-12, ftol=1e-12)
        ours = fit(MODEL, estimate, "nls", "optimal", loss=loss)
        assert np.allclose(np.log(ours.parameters.values / TRUTH), theirs.x, atol=2e-6)
        assert np.isclose(ours.cost, theirs.cost)  # sum of 2 (s^2 = 1/2) theirs


def test_a_robust_fit_scatters_as_claimed():
    # E[psi'] and E[psi^2] of a standard normal: in closed form for huber's clipped identity.
    inside = norm.cdf(1) - norm.cdf(-1)
    factors = {
        "huber": (inside, 1 - 2 * norm.pdf(1)),
        "cauchy": (
            norm.expect(lambda u: (1 - u**2) / (1 + u**2) ** 2, lb=-9, ub=9),
            norm.expect(lambda u: (u / (1 + u**2)) ** 2, lb=-9, ub=9),
        ),
    }
    for loss, expected in factors.items():
        assert np.allclose(loss_factors(loss), expected, rtol=1e-3)
        ratio = over_claimed(
            lambda rng: drawn(FRF[:, ::2], rng, NOISE, OMEGA[::2]),
            ("theorem1", "empirical"),
            residual="nls",
            weights="optimal",
            loss=loss,
        )
        assert 0.7 < ratio["theorem1"].mean() < 1.4
        assert 0.6 < ratio["empirical"].mean() < 1.6
    assert np.allclose(loss_factors("linear"), (1.0, 1.0))


def test_what_cannot_be_told_is_refused():
    found = fit(MODEL, drawn(FRF, np.random.default_rng(0), NOISE, OMEGA), loss="huber")
    with pytest.raises(InvalidInput, match="loss 'huber'; 'scaled' is defined for 'linear' only"):
        covariance(found, "scaled")
    with pytest.raises(InvalidInput, match=r"'theorem' is unknown \(did you mean 'theorem1'\?\)"):
        covariance(found, "theorem")
    with pytest.raises(InvalidInput, match="-1 lags"):
        covariance(found, "empirical", lags=-1)
    with pytest.raises(InvalidInput, match=r"loss 'hubber' is unknown .did you mean 'huber'"):
        fit(MODEL, found.estimate, loss="hubber")
    few = drawn(FRF[:, :4], np.random.default_rng(0), NOISE, OMEGA[:4])
    with pytest.raises(InvalidInput, match="4 lines for 4 parameters"):
        covariance(fit(MODEL, few), "empirical")
    (failed,) = multistart(Nowhere(), found.estimate, [TRUTH])
    with pytest.raises(SolverFailed, match="no covariance without a fit"):
        covariance(failed, "empirical")


class Nowhere:
    parameters = MODEL.parameters

    def network(self, positions, parameters=None):
        raise InvalidInput("nowhere")
