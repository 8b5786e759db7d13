"""The noise law: a part of each element and a part of the largest one."""

import numpy as np
import pytest

from robotmodels import InvalidInput, RelativeNoise


def test_the_variance_is_its_formula_element_by_element() -> None:
    rng = np.random.default_rng(0)
    G = rng.normal(size=(2, 3, 4, 2)) + 1j * rng.normal(size=(2, 3, 4, 2))
    variance = RelativeNoise(relative=0.03, floor=0.01).variance(G)
    assert variance.shape == G.shape
    for q in range(2):
        for f in range(3):
            largest = max(abs(G[q, f, i, j]) for i in range(4) for j in range(2))
            for i in range(4):
                for j in range(2):
                    expected = (0.03 * abs(G[q, f, i, j])) ** 2 + (0.01 * largest) ** 2
                    assert variance[q, f, i, j] == pytest.approx(expected, rel=1e-14)


def test_an_element_without_response_has_the_floor() -> None:
    G = np.array([[[[2.0 + 0j, 0.0]]]])
    assert RelativeNoise(0.03, 0.01).variance(G)[0, 0, 0, 1] == pytest.approx(0.02**2)


@pytest.mark.parametrize("laws", [(0.0, 0.01), (0.03, 0.0)])
def test_either_part_may_be_absent(laws: tuple[float, float]) -> None:
    variance = RelativeNoise(*laws).variance(np.ones((1, 1, 2, 2), dtype=complex))
    np.testing.assert_allclose(variance, max(laws) ** 2)


@pytest.mark.parametrize(
    ("relative", "floor", "message"),
    [
        (-0.1, 0.01, "noise.relative: -0.1 is not a number >= 0"),
        (0.03, -1.0, "noise.floor: -1.0 is not a number >= 0"),
        (float("nan"), 0.01, "noise.relative: nan is not a number >= 0"),
        (0.03, float("inf"), "noise.floor: inf is not a number >= 0"),
        (0.0, 0.0, "noise: relative and floor are both zero; one must be positive"),
    ],
)
def test_laws_that_cannot_be(relative: float, floor: float, message: str) -> None:
    with pytest.raises(InvalidInput) as error:
        RelativeNoise(relative, floor)
    assert str(error.value) == message
