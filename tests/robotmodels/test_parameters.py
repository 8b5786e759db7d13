"""Free parameters: as many names, values and units; positive numbers."""

from collections.abc import Sequence

import numpy as np
import pytest

from robotmodels import InvalidInput, Parameters

UNITS = ("N m/rad", "N m s/rad")


def two() -> Parameters:
    return Parameters(("g.stiffness", "g.damping"), np.array([5e3, 4.0]), UNITS)


def test_they_are_found_by_name_and_counted() -> None:
    assert len(two()) == 2
    assert two().index("g.damping") == 1


def test_an_unknown_name_comes_with_the_nearest() -> None:
    with pytest.raises(InvalidInput) as error:
        two().index("g.stifness")
    assert str(error.value) == (
        "parameter 'g.stifness' is not among the free parameters (did you mean 'g.stiffness'?)"
    )


def test_values_cannot_be_changed_from_outside() -> None:
    own = np.array([5e3, 4.0])
    parameters = Parameters(("a", "b"), own, UNITS)
    own[0] = 1.0
    assert parameters.values[0] == 5e3
    with pytest.raises(ValueError, match="read-only"):
        parameters.values[0] = 1.0


def test_without_values_they_are_the_parameters_own() -> None:
    parameters = two()
    assert parameters.check(None) is parameters.values
    np.testing.assert_array_equal(parameters.check([1, 2]), [1.0, 2.0])


@pytest.mark.parametrize(
    ("names", "values", "units", "found"),
    [
        (("a",), [1.0, 2.0], UNITS, "1 names, 2 values and 2 units"),
        (("a", "b"), [1.0], UNITS, "2 names, 1 values and 2 units"),
        (("a", "b"), [1.0, 2.0], ("kg",), "2 names, 2 values and 1 units"),
    ],
)
def test_one_of_each_is_needed(
    names: tuple[str, ...], values: list[float], units: tuple[str, ...], found: str
) -> None:
    with pytest.raises(InvalidInput) as error:
        Parameters(names, np.array(values), units)
    assert str(error.value) == f"parameters: {found}; one of each per parameter is needed"


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([5e3, 0.0], "parameter g.damping: 0 is not a positive number"),
        ([-1.0, 4.0], "parameter g.stiffness: -1 is not a positive number"),
        ([np.nan, 4.0], "parameter g.stiffness: nan is not a positive number"),
        ([5e3, np.inf], "parameter g.damping: inf is not a positive number"),
        (
            [1.0],
            "parameters: an array of shape (1,) was given, (2,) is needed, in the order "
            "g.stiffness, g.damping",
        ),
        (["a", "b"], "parameters: an array of real numbers is needed, found ['a', 'b']"),
        ([1j, 1.0], "parameters: an array of real numbers is needed, found [1j, 1.0]"),
    ],
)
def test_values_that_cannot_be(values: Sequence[float], message: str) -> None:
    with pytest.raises(InvalidInput) as error:
        two().check(values)  # type: ignore[arg-type]  # what a user may pass
    assert str(error.value) == message
