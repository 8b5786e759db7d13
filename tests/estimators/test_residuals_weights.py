import numpy as np
import pytest
from derivatives import by_logarithms
from mass_springs import OMEGA, POSITIONS, MassSprings
from test_frf_estimate import full_covariance

from estimators import (
    FrfEstimate,
    combined_weights,
    lls,
    lls_magnitude,
    optimal_weights,
    simulate_frf,
    user_weights,
)
from estimators.fitting.residuals import find_residual
from estimators.fitting.weight_choice import evaluate_weights
from estimators.fitting.weights import square_root, used_elements, whiten
from robotmodels import InvalidInput, RelativeNoise, frequency_response, sensitivity
from robotmodels.linear.residuals import RESIDUALS


@pytest.fixture(scope="module")
def estimate():
    return simulate_frf(
        MassSprings(), POSITIONS, OMEGA, RelativeNoise(0.03, 0.01), np.random.default_rng(0)
    )


def with_covariance(estimate, covariance):
    return FrfEstimate(
        estimate.positions, estimate.omega, estimate.response, covariance, estimate.repetitions
    )


@pytest.mark.parametrize("name", RESIDUALS)
def test_jacobians_equal_central_differences(name, estimate):
    model, kind = MassSprings(), find_residual(name)
    G, J = sensitivity(model, POSITIONS, OMEGA)
    slopes = kind.jacobian(G, J)
    differences = by_logarithms(
        lambda at: kind.error(estimate.response, frequency_response(model, POSITIONS, OMEGA, at)),
        model.parameters.values,
        1e-6,
    )
    # Phases that wrap between the two ends jump by 2 pi: none does here.
    assert np.abs(differences).max() < 1e3
    size = np.abs(slopes).max(axis=(0, 1, 2, 3))
    assert np.abs((slopes - differences) / size).max() < 1e-7


def test_log_residual_keeps_the_phase_within_pi():
    measured, modelled = np.exp(1j * np.array([3.0])), np.exp(-1j * np.array([3.0]))
    assert np.isclose(lls(measured, modelled)[0].imag, 6 - 2 * np.pi)
    assert lls_magnitude(measured, 2 * modelled)[0] == pytest.approx(-np.log(2))


@pytest.mark.parametrize("value", [0, np.nan, np.inf])
@pytest.mark.parametrize("side", ["measured", "modelled"])
def test_no_logarithm_names_the_place(side, value):
    g = {"measured": np.ones((2, 3, 2, 2)) * 1j, "modelled": np.ones((2, 3, 2, 2)) * 1j}
    g[side][1, 2, 0, 1] = value
    with pytest.raises(InvalidInput, match=rf"{side} FRF.*position 1, frequency 2, element \(0, 1"):
        lls(g["measured"], g["modelled"])


def test_elements_without_weight_take_no_logarithm():
    kind = find_residual("lls")
    g = np.ones((1, 1, 2, 2), dtype=complex)
    zero = g.copy()
    zero[0, 0, 0, 1] = 0
    used = zero != 0
    assert (kind.error(zero, g, used) == 0).all()
    assert (kind.jacobian(zero, np.ones((1, 1, 2, 2, 3)), used)[0, 0, 0, 1] == 0).all()


def test_unknown_residual_is_named():
    with pytest.raises(InvalidInput, match=r"'llsm' is unknown .*; there are nls, lls"):
        find_residual("llsm")
    assert find_residual(RESIDUALS["nls"]) == find_residual("nls")


def test_user_weights_are_constant_low_off_the_diagonal_and_zero_below_a_frequency(estimate):
    w = user_weights(estimate, diagonal=2.0, off_diagonal=0.3, from_omega=OMEGA[5])
    assert (w[:, :5] == 0).all()
    assert (w[:, 5:] == [[2.0, 0.3], [0.3, 2.0]]).all()


def test_user_weights_leave_out_noisy_elements(estimate):
    noisy = estimate.variance.copy()
    noisy[1, 4, 0, 1] = 0.5 * np.abs(estimate.response[1, 4, 0, 1]) ** 2
    w = user_weights(with_covariance(estimate, noisy), minimum_snr=np.sqrt(10))
    assert w[1, 4, 0, 1] == 0
    assert (w == 0).sum() == 1


@pytest.mark.parametrize("name", ["diagonal", "off_diagonal", "from_omega", "minimum_snr"])
@pytest.mark.parametrize("value", [-1.0, np.nan])
def test_user_weights_refuse_negative_numbers(estimate, name, value):
    with pytest.raises(InvalidInput, match=rf"weights\.{name}"):
        user_weights(estimate, **{name: value})


def test_optimal_weights_are_wm_6_and_wm_8(estimate):
    g, variance = estimate.response, estimate.variance
    assert np.allclose(optimal_weights(estimate, "nls"), 1 / variance)
    for name in ("lls", "lls_magnitude"):
        assert np.allclose(optimal_weights(estimate, name), np.abs(g) ** 2 / variance)
    assert np.allclose(optimal_weights(estimate, "lls", 2 * g), 4 * np.abs(g) ** 2 / variance)


def test_full_optimal_weights_are_wm_6_and_wm_8(estimate):
    covariance = full_covariance(estimate.response.shape)
    correlated = with_covariance(estimate, covariance)
    assert np.allclose(optimal_weights(correlated, "nls"), np.linalg.inv(covariance))
    vector = estimate.response[1, 3].flatten(order="F")
    inverse = np.linalg.inv(np.diag(vector))
    relative = inverse @ covariance[1, 3] @ inverse.conj().T
    assert np.allclose(optimal_weights(correlated, "lls")[1, 3], np.linalg.inv(relative))
    real = optimal_weights(correlated, "lls_magnitude")[1, 3]
    assert np.allclose(real, np.linalg.inv(relative.real))


def test_elements_left_out_do_not_correlate_with_the_others(estimate):
    covariance = full_covariance(estimate.response.shape)
    covariance[1, 3, 2] *= 1e6  # element (0, 1) drowns
    covariance[1, 3, :, 2] *= 1e6
    weights = optimal_weights(with_covariance(estimate, covariance), "nls", minimum_snr=3.0)
    kept = np.ix_([0, 1, 3], [0, 1, 3])
    assert (weights[1, 3, 2] == 0).all()
    assert (weights[1, 3, :, 2] == 0).all()
    assert np.allclose(weights[1, 3][kept], np.linalg.inv(covariance[1, 3][kept]))
    assert np.allclose(weights[0], np.linalg.inv(covariance[0]))


@pytest.mark.parametrize("name", ["user", "optimal"])
def test_named_weights_leave_out_what_is_below_10_db_where_a_logarithm_is_taken(estimate, name):
    noisy = estimate.variance.copy()
    noisy[1, 4, 0, 1] = 0.11 * np.abs(estimate.response[1, 4, 0, 1]) ** 2
    noisy[1, 5, 0, 1] = 0.09 * np.abs(estimate.response[1, 5, 0, 1]) ** 2
    given = with_covariance(estimate, noisy)
    weights = evaluate_weights(name, given, find_residual("lls"))
    assert weights[1, 4, 0, 1] == 0
    assert weights[1, 5, 0, 1] > 0
    assert (evaluate_weights(name, given, find_residual("nls")) > 0).all()


def test_optimal_weights_of_a_measured_zero():
    one = np.ones((1, 1, 1, 2))
    g = np.array([[[[0.0, 2.0]]]], dtype=complex)
    estimate = FrfEstimate(np.zeros((1, 2)), np.ones(1), g, one, np.ones(1, dtype=int))
    assert optimal_weights(estimate, "lls").tolist() == [[[[0.0, 4.0]]]]
    assert (optimal_weights(estimate, "nls") == 1).all()


def test_a_covariance_that_is_not_positive_definite_is_named(estimate):
    covariance = full_covariance(estimate.response.shape)
    few = np.ones((4, 2))  # the sample covariance of two blocks
    covariance[2, 6] = few @ few.T
    with pytest.raises(InvalidInput, match=r"position 2, frequency 6 .*not positive definite"):
        optimal_weights(with_covariance(estimate, covariance), "nls")


def test_whitening_squares_to_the_weighted_sum(estimate):
    shape = estimate.response.shape
    weights = full_covariance(shape, seed=5)
    error = estimate.response
    white = whiten(square_root(weights, shape), error)
    vector = error[2, 7].flatten(order="F")
    assert np.isclose(
        np.sum(np.abs(white[2, 7]) ** 2), (vector.conj() @ weights[2, 7] @ vector).real
    )
    diagonal = np.abs(error)
    white = whiten(square_root(diagonal, shape), error)
    assert np.isclose(np.sum(np.abs(white) ** 2), np.sum(diagonal * np.abs(error) ** 2))


def test_chosen_weights_take_names_and_arrays(estimate):
    lls_kind, magnitude = find_residual("lls"), find_residual("lls_magnitude")
    assert (evaluate_weights("user", estimate, lls_kind) == user_weights(estimate)).all()
    full = full_covariance(estimate.response.shape)
    assert (evaluate_weights(full, estimate, lls_kind) == full).all()
    assert (evaluate_weights(full, estimate, magnitude) == full.real).all()
    full[0, 0] = np.diag([1, 0, 2, 3])
    assert (used_elements(full, estimate.response.shape)[0, 0] == [[1, 1], [0, 1]]).all()


def _weights(kind):
    full = full_covariance((3, 23, 2, 2))
    element = np.ones((3, 23, 2, 2))
    if kind == "negative":
        element[1, 2, 0, 1] = -1
        return element
    if kind == "complex":
        return element * 1j
    if kind == "skew":
        full[1, 2, 0, 1] += 1
    if kind == "indefinite":
        full[1, 2] = np.diag([1, 1, 1, -1])
    others = {"shape": element[:, :5], "name": "optmal", "none": None, "ragged": [[1, 0.1], [0.1]]}
    return others.get(kind, full)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("negative", r"weights: -1 at position 1, frequency 2 .*\(0, 1\)"),
        ("complex", "must be a real number"),
        ("skew", "position 1, frequency 2 .*not Hermitian"),
        ("indefinite", "position 1, frequency 2 .*not positive semidefinite"),
        ("shape", "does not fit FRFs of shape"),
        ("name", "did you mean 'optimal'"),
        ("none", "weights: None is neither one of user, optimal"),
        ("ragged", "nor an array of numbers"),
    ],
)
def test_wrong_weights_are_named(estimate, kind, message):
    with pytest.raises(InvalidInput, match=message):
        evaluate_weights(_weights(kind), estimate, find_residual("nls"))


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda e: optimal_weights(e, "lls", minimum_snr=-1.0), r"weights\.minimum_snr: -1\.0"),
        (lambda e: optimal_weights(e, "lls", np.ones(3)), r"weights\.response: shape \(3,\)"),
        (
            lambda e: combined_weights(e, "lls", -np.ones(e.response.shape)),
            r"weights\.shape: -1 at position 0, frequency 0",
        ),
        (lambda e: user_weights(e, elements=1j * np.ones((2, 3))), r"weights\.elements: .* real"),
    ],
)
def test_what_no_weights_can_be_made_of_is_named(estimate, made, message):
    with pytest.raises(InvalidInput, match=message):
        made(estimate)


def test_combined_weights_join_the_users_shape_and_the_noise(estimate):
    g, variance = estimate.response, estimate.variance
    shape = user_weights(estimate, 2.0, 0.5, from_omega=estimate.omega[3], minimum_snr=0.0)
    assert np.allclose(
        combined_weights(estimate, "lls", shape, 0.2), shape / (variance / np.abs(g) ** 2 + 0.04)
    )
    nls = combined_weights(estimate, "nls", shape, 0.2)
    assert np.allclose(nls, shape / (variance + 0.04 * np.abs(g) ** 2))
    assert (nls[:, :3] == 0).all()
    # Little noise: the user's; much noise: the optimal ones.
    little = with_covariance(estimate, 1e-6 * variance)
    assert np.allclose(combined_weights(little, "lls", shape, 0.2), shape / 0.04, rtol=1e-3)
    much = with_covariance(estimate, 1e6 * variance)
    ones = np.ones(g.shape)
    optimal = optimal_weights(much, "lls")
    assert np.allclose(combined_weights(much, "lls", ones, 0.2), optimal, rtol=1e-3)


def test_combined_weights_of_a_full_covariance(estimate):
    covariance = full_covariance(estimate.response.shape)
    correlated = with_covariance(estimate, covariance)
    shape = user_weights(estimate, 2.0, 0.5, minimum_snr=0.0)
    found = combined_weights(correlated, "nls", shape, 0.3, diagonal=False)
    error = 0.09 * np.abs(estimate.response[1, 3].flatten(order="F")) ** 2
    root = np.diag(np.sqrt(shape[1, 3].flatten(order="F")))
    assert np.allclose(found[1, 3], root @ np.linalg.inv(covariance[1, 3] + np.diag(error)) @ root)
    assert found.shape == covariance.shape
    named = evaluate_weights("combined", correlated, find_residual("lls"))
    assert named.shape == estimate.response.shape


def test_optimal_weights_from_the_variances_alone(estimate):
    few = full_covariance(estimate.response.shape)
    few[2, 6] = np.ones((4, 4)) + 1e-3 * np.eye(4)
    few[2, 6] *= 1 + 0j
    correlated = with_covariance(estimate, few)
    assert np.allclose(optimal_weights(correlated, "nls", diagonal=True), 1 / correlated.variance)
    named = evaluate_weights("optimal_diagonal", correlated, find_residual("nls"))
    assert np.allclose(named, 1 / correlated.variance)


def test_one_weight_per_element(estimate):
    elements = np.array([[1.0, 0.0], [0.2, 3.0]])
    assert (user_weights(estimate, elements=elements, minimum_snr=0.0) == elements).all()
    assert (evaluate_weights(elements, estimate, find_residual("nls")) == elements).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda e: user_weights(e, elements=np.ones((3, 2))), r"there is no element \(2, 1\)"),
        (lambda e: user_weights(e, elements=np.ones((1, 2))), r"2 outputs and 2 inputs$"),
        (lambda e: user_weights(e, elements=-np.eye(2)), r"-1 of element \(0, 0\)"),
        (lambda e: combined_weights(e, "lls", floor=0.0), r"weights\.floor: 0\.0 is not"),
        (lambda e: combined_weights(e, "lls", np.ones((2, 2))), r"weights\.shape: \(2, 2\) given"),
    ],
)
def test_weights_that_do_not_fit_are_refused(estimate, make, message):
    with pytest.raises(InvalidInput, match=message):
        make(estimate)
