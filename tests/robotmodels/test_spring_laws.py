"""The cubic that hardens with torque."""

import numpy as np
import pytest
from scipy.optimize import brentq

from robotmodels.description.spring_laws import SpringLaws

LOW, HIGH, TORQUE = 2e4, 6e4, 80.0


def law(low: float = LOW, high: float = HIGH, torque: float = TORQUE) -> SpringLaws:
    return SpringLaws(np.array([low]), np.array([high]), np.array([torque]))


@pytest.mark.parametrize("high", [6e4, 2.5e4, 1.2e4])  # the last one softens
def test_the_slope_is_low_at_rest_and_high_at_the_stated_torque(high: float) -> None:
    spring = law(high=high)
    assert spring(np.zeros(1))[1] == LOW
    knee = brentq(
        lambda x: spring(np.array([x]))[0][0] - TORQUE, 0, 1.01 * 3 * TORQUE / (2 * LOW + high)
    )
    assert knee == pytest.approx(3 * TORQUE / (2 * LOW + high), rel=1e-12)
    assert spring(np.array([knee]))[1][0] == pytest.approx(high, rel=1e-10)


def test_torques_are_odd_and_the_slope_is_their_derivative() -> None:
    x, h = np.linspace(-0.01, 0.01, 11)[:, None], 1e-6
    torque, slope = law()(x)
    np.testing.assert_allclose(torque, -law()(-x)[0])
    np.testing.assert_allclose(slope, (law()(x + h)[0] - law()(x - h)[0]) / (2 * h), rtol=1e-6)
    stiffening = (law()(x + h)[1] - law()(x - h)[1]) / (2 * h)
    np.testing.assert_allclose(law().stiffening(x), stiffening, rtol=1e-5, atol=1e-2)


def test_an_infinite_torque_makes_it_linear() -> None:
    x = np.array([0.3])
    torque, slope = law(high=LOW, torque=np.inf)(x)
    assert torque == LOW * x
    assert slope == LOW


@pytest.mark.parametrize("end", ["low", "high"])
def test_derivatives_by_its_parameters(end: str) -> None:
    x, h = np.linspace(-0.005, 0.005, 7)[:, None], 1e-5
    value = {"low": LOW, "high": HIGH}[end]
    plus, minus = (law(**{end: value * np.exp(s)})(x) for s in (h, -h))
    for found, up, down in zip(getattr(law(), f"by_{end}")(x), plus, minus, strict=True):
        np.testing.assert_allclose(found, (up - down) / (2 * h), rtol=1e-6, atol=1e-6)


def test_elongations_invert_the_torque():
    law = SpringLaws(
        np.array([20.0, 500.0, 3e4]), np.array([1e4, 2000.0, 3e4]), np.array([5.0, 15.0, np.inf])
    )
    torques = np.array([[0.0, 0.0, 0.0], [0.3, -7.0, 250.0], [-40.0, 90.0, -1e3]])
    np.testing.assert_allclose(law(law.elongations(torques))[0], torques, rtol=1e-10, atol=1e-12)
