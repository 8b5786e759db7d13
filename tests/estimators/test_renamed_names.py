"""Old names of this package's attributes and keywords work with a warning."""

import pytest

import estimators


@pytest.mark.parametrize(
    ("cls", "old", "new"),
    [
        (estimators.Fit, "own_residual", "custom_residual"),
        (estimators.FrfEstimate, "noise_known", "has_degrees_of_freedom"),
    ],
)
def test_attributes(cls, old, new):
    value = cls.__new__(cls)
    if new == "has_degrees_of_freedom":
        object.__setattr__(value, "degrees_of_freedom", 3.0)
    with pytest.warns(DeprecationWarning, match=f"{cls.__name__}.{old} is now '{new}'"):
        assert getattr(value, old) == getattr(value, new)


def test_posterior_of_the_cost_by_its_old_keyword():
    with (
        pytest.warns(DeprecationWarning, match="keyword 'own_cost' is now 'cost_posterior'"),
        pytest.raises(AttributeError),  # of the fit, which is none
    ):
        estimators.cross_check(None, own_cost=None)
