"""What is wrong with FRFs, counts of masses and spectra is said in one line."""

import numpy as np
import pytest
from chain_cases import CHAINS, COUPLINGS, MASSES, OMEGA, SPRINGS, noisy

from estimators.chains.identification import identify_chains
from estimators.chains.inverse_eigenvalue import coupled_inertia
from estimators.chains.model_order import WrongModeCount
from estimators.chains.pole_zero_spectra import first_components
from estimators.chains.stepwise import stepwise_chain
from robotmodels.common.errors import InvalidInput, NotIdentifiable
from robotmodels.linear.chain_responses import chain_response, modally_damped
from robotmodels.linear.coupled_chains import CoupledChains
from robotmodels.linear.modes import anti_resonances, resonances


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"n_masses": 1}, "n_masses: 1; a chain needs at least 2"),
        ({"response": np.zeros((95, 3, 3))}, "zero from motor 1 to itself; was it excited"),
        ({"response": np.full((95, 3, 3), np.nan)}, "not finite from motor 1; was it excited"),
        ({"response": np.ones((95, 3, 2))}, r"shape \(95, 3, 2\) given; \(95, M, M\)"),
        ({"omega": OMEGA[::-1]}, "increasing frequencies"),
        ({"covariance": np.ones((95, 3))}, r"covariance: shape \(95, 3\)"),
        ({"n_masses": 2.5}, r"n_masses: 2\.5; .* a whole number"),
        ({"n_masses": "3"}, "n_masses: '3'; .* a whole number"),
        ({"first_masses": np.array([1.0, -1.0, 2.0])}, "first_masses: .* not 3 positive"),
        ({"first_masses": [1.0, 2.0]}, "first_masses: .* not 3 positive"),
        ({"covariance": -np.ones((95, 3, 3))}, "the variance of frequency 0, element 0"),
        ({"distortion": np.ones((9, 3, 3))}, r"distortion: shape \(9, 3, 3\)"),
    ],
)
def test_bad_input_ends_in_one_line(change, message):
    given = {"omega": OMEGA, "response": chain_response(CHAINS, OMEGA), "n_masses": 3} | change
    omega, response = given.pop("omega"), given.pop("response")
    with pytest.raises(InvalidInput, match=message) as caught:
        identify_chains(omega, response, **given)
    assert "\n" not in str(caught.value)


def test_too_few_and_too_many_modes_say_found_and_expected():
    pair = CoupledChains(MASSES[:2], SPRINGS[:2], COUPLINGS[:2, :2])
    omega, model = OMEGA[::2], modally_damped(pair.linear_model(), 0.005)
    G, variance = noisy(model, np.random.default_rng(10), omega=omega)
    with pytest.raises(WrongModeCount, match="have 6 resonances, only 4 are found") as few:
        identify_chains(omega, G, 4, covariance=variance)
    poles = resonances(pair.linear_model()).frequencies
    assert few.value.resonances == pytest.approx(poles, rel=2e-3)
    assert few.value.expected == 6
    with pytest.raises(WrongModeCount, match="have 2 resonances, 4 are found") as many:
        identify_chains(omega, G, 2, covariance=variance)
    assert len(many.value.resonances) == 4
    with pytest.raises(WrongModeCount, match="have 6 resonances, only 4 are found"):
        identify_chains(omega, chain_response(pair, omega), 4)
    for error in (few, many):
        assert "n_masses = 3 would fit" in str(error.value)
        assert "\n" not in str(error.value)


def test_a_band_without_resonances_is_not_enough():
    omega = np.linspace(1.0, 8.0, 60)
    G, variance = noisy(
        modally_damped(CHAINS.linear_model(), 0.005), np.random.default_rng(1), omega=omega
    )
    with pytest.raises((NotIdentifiable, WrongModeCount)):
        identify_chains(omega, G, 3, covariance=variance)
    with pytest.raises(NotIdentifiable, match="lines are too few"):
        identify_chains(omega[:3], G[:3], 3, covariance=variance[:3])


def test_spectra_that_do_not_interlace_name_the_pair():
    model = CHAINS.linear_model()
    poles = np.concatenate([[0.0], resonances(model).squares])
    zeros = anti_resonances(model, 0) ** 2
    zeros[2] = poles[3] * 1.01
    with pytest.raises(InvalidInput, match=r"anti-resonance 3 at 5\.4\d* Hz lies above the pole 4"):
        first_components(poles, zeros)
    zeros[2] = poles[2] * 0.99
    with pytest.raises(InvalidInput, match=r"anti-resonance 3 at .* lies below the pole 3"):
        first_components(poles, zeros)
    with pytest.raises(InvalidInput, match=r"7 poles .* and 5 zeros; 6 zeros"):
        first_components(poles, zeros[1:])
    with pytest.raises(InvalidInput, match="n_masses: 8 masses need 8 poles"):
        stepwise_chain(poles, zeros, 1.0, 8, 5.0)
    with pytest.raises(InvalidInput, match="n_masses: 1"):
        stepwise_chain(poles, zeros, 1.0, 1, 5.0)
    with pytest.raises(InvalidInput, match="per_step: 3"):
        stepwise_chain(poles, zeros, 1.0, 3, 5.0, per_step=3)


def test_a_cross_gain_of_unknown_sign_is_refused():
    with pytest.raises(NotIdentifiable, match="sign of the cross gain; its phase is 80 degrees"):
        coupled_inertia(0.01 * np.exp(1j * np.radians(80)), 0.1, 0.2)
    with pytest.raises(InvalidInput, match="both must be positive"):
        coupled_inertia(0.01, -0.1, 0.2)
    assert coupled_inertia(0.0, 0.1, 0.2) == 0.0
