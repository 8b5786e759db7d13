"""Margins over draws: their bands, how often they are unstable, and what is suggested."""

import numpy as np
import pytest
from robots import PENDULUM, built, changed

from estimators import predict_margins, suggestions
from robotmodels import (
    Controller,
    InvalidInput,
    linear_feedback,
    loop_margins,
)

T = 1e-3
GUESSED = {"g.stiffness": 0.3, "g.damping": 0.5}
LATE = [PENDULUM["motors"][0] | {"torque_delay": 6e-3}]
ROBOT = built(changed(PENDULUM, motors=LATE, guessed=GUESSED))
AT = np.array([[0.4], [-0.3]])


def cascade(gain: float) -> Controller:
    return Controller(np.array([gain]), np.array([0.3]), np.array([4.0]), T)


def draws(count: int, seed: int = 0) -> np.ndarray:
    values = ROBOT.parameters.values
    std = np.array([GUESSED[name] for name in ROBOT.parameters.names])
    return np.log(values) + std * np.random.default_rng(seed).standard_normal((count, len(std)))


def test_bands_are_quantiles_of_draws_margins() -> None:
    drawn, feedback = draws(31), linear_feedback(cascade(0.1))
    options = {"rng": np.random.default_rng(0), "draws": drawn, "level": 0.9}
    band = predict_margins(ROBOT, cascade(0.1), AT, **options)
    each = [loop_margins(ROBOT, AT, feedback, np.exp(x)) for x in drawn]
    peaks = np.sort([m.peak_sensitivity for m in each], axis=0)
    np.testing.assert_array_equal(band.lower.peak_sensitivity, peaks[1])
    np.testing.assert_array_equal(band.upper.peak_sensitivity, peaks[-2])
    np.testing.assert_array_equal(band.unstable, 0)
    nominal = loop_margins(ROBOT, AT, feedback)
    np.testing.assert_array_equal(band.nominal.gain_margin, nominal.gain_margin)
    assert (band.lower.gain_margin < nominal.gain_margin).all()


def test_the_probability_of_instability_is_that_of_the_edge() -> None:
    """Where the gain is at its margin, about half of the draws are unstable; far below, none."""
    edge = loop_margins(ROBOT, AT[:1], linear_feedback(cascade(0.1))).gain_margin[0, 0] * 0.1
    shares = [
        predict_margins(ROBOT, cascade(gain), AT[:1], rng=np.random.default_rng(1), draws=40)
        for gain in (0.1 * edge, edge * 0.999)
    ]
    assert shares[0].probability[0] == 0
    assert shares[0].probability_bound[0] == pytest.approx(1 - 0.05 ** (1 / 40))
    assert 0.2 < shares[1].probability[0] < 0.8
    assert shares[1].lower.gain_margin[0, 0] == 0
    assert np.isinf(shares[1].upper.peak_sensitivity[0, 0])


def test_draws_with_which_the_robot_falls_are_unstable() -> None:
    soft = draws(4)
    soft[:2, ROBOT.parameters.names.index("g.stiffness")] = np.log(5.0)
    band = predict_margins(ROBOT, cascade(0.1), AT, rng=np.random.default_rng(0), draws=soft)
    assert (band.unstable >= 2).all()


def test_suggestions_lower_the_worst_peak_as_they_say() -> None:
    robot, feedback = ROBOT, linear_feedback(cascade(0.12))
    before = loop_margins(robot, AT, feedback).peak_sensitivity.max()
    assert before > 2
    (remedy,) = suggestions(robot, feedback, AT)
    changed_loop = feedback.filtered(remedy.motor, remedy.notch, remedy.gain)
    after = loop_margins(robot, AT, changed_loop)
    assert after.stable.all()
    assert remedy.before == before
    assert remedy.after == after.peak_sensitivity.max() < before
    assert suggestions(robot, feedback.filtered(0, None, 0.05), AT) == ()


def test_more_gain_is_suggested_where_damping_is_short() -> None:
    """An integral part that is too fast for the speed loop: the gain that damps it is larger."""
    slow = Controller(np.array([0.01]), np.array([0.05]), np.array([4.0]), T)
    (remedy,) = suggestions(ROBOT, slow, AT)
    assert remedy.notch is None
    assert remedy.gain == 2.0
    assert remedy.after < 0.7 * remedy.before


def test_mistakes_are_named() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InvalidInput, match="no standard deviation"):
        predict_margins(built(PENDULUM), cascade(0.1), AT, rng=rng)
    with pytest.raises(InvalidInput, match=r"draws of shape \(3, 5\)"):
        predict_margins(ROBOT, cascade(0.1), AT, rng=rng, draws=np.ones((3, 5)))
    with pytest.raises(InvalidInput, match="draws"):
        predict_margins(ROBOT, cascade(0.1), AT, rng=rng, draws=1)
