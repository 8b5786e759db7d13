import numpy as np
import pytest
from mass_springs import OMEGA, POSITIONS, MassSprings
from noisy_runs import noisy_runs
from test_least_squares import MODEL
from test_profile import noisy

from estimators import (
    Uncertainty,
    covariance,
    fit,
    predict_frf,
    predict_modes,
    simulate_frf,
    validate,
    workspace_map,
)
from estimators.fitting.run_problem import run_problem
from robotmodels import (
    InvalidInput,
    RelativeNoise,
    SpringNetwork,
    anti_resonances,
    frequency_response,
    linearize,
    resonances,
)

ELSEWHERE = np.array([[0.3], [2.0]])
NAMES = MODEL.parameters.names
TRUTH = MODEL.parameters.values


@pytest.fixture(scope="module")
def found():
    return fit(MODEL, noisy(0.02, 0.005), "nls", "optimal")


@pytest.fixture(scope="module")
def known(found):
    return covariance(found)


@pytest.fixture(scope="module")
def fits():
    return [fit(MODEL, noisy(0.03, 0.01, seed), "nls", "optimal") for seed in range(40)]


def draws_of(found, known, n, seed=0):
    rng = np.random.default_rng(seed)
    return rng.multivariate_normal(np.log(found.parameters.values), known.covariance, n)


def test_bands_of_frfs_are_the_same_by_delta_method_and_by_draws(found, known):
    values = found.parameters.values
    delta = predict_frf(MODEL, values, ELSEWHERE, OMEGA, known)
    drawn = predict_frf(MODEL, values, ELSEWHERE, OMEGA, draws_of(found, known, 400))
    # Zeros of the FRF are strongly nonlinear: compare what is typical.
    for name in ("magnitude_std", "phase_std"):
        ratio = getattr(drawn, name) / getattr(delta, name)
        assert np.median(ratio) == pytest.approx(1.0, abs=0.05), name
    inside = (delta.lower < np.abs(delta.response)) & (np.abs(delta.response) < delta.upper)
    assert inside.all()
    width = np.log(drawn.upper / drawn.lower) / np.log(delta.upper / delta.lower)
    assert np.median(width) == pytest.approx(1.0, abs=0.07)


def test_bands_of_frfs_hold_the_truth(fits):
    hits = []
    truth = np.abs(frequency_response(MODEL, ELSEWHERE, OMEGA))
    for one in fits:
        band = predict_frf(MODEL, one.parameters.values, ELSEWHERE, OMEGA, covariance(one))
        half = predict_frf(
            MODEL, one.parameters.values, ELSEWHERE, OMEGA, covariance(one), level=0.5
        )
        hits.append([np.mean((b.lower <= truth) & (truth <= b.upper)) for b in (band, half)])
    # Within a fit hits correlate: fits, not elements, are counted.
    found, error = np.mean(hits, axis=0), np.std(hits, axis=0) / np.sqrt(len(fits))
    assert (np.abs(found - [0.95, 0.5]) < 4 * error).all()
    assert (np.abs(found - [0.5, 0.95]) > 8 * error).all()  # negative control: levels exchanged


@pytest.mark.parametrize("motor", [None, 0, 1])
def test_modes_and_their_widths(found, known, motor):
    values = found.parameters.values
    delta = predict_modes(MODEL, values, ELSEWHERE, known, motor=motor)
    for q, position in enumerate(ELSEWHERE):
        model = linearize(MODEL, position, values)
        expected = resonances(model).frequencies if motor is None else anti_resonances(model, motor)
        assert delta.frequencies[q] == pytest.approx(expected)
    drawn = predict_modes(MODEL, values, ELSEWHERE, draws_of(found, known, 3000), motor=motor)
    assert drawn.std == pytest.approx(delta.std, rel=0.15)
    assert np.log(delta.upper / delta.lower) == pytest.approx(2 * 1.959964 * delta.std)


def test_resonances_follow_rayleigh(known):
    """d ln omega / d ln k is the share of a spring in a mode's elastic energy, over two."""
    network = MODEL.network(ELSEWHERE)
    modes = resonances(network.linear_model())
    along = np.einsum("sd,qdk->qsk", network.incidence(), modes.shapes)
    share = TRUTH[:3, None] * along**2 / modes.squares[:, None]
    one = np.zeros((6, 6))
    for i in range(3):
        alone = one.copy()
        alone[i, i] = 0.01**2
        band = predict_modes(MODEL, TRUTH, ELSEWHERE, Uncertainty(NAMES, alone, "k"))
        assert band.std == pytest.approx(0.01 * share[:, i] / 2, rel=1e-5)


def test_the_map_is_what_single_positions_say(found, known):
    positions, told = np.linspace(0, 2, 7)[:, None], []
    values = found.parameters.values
    found_map = workspace_map(
        MODEL, values, positions, OMEGA, known, modes=1, chunk=3,
        progress=lambda done, total: told.append((done, total)),
    )  # fmt: skip
    band = predict_frf(MODEL, values, positions[5:6], OMEGA, known)
    own = np.diagonal(band.magnitude_std[0], axis1=-2, axis2=-1)
    assert found_map.response_std[5] == pytest.approx(np.sqrt(np.mean(own**2)))
    assert found_map.worst_std[5] == pytest.approx(own.max())
    modes = predict_modes(MODEL, values, positions, known)
    assert found_map.mode_std == pytest.approx(modes.std[:, :1])
    assert found_map.frequencies.shape == (7, 1)
    assert told == [(3, 7), (6, 7), (7, 7)]


class Heavier(MassSprings):
    """3 % more mass than the model knows."""

    def network(self, positions, parameters=None):
        network = super().network(positions, parameters)
        return SpringNetwork(**vars(network) | {"mass": 1.03 * network.mass})


def held_out(model, seed, noise=0.02):
    rng = np.random.default_rng(seed)
    return simulate_frf(model, ELSEWHERE, OMEGA, RelativeNoise(noise, noise / 4), rng)


def test_right_predictions_are_calibrated(fits):
    found = [
        validate(MODEL, one.parameters.values, held_out(MODEL, 100 + seed), covariance(one))
        for seed, one in enumerate(fits)
    ]
    coverage, n = np.array([f.coverage for f in found]), len(found)
    within = 4 * coverage.std(axis=0) / np.sqrt(n)
    assert within.max() < 0.05
    assert (np.abs(coverage.mean(axis=0) - found[0].levels) < within).all()
    misfits = [f.misfit for f in found]
    assert np.mean(misfits) == pytest.approx(1.0, abs=4 * np.std(misfits) / np.sqrt(n))
    # Probabilities of right models are uniform.
    assert np.mean([f.probability for f in found]) == pytest.approx(0.5, abs=4 / np.sqrt(12 * n))
    assert all(f.calibrated for f in found)
    assert found[0].by_position.shape == (2, 19)
    assert "predictions hold" in str(found[0])


def test_wrong_predictions_are_not(found, known):
    values = found.parameters.values
    heavier = validate(MODEL, values, held_out(Heavier(), 3, 0.01), known)
    assert not heavier.calibrated
    assert "too narrow: a model error" in str(heavier)
    assert heavier.coverage[-1] < 0.9
    narrow = Uncertainty(NAMES, 1e-6 * known.covariance, "too narrow")
    moved = values * np.exp(4 * known.std * np.array([1, -1, 1, 1, 1, 1]))
    assert not validate(MODEL, moved, held_out(MODEL, 3, 0.002), narrow).calibrated
    quiet = held_out(MODEL, 3)
    loud = type(quiet)(**vars(quiet) | {"covariance": 4 * quiet.covariance})
    assert "less noise than stated" in str(validate(MODEL, values, loud, known))


def test_what_cannot_be_predicted_is_named(known):
    other = Uncertainty(("a",), np.eye(1), "")
    with pytest.raises(InvalidInput, match="prediction: an uncertainty of a for the parameters k1"):
        predict_frf(MODEL, TRUTH, ELSEWHERE, OMEGA, other)
    with pytest.raises(InvalidInput, match=r"draws of shape \(3, 2\); \(N, 6\)"):
        predict_modes(MODEL, TRUTH, ELSEWHERE, np.ones((3, 2)))
    with pytest.raises(InvalidInput, match=r"prediction: level 1\.5 does not"):
        predict_modes(MODEL, TRUTH, ELSEWHERE, known, level=1.5)
    with pytest.raises(InvalidInput, match="motor 7: the model has motors 0 to 1"):
        predict_modes(MODEL, TRUTH, ELSEWHERE, known, motor=7)
    with pytest.raises(InvalidInput, match="validation: an uncertainty of a"):
        validate(MODEL, TRUTH, held_out(MODEL, 0), other)
    with pytest.raises(InvalidInput, match=r"levels: 0\.5 to 1; between"):
        validate(MODEL, TRUTH, held_out(MODEL, 0), known, np.array([0.5, 1.0]))
    assert len(POSITIONS) == 3


@pytest.mark.parametrize("weighting", ["joint", "row_wise"])
def test_runs_that_were_not_fitted_are_predicted(weighting):
    """Covariances of 8 or 5 degrees of freedom, 30 % noise of torques, two runs."""
    freedom = {"joint": 8, "row_wise": 5}[weighting]
    judged = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        data, other = (noisy_runs(rng, 2, 0.3, freedom=freedom) for _ in range(2))
        one = fit(MODEL, data)
        judged.append(validate(MODEL, one.parameters.values, other, covariance(one)))
    assert run_problem(MODEL, other).weighting == weighting
    n = len(judged)
    misfits = np.array([f.misfit for f in judged])
    assert misfits.mean() == pytest.approx(1.0, abs=4 * misfits.std() / np.sqrt(n))
    assert np.mean([f.probability for f in judged]) == pytest.approx(0.5, abs=4 / np.sqrt(12 * n))
    assert np.mean([f.coverage[-1] for f in judged]) == pytest.approx(0.95, abs=0.02)
    moved = one.parameters.values * 1.3
    assert not validate(MODEL, moved, other, covariance(one)).calibrated
