import numpy as np
import pytest

import oed
from oed import log_frf_gradients, log_resonance_gradients, prediction_matrix
from robotmodels import (
    InvalidInput,
    RelativeNoise,
    frequency_response,
    linearize,
    load_robot,
    resonances,
)

ROBOT = load_robot("manutec_r3")
POSITIONS = np.random.default_rng(0).uniform(-1, 1, (12, 6))
OMEGA = 2 * np.pi * np.linspace(3, 40, 8)


def test_matrix_is_the_mean_of_products():
    rng = np.random.default_rng(1)
    g = rng.standard_normal((3, 4, 5)) + 1j * rng.standard_normal((3, 4, 5))
    expected = sum(np.outer(x.conj(), x).real for x in g.reshape(-1, 5)) / 12
    np.testing.assert_allclose(prediction_matrix(g), expected)
    first = np.zeros((3, 4))
    first[0, 0] = 2.0
    np.testing.assert_allclose(prediction_matrix(g, first), np.outer(g[0, 0].conj(), g[0, 0]).real)


def test_gradients_are_derivatives():
    h = 1e-4 * np.random.default_rng(2).standard_normal(len(ROBOT.parameters.values))
    up, down = (ROBOT.parameters.values * np.exp(s * h) for s in (1, -1))
    frf = [frequency_response(ROBOT, POSITIONS[:2], OMEGA, theta) for theta in (up, down)]
    moved = np.log(frf[0] / frf[1]) / 2
    gradients = log_frf_gradients(ROBOT, POSITIONS[:2], OMEGA)
    np.testing.assert_allclose(gradients @ h, moved, atol=1e-6)
    modes = [np.log(resonances(linearize(ROBOT, POSITIONS[:2], t)).frequencies) for t in (up, down)]
    np.testing.assert_allclose(
        log_resonance_gradients(ROBOT, POSITIONS[:2]) @ h, (modes[0] - modes[1]) / 2, atol=1e-7
    )


@pytest.mark.parametrize("gradients", [log_resonance_gradients, log_frf_gradients])
def test_a_design_for_predictions_predicts_best(gradients):
    """Mean variance of the predictions, computed from their gradients one by one."""
    info = oed.information(ROBOT, POSITIONS, OMEGA, RelativeNoise())
    arguments = (OMEGA,) if gradients is log_frf_gradients else ()
    g = gradients(ROBOT, POSITIONS, *arguments)
    g = g.reshape(-1, g.shape[-1])
    wanted = oed.ICriterion(prediction_matrix(g))
    best = oed.optimal_design(info, wanted, solver="newton")

    def variance(design):
        return np.mean([(x.conj() @ np.linalg.solve(design.information, x)).real for x in g])

    assert -best.value == pytest.approx(variance(best), rel=1e-8)
    for other in ("D", "A"):
        assert variance(best) < variance(oed.optimal_design(info, other, solver="newton"))


@pytest.mark.parametrize(
    ("gradients", "shares", "message"),
    [
        (np.zeros((0, 3)), None, r"gradients: shape \(0, 3\)"),
        (np.array([[np.nan]]), None, "gradients: shape .* finite"),
        (np.ones((2, 3)), np.ones(3), "shares: 3 of them; 2 numbers >= 0"),
        (np.ones((2, 3)), np.zeros(2), "shares: 2 of them; 2 numbers >= 0"),
    ],
)
def test_predictions_that_are_none(gradients, shares, message):
    with pytest.raises(InvalidInput, match=message):
        prediction_matrix(gradients, shares)
