import numpy as np
import pytest
from mass_springs import OMEGA, POSITIONS, MassSprings

from estimators import FrfEstimate, simulate_frf
from estimators.frf.frf_estimate import is_full, unvec, vec
from robotmodels import InvalidInput, RelativeNoise, frequency_response

NOISE = RelativeNoise(0.05, 0.02)


def arrays(q=2, f=3, m=2, n=2):
    rng = np.random.default_rng(0)
    return {
        "positions": rng.random((q, n)),
        "omega": np.arange(1.0, f + 1),
        "response": rng.random((q, f, m, n)) + 1j,
        "covariance": np.ones((q, f, m, n)),
        "repetitions": np.ones(q, dtype=int),
    }


def full_covariance(shape, seed=1):
    q, f, m, n = shape
    rng = np.random.default_rng(seed)
    a = rng.standard_normal((q, f, m * n, m * n)) + 1j * rng.standard_normal((q, f, m * n, m * n))
    return 1e-8 * (a @ np.conj(np.swapaxes(a, -1, -2)) + np.eye(m * n))


def test_vec_stacks_columns():
    a = np.arange(6).reshape(2, 3)
    assert (vec(a) == a.flatten(order="F")).all()
    assert (unvec(vec(a), 2) == a).all()


def test_variances_of_a_full_covariance_are_its_diagonal_in_columns():
    given = arrays(m=2, n=3)
    given["positions"] = given["positions"][:, :2]
    covariance = np.zeros((2, 3, 6, 6), dtype=complex)
    covariance[:, :, range(6), range(6)] = np.arange(1, 7)
    estimate = FrfEstimate(**(given | {"covariance": covariance}))
    assert estimate.has_full_covariance
    assert (estimate.variance[1, 2] == [[1, 3, 5], [2, 4, 6]]).all()


def test_arrays_are_frozen_copies():
    given = arrays()
    estimate = FrfEstimate(**given)
    given["response"][:] = 0
    assert (estimate.response != 0).all()
    with pytest.raises(ValueError, match="read-only"):
        estimate.response[0] = 1


def test_subset_keeps_what_belongs_together():
    estimate = FrfEstimate(**arrays(q=4))
    part = estimate.subset([2, 0])
    assert (part.positions == estimate.positions[[2, 0]]).all()
    assert (part.response == estimate.response[[2, 0]]).all()
    for bad in ([], [4], [-1]):
        with pytest.raises(InvalidInput, match="does not choose from positions 0 to 3"):
            estimate.subset(bad)


def _set(name, index, value):
    def change(given):
        given[name] = given[name].copy()
        given[name][index] = value

    return change


def _replace(name, value):
    return lambda given: given.update({name: value})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_set("response", (1, 2, 0, 1), np.nan), r"response: .*position 1, frequency 2 .*\(0, 1\)"),
        (_set("positions", (1, 0), np.inf), "positions: position 1, coordinate 0"),
        (_set("omega", 1, 0.0), "omega: frequency 1 is 0"),
        (_set("omega", 1, 3.5), r"frequency 2 \(3 rad/s\) does not lie above frequency 1"),
        (_set("omega", 1, 1.0 + 1e-12), "frequency 1 .* does not lie above .* each once: copies"),
        (_replace("omega", np.arange(1.0, 4) + 1j), "omega: an array of real numbers"),
        (_set("covariance", (0, 1, 1, 0), -2.0), r"position 0, frequency 1 .*\(1, 0\).* is -2"),
        (_set("response", (0, 1, 1, 0), 1e200j), r"response: .*position 0, .* beyond any robot"),
        (_set("covariance", (0, 1, 1, 0), 1e-203), r"is 1e-203, a positive number .*from 1e-40"),
        (_set("repetitions", 1, 0), "repetitions: 0 at position 1"),
        (_replace("omega", np.ones((2, 2))), "FRF estimate: positions"),
        (_replace("omega", np.ones(2)), "response: shape"),
        (_replace("covariance", np.ones((2, 3, 3, 3))), "does not fit FRFs"),
        (_replace("covariance", np.ones((2, 3, 2, 2)) * 1j), "must be real"),
        (_replace("covariance", np.ones((2, 3, 4, 4)) * (1 + 1j)), "not Hermitian"),
        (_replace("repetitions", np.ones(3, dtype=int)), "one whole number for each of 2"),
        (_replace("repetitions", np.ones(2)), "one whole number"),
    ],
)
def test_faults_are_named(change, message):
    given = arrays()
    change(given)
    with pytest.raises(InvalidInput, match=message):
        FrfEstimate(**given)


def test_is_full_prefers_elements_for_one_by_one():
    assert not is_full(np.ones((2, 3, 1, 1)), (2, 3, 1, 1))


def test_simulated_errors_have_the_laws_variance_and_are_circular():
    model, repetitions = MassSprings(), np.array([1, 2, 4])
    truth = frequency_response(model, POSITIONS, OMEGA)
    expected = NOISE.variance(truth) / repetitions[:, None, None, None]
    rng = np.random.default_rng(3)
    draws = [simulate_frf(model, POSITIONS, OMEGA, NOISE, rng, repetitions) for _ in range(200)]
    assert np.allclose(draws[0].covariance, expected)
    z = np.array([(d.response - truth) / np.sqrt(expected) for d in draws])
    n = z.size
    assert abs(np.mean(np.abs(z) ** 2) - 1) < 5 / np.sqrt(n)
    assert abs(np.mean(z**2)) < 5 / np.sqrt(n)  # circular
    assert abs(np.mean(z)) < 5 / np.sqrt(n)
    # Negative control: errors of one experiment would not pass for the average of several.
    wrong = np.mean(np.abs(z * np.sqrt(expected) / np.sqrt(NOISE.variance(truth))) ** 2)
    assert abs(wrong - 1) > 0.2


def test_simulation_is_reproducible():
    a, b, c = (
        simulate_frf(MassSprings(), POSITIONS, OMEGA, NOISE, np.random.default_rng(s)).response
        for s in (1, 1, 2)
    )
    assert (a == b).all()
    assert (a != c).all()


def test_positions_not_measured_are_refused():
    with pytest.raises(InvalidInput, match="repetitions: 0 at position 2"):
        simulate_frf(
            MassSprings(), POSITIONS, OMEGA, NOISE, np.random.default_rng(1), np.array([1, 1, 0])
        )


def test_an_estimate_is_printed_in_a_line():
    response = np.full((2, 3, 2, 2), 10.0 + 0j)
    omega = 2 * np.pi * np.array([1.0, 2.0, 30.0])
    alone = FrfEstimate(np.zeros((2, 1)), omega, response, np.ones(response.shape), [1, 1])
    assert str(alone) == (
        "FRFs of 2 motors to 2 outputs in 2 positions at 3 frequencies, 1 to 30 Hz; median "
        "signal-to-noise ratio 20 dB, errors of elements independent"
    )
    full = np.broadcast_to(np.eye(4) + 0j, (2, 3, 4, 4))
    assert str(FrfEstimate(np.zeros((2, 1)), omega, response, full, [1, 1])).endswith("correlated")
