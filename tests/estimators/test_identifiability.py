import numpy as np
import pytest
from mass_springs import OMEGA, POSITIONS
from test_covariance import Blind, _exponents
from test_least_squares import MODEL
from test_profile import noisy

from estimators import (
    Prior,
    best_additions,
    covariance,
    fit,
    fit_information,
    identifiability,
    simulate_frf,
)
from robotmodels import InvalidInput, RelativeNoise

NAMES = ("g1.stiffness", "g2.stiffness", "g1.damping", "g2.damping")


def made_of(directions, std, p=4):
    """Information with the given standard deviations along orthogonal directions."""
    q, _ = np.linalg.qr(np.column_stack([*directions, np.random.default_rng(0).random((p, p))]))
    values = np.concatenate([std, np.full(p - len(std), 0.01)])
    return (q[:, :p] / values**2) @ q[:, :p].T


def test_widths_and_prices_are_those_of_brute_force():
    root = np.random.default_rng(1).standard_normal((4, 9))
    information = 50 * root @ root.T
    found = identifiability(information, NAMES)
    all_free = np.sqrt(np.diag(np.linalg.inv(information)))
    assert found.std == pytest.approx(all_free, rel=1e-5)
    assert found.alone == pytest.approx(1 / np.sqrt(np.diag(information)))
    for j in range(4):
        rest = [i for i in range(4) if i != j]
        fixed = np.sqrt(np.diag(np.linalg.inv(information[np.ix_(rest, rest)])))
        assert found.inflation[j, rest] == pytest.approx(all_free[rest] / fixed, rel=1e-5)
        assert found.price[j] == pytest.approx(np.exp(np.mean(np.log(all_free[rest] / fixed))))
    jacobian = np.sqrt(50) * root.T
    assert found.singular_values == pytest.approx(np.linalg.svd(jacobian)[1])
    assert found.weak() == ()
    assert found.advice == ()


def test_a_parameter_that_is_not_told_is_to_be_fixed():
    found = identifiability(made_of([[0, 0, 0, 1]], [0.8]), NAMES)
    assert found.weak() == ("g2.damping^+1.00 is determined to within 80 %",)
    (step,) = found.advice
    assert (step.kind, step.names) == ("fix", ("g2.damping",))
    assert step.std == pytest.approx(0.8)
    assert "fix g2.damping, or measure it otherwise" in str(found)


def test_two_springs_told_by_their_product_only_are_to_be_tied():
    found = identifiability(made_of([[1, -1, 0, 0]], [0.5]), NAMES)
    (step,) = found.advice
    assert (step.kind, set(step.names)) == ("tie", set(NAMES[:2]))
    assert "their ratio is determined to within 50 %" in step.text


def test_two_springs_told_by_their_ratio_only_need_one_fixed():
    found = identifiability(made_of([[1, 1, 0, 0]], [0.5]), NAMES)
    (step,) = found.advice
    assert step.kind == "fix"
    assert step.names[0] in NAMES[:2]


def test_a_spring_is_not_tied_to_a_damper():
    found = identifiability(made_of([[1, 0, -1, 0]], [0.5]), NAMES)
    assert found.advice[0].kind == "fix"


def test_advice_ends_with_no_weak_direction():
    information = made_of([[1, -1, 0, 0], [0, 0, 1, 0.2]], [2.0, 0.9])
    found = identifiability(information, NAMES)
    assert [s.kind for s in found.advice] == ["tie", "fix"]
    tied = np.array([[1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    left = np.delete(tied, 1, axis=1)  # g1.damping fixed
    rest = np.linalg.inv(left.T @ information @ left)
    assert np.sqrt(np.linalg.eigvalsh(rest)).max() < 0.3


def test_singular_information_is_said_to_be_so():
    model = Blind(_exponents("product"))
    data = simulate_frf(model, POSITIONS, OMEGA, RelativeNoise(), np.random.default_rng(0))
    found = identifiability(
        fit_information(fit(model, data, "nls", "optimal")), MODEL.parameters.names
    )
    assert np.isinf(found.std[:2]).all()
    assert np.isfinite(found.std[2:]).all()
    assert found.weak() == ("k1^+0.71 k2^-0.71 is not determined",)
    assert found.advice[0].kind == "tie"


def test_the_information_of_a_fit_is_the_inverse_of_its_covariance():
    found = fit(MODEL, noisy(), "nls", "optimal")
    inverse = np.linalg.inv(covariance(found).covariance)
    assert fit_information(found) == pytest.approx(inverse, rel=1e-4, abs=1e-4 * inverse.max())
    prior = Prior(("k2",), [1500.0], [0.001])
    known = fit(MODEL, noisy(), "nls", "optimal", prior=prior)
    assert fit_information(known)[1, 1] > 1e6


def test_the_best_addition_is_the_one_brute_force_finds():
    rng = np.random.default_rng(2)
    root, more = rng.standard_normal((4, 6)), rng.standard_normal((30, 4, 2))
    information, candidates = root @ root.T, more @ np.swapaxes(more, 1, 2)
    found = best_additions(information, candidates, NAMES)
    volume = np.linalg.slogdet(information + candidates)[1]
    assert found.order[0] == np.argmax(volume)
    ratio = np.exp((volume - np.linalg.slogdet(information)[1]) / 8)
    assert found.gain == pytest.approx(ratio, rel=1e-4)
    one = best_additions(information, candidates, NAMES, ["g1.damping"])
    std = np.sqrt(np.linalg.inv(information + candidates)[:, 2, 2])
    assert one.order[0] == np.argmin(std)
    assert one.std[:, 2] == pytest.approx(std, rel=1e-4)


def test_what_is_missing_entirely_is_added_first():
    information = np.diag([1e4, 1e4, 1e4, 0.0])
    candidates = np.stack([np.diag([1e4, 1e4, 1e4, 0.0]), np.diag([0.0, 0.0, 0.0, 1.0])])
    found = best_additions(information, candidates, NAMES)
    assert found.order.tolist() == [1, 0]


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.eye(3), r"shape \(3, 3\)"),
        (np.full((4, 4), np.nan), "finite: False"),
        (np.triu(np.ones((4, 4))), "not symmetric"),
        (np.diag([1.0, 1.0, 1.0, -1.0]), "eigenvalue -1 is negative"),
    ],
)
def test_matrices_that_are_no_information_are_refused(matrix, message):
    with pytest.raises(InvalidInput, match=message):
        identifiability(matrix, NAMES)
    with pytest.raises(InvalidInput, match="candidates: shape"):
        best_additions(np.eye(4), np.eye(4), NAMES)
    with pytest.raises(InvalidInput, match="parameters: 'g3' is unknown"):
        best_additions(np.eye(4), np.eye(4)[None], NAMES, ["g3"])
