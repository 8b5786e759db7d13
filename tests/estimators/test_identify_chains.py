"""Chains identified from FRFs, exact and in noise, against the chains that made them."""

import numpy as np
import pytest
from chain_cases import CHAINS, COUPLINGS, MASSES, OMEGA, SPRINGS, TRUTH, noisy
from derivatives import frf_derivatives

import estimators
from estimators.chain_dampers.damper_fit import fit_dampers
from estimators.chains.identification import identify_chains
from estimators.chains.identified_chains import predict_masses
from estimators.chains.modal_model import ModalLayout, anti_resonance_slopes, modal_anti_resonances
from estimators.chains.model_order import WrongModeCount
from estimators.chains.parameter_maps import ChainLayout, forward_map, inverse_map, inverse_slope
from robotmodels import sensitivity
from robotmodels.common.errors import InvalidInput, NotIdentifiable
from robotmodels.linear.chain_responses import chain_response, modally_damped
from robotmodels.linear.coupled_chains import CoupledChains
from robotmodels.linear.modes import anti_resonances, resonances

SIZES = [(m, n) for m in range(1, 6) for n in range(2, 7)]
LARGE_ARE_SLOW = [
    pytest.param(m, n, marks=pytest.mark.slow) if m * n >= 15 and (m, n) != (4, 5) else (m, n)
    for m, n in SIZES
]


def random_chains(count, length, seed=0):
    rng = np.random.default_rng([seed, count, length])
    couplings = np.triu(rng.uniform(-0.3, 0.3, (count, count)), 1)
    return CoupledChains(
        rng.uniform(1.0, 3.0, (count, length)),
        rng.uniform(1e3, 3e3, (count, length - 1)),
        couplings + couplings.T,
    )


@pytest.mark.parametrize(("count", "length"), LARGE_ARE_SLOW)
def test_exact_frfs_give_all_parameters_as_far_as_the_condition_allows(count, length):
    chains = random_chains(count, length)
    highest = resonances(chains.linear_model()).frequencies[-1]
    omega = np.linspace(0.02, 1.1, 60 * length) * highest
    found = identify_chains(omega, chain_response(chains, omega), length)
    limit = max(1e-6, 1e4 * np.finfo(float).eps * found.inverse.condition)
    assert found.masses == pytest.approx(chains.masses, rel=limit)
    assert found.springs == pytest.approx(chains.springs, rel=limit)
    assert found.couplings == pytest.approx(chains.couplings, rel=limit, abs=1e-9)


def test_motor_inertias_may_be_given_instead_of_the_high_frequency_band():
    found = identify_chains(OMEGA, chain_response(CHAINS, OMEGA), first_masses=MASSES[:, 0])
    assert found.structured.values == pytest.approx(TRUTH, rel=1e-9)
    assert (found.structured.std[found.structured.layout.first] == 0).all()
    wrong = identify_chains(OMEGA, chain_response(CHAINS, OMEGA), first_masses=MASSES[:, 0] * 1.1)
    assert wrong.springs[:, 0] == pytest.approx(1.1 * SPRINGS[:, 0], rel=1e-9)  # (17)


def test_maps_are_inverse_to_each_other_and_their_slopes_to_differences():
    layout, rng = ChainLayout(2, 4), np.random.default_rng(3)
    chains = random_chains(2, 4)
    theta = layout.join(chains.masses, chains.springs, chains.couplings)
    x, slope = forward_map(theta, layout, rng.standard_normal((layout.modes, 2)))
    shapes = layout.modal.split(x)[2]
    assert inverse_map(x, layout) == pytest.approx(theta, rel=1e-11)
    scale = np.where(np.arange(len(theta)) < layout.positive, theta, 1.0)
    product = inverse_slope(x, layout) @ slope / scale[:, None]
    assert product == pytest.approx(np.eye(len(theta)), abs=1e-11)
    for k in range(len(theta)):
        step = np.zeros(len(theta))
        step[k] = 1e-6 * scale[k]
        ends = [forward_map(theta + sign * step, layout, shapes)[0] for sign in (1, -1)]
        assert (ends[0] - ends[1]) / 2e-6 == pytest.approx(slope[:, k], abs=1e-7)


def identified(runs, seed):
    rng, model = np.random.default_rng(seed), modally_damped(CHAINS.linear_model(), 0.005)
    for _ in range(runs):
        G, variance = noisy(model, rng)
        yield identify_chains(OMEGA, G, 3, covariance=variance)


@pytest.fixture(scope="module")
def few():
    return list(identified(4, 1))


@pytest.mark.parametrize("runs", [4, pytest.param(40, marks=pytest.mark.slow)])
def test_delta_method_agrees_with_monte_carlo(runs, few):
    series = few if runs == len(few) else identified(runs, 1)
    # Errors over standard deviations, (runs, 2, k): inverse problem, likelihood.
    found = np.array(
        [[(e.values - TRUTH) / e.std for e in (one.inverse, one.structured)] for one in series]
    )
    numbers = found[:, 0].size  # three standard deviations of as many independent numbers
    assert np.sqrt(np.mean(found**2)) == pytest.approx(1, abs=3 / np.sqrt(2 * numbers))
    assert np.mean(np.abs(found) < 1.96) == pytest.approx(
        0.95, abs=3 * np.sqrt(0.05 * 0.95 / numbers)
    )
    assert np.mean(np.abs(found) < 1.96 / 4) < 0.6  # a quarter of the std claimed is caught


def test_likelihood_is_no_worse_than_the_inverse_problem_alone(few):
    found = few[0]
    assert (found.structured.std <= found.inverse.std * 1.05).all()
    assert found.structured.std.sum() < 0.95 * found.inverse.std.sum()
    assert 0.8 < found.misfit < 1.2
    assert found.structure_p_value > 1e-3
    assert found.notes == ()
    assert "m3_9" in str(found)


def test_delay_and_noise_of_unknown_size():
    model, delay = modally_damped(CHAINS.linear_model(), 0.005), 0.004
    G, variance = noisy(model, np.random.default_rng(3))
    late = G * np.exp(-1j * OMEGA * delay)[:, None, None]
    found = identify_chains(OMEGA, late, 3)
    assert found.modes.delay == pytest.approx(delay, rel=0.01)
    assert found.structured.values == pytest.approx(TRUTH, rel=0.02)
    known = identify_chains(OMEGA, late, 3, covariance=variance)
    assert found.structured.std == pytest.approx(known.structured.std, rel=0.3)


def test_poles_and_zeros_with_standard_deviations(few):
    poles = resonances(CHAINS.linear_model()).frequencies
    zeros = np.array([anti_resonances(CHAINS.linear_model(), i) for i in range(3)])
    errors = []
    for modes in (found.modes for found in few):
        errors.append((modes.zeros - zeros) / modes.zeros_std)
        assert modes.omega == pytest.approx(poles, abs=6 * modes.omega_std.max())
        assert modes.damping == pytest.approx(0.005, rel=0.1)
    assert 0.75 < np.sqrt(np.mean(np.square(errors))) < 1.3


def test_number_of_masses_is_proposed():
    model = modally_damped(CHAINS.linear_model(), 0.005)
    G, variance = noisy(model, np.random.default_rng(5))
    found = identify_chains(OMEGA, G, covariance=variance)
    assert found.n_masses == 3
    assert found.order.tried[:2] == (2, 3)


def test_dampers_by_the_projects_own_fit():
    dampers = np.array([[0.25, 0.15], [0.3, 0.6], [1.0, 0.35]])
    model = CoupledChains(MASSES, SPRINGS, COUPLINGS, dampers).linear_model()
    G, variance = noisy(model, np.random.default_rng(6), 0.003)
    found = identify_chains(OMEGA, G, 3, covariance=variance)
    fitted = fit_dampers(found)
    assert fitted.fit.converged
    assert fitted.dampers == pytest.approx(dampers, abs=4 * fitted.dampers_std.max())
    assert fitted.estimate.values == pytest.approx(TRUTH, rel=0.01)
    assert (np.abs(fitted.model.friction) < 5 * fitted.friction_std).all()
    assert abs(fitted.model.delay) < 5 * fitted.delay_std
    assert fitted.response == pytest.approx(model.frequency_response(OMEGA), rel=0.02, abs=0.01)


def test_sensitivities_of_damped_chains_against_differences():
    G, variance = noisy(modally_damped(CHAINS.linear_model(), 0.01), np.random.default_rng(7))
    model = fit_dampers(identify_chains(OMEGA, G, 3, covariance=variance)).fit.model
    omega, nowhere = OMEGA[::9], np.zeros((1, 3))
    _, J = sensitivity(model, nowhere, omega)
    changes = frf_derivatives(model, nowhere, omega)
    assert changes == pytest.approx(J, abs=1e-5 * np.abs(J).max())


def test_friction_distorts_low_lines_which_are_left_out():
    pair, omega = CoupledChains(MASSES[:2, :2], SPRINGS[:2, :1], COUPLINGS[:2, :2]), OMEGA[::2]
    truth = ChainLayout(2, 2).join(pair.masses, pair.springs, pair.couplings)
    model = modally_damped(pair.linear_model(), 0.005)
    G, variance = noisy(model, np.random.default_rng(8), 0.003, omega)
    # Friction holds the motors: less motion than the torque would give, most at low frequencies.
    share = 0.6 * np.exp(-((omega / omega[4]) ** 2))
    held = G * (1 - share)[:, None, None]
    distortion = np.abs(G) * 0.5 * share[:, None, None]
    found = identify_chains(omega, held, 2, covariance=variance, distortion=distortion)
    assert 4 < found.left_out < 10
    assert found.structured.values == pytest.approx(truth, rel=0.05)
    assert any("friction" in note for note in found.notes)
    biased = identify_chains(omega, held, 2, covariance=variance)
    assert biased.left_out == 0
    assert biased.excess > 0.01
    assert np.abs(biased.structured.values / truth - 1).max() > 0.1


def test_chains_of_another_structure_are_noticed():
    """A spring between the first and the last mass of a chain is no part of the model."""
    model = CHAINS.linear_model()
    link = np.zeros(9)
    link[[0, 2]] = 1, -1
    linked = type(model)(
        model.mass, model.damping, model.stiffness + 300 * np.outer(link, link), model.selector
    )
    G, variance = noisy(modally_damped(linked, 0.005), np.random.default_rng(9))
    found = identify_chains(
        OMEGA,
        G,
        3,
        covariance=variance,
    )
    assert found.structure_p_value < 1e-6 or found.excess > 0
    assert found.notes


def test_masses_nobody_measured_are_predicted():
    model = modally_damped(CHAINS.linear_model(), 0.005)
    found = identify_chains(OMEGA, model.frequency_response(OMEGA), 3)
    receptances, _ = model.receptances(OMEGA)
    expected = -(OMEGA[:, None, None] ** 2) * receptances
    assert predict_masses(found, OMEGA) == pytest.approx(
        expected, abs=1e-5 * np.abs(expected).max()
    )


def test_names_are_exported():
    assert estimators.identify_chains is identify_chains
    assert estimators.fit_dampers is fit_dampers


@pytest.mark.parametrize("method", ["stepwise", "lanczos"])
@pytest.mark.parametrize(("count", "length"), [(1, 8), (2, 2), (2, 8), (3, 3), (3, 8), (5, 3)])
def test_both_ways_of_the_inverse_problem_recover_chains_from_exact_frfs(method, count, length):
    chains = random_chains(count, length, 7)
    highest = resonances(chains.linear_model()).frequencies[-1]
    omega = np.linspace(0.02, 1.1, 60 * length) * highest
    response = chain_response(chains, omega)
    solution = identify_chains(omega, response, length, method=method)
    limit = max(1e-9, 1e4 * np.finfo(float).eps * solution.inverse.condition)
    assert solution.masses == pytest.approx(chains.masses, rel=limit)
    assert solution.springs == pytest.approx(chains.springs, rel=limit)
    assert solution.couplings == pytest.approx(chains.couplings, rel=limit, abs=1e-9)
    given = identify_chains(
        omega, response, length, method=method, first_masses=chains.masses[:, 0]
    )
    assert given.springs == pytest.approx(chains.springs, rel=limit)


def test_both_ways_of_the_inverse_problem_agree_in_noise_and_the_likelihood_is_sharper():
    model = modally_damped(CHAINS.linear_model(), 0.005)
    G, variance = noisy(model, np.random.default_rng(5))
    stepwise, lanczos, likelihood = (
        identify_chains(OMEGA, G, 3, covariance=variance, method=method)
        for method in ("stepwise", "lanczos", "likelihood")
    )
    assert stepwise.structured.values == pytest.approx(lanczos.structured.values, rel=1e-8)
    assert stepwise.covariance == pytest.approx(lanczos.covariance)
    assert likelihood.cost < stepwise.cost
    assert (likelihood.structured.std <= 1.05 * stepwise.structured.std).all()
    assert np.abs(stepwise.structured.values / TRUTH - 1).max() < 0.2
    assert stepwise.structured.verdict is None
    assert "step by step" in str(stepwise)
    assert stepwise.notes == ()


def test_another_method_is_named():
    with pytest.raises(InvalidInput, match=r"method: 'stepwize' is unknown.*'stepwise'"):
        identify_chains(OMEGA, chain_response(CHAINS, OMEGA), 3, method="stepwize")


def test_slopes_of_anti_resonances_against_differences():
    rng = np.random.default_rng(8)
    layout = ModalLayout(3, 6, losses=False)
    inertia = np.diag([5.0, 8.0, 9.0]) + 0.3
    x = layout.join(inertia, np.sort(rng.uniform(10, 50, 6)), rng.standard_normal((6, 3)))
    slopes = anti_resonance_slopes(x, layout)
    for k in range(layout.structure):
        step = np.zeros(len(x))
        step[k] = 1e-6
        ends = [modal_anti_resonances(x + sign * step, layout) for sign in (1, -1)]
        assert (ends[0] - ends[1]) / 2e-6 == pytest.approx(slopes[..., k], rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("method", ["stepwise", "lanczos"])
def test_uneven_chains_from_exact_frfs_are_right_or_refused_by_name(method):
    """Masses and springs over two decades: some hang on digits that the FRFs do not have."""
    refused = 0
    for seed in range(12):
        rng = np.random.default_rng([seed, 8])
        masses, springs = 10 ** rng.uniform(-1, 1, (1, 8)), 10 ** rng.uniform(2, 4, (1, 7))
        chains = CoupledChains(masses, springs, np.zeros((1, 1)))
        highest = resonances(chains.linear_model()).frequencies[-1]
        omega = np.linspace(0.02, 1.1, 480) * highest
        try:
            solution = identify_chains(omega, chain_response(chains, omega), 8, method=method)
        except (NotIdentifiable, WrongModeCount):
            refused += 1
            continue
        assert solution.masses == pytest.approx(masses, rel=1e-2)
        assert solution.springs == pytest.approx(springs, rel=1e-2)
    assert 0 < refused < 12
