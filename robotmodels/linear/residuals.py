"""Residuals of FRFs: what a fit's cost compares, [WM] (4c) and (7c), each written once.

`robotmodels.kernel` has compiled twins of those in `RESIDUALS`; numpy evaluates any other one.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import InvalidInput, check_word


@runtime_checkable
class ResidualForm(Protocol):
    """A residual g(measured) - g(modelled) with an analytic function g of an FRF's elements.

    Where it is relative, named weights leave out elements below 10 dB and are evaluated once more
    at the FRF of the fit.
    """

    @property
    def name(self) -> str:
        """What results call it."""

    @property
    def relative(self) -> bool:
        """Whether g divides by the FRF or takes its logarithm."""

    @property
    def real(self) -> bool:
        """Whether only the real part counts."""

    def difference(self, measured: ComplexArray, modelled: ComplexArray) -> ComplexArray:
        """Return the residual, of the FRFs' shape."""

    def slope(self, modelled: ComplexArray) -> Array | ComplexArray:
        """Return dg/dG, of the FRF's shape: minus the residual's derivative by the model's FRF."""


@dataclass(frozen=True)
class OutputError:
    """The nonlinear least squares residual, [WM] (4c)."""

    name: str = "nls"
    relative: bool = False
    real: bool = False

    def difference(self, measured: ComplexArray, modelled: ComplexArray) -> ComplexArray:
        """Return the difference."""
        return np.asarray(measured - modelled)

    def slope(self, modelled: ComplexArray) -> Array:
        """Return ones."""
        return np.ones(modelled.shape)


@dataclass(frozen=True)
class LogRatio:
    """The log residual, [WM] (7c), or its real part, LLSM of [WM] 6."""

    name: str = "lls"
    relative: bool = True
    real: bool = False

    def difference(self, measured: ComplexArray, modelled: ComplexArray) -> ComplexArray:
        """Return the logarithm of the ratio, which keeps the phase in (-pi, pi]."""
        return np.asarray(np.log(measured / modelled))

    def slope(self, modelled: ComplexArray) -> ComplexArray:
        """Return the inverse."""
        return np.asarray(1.0 / modelled)


RESIDUALS: dict[str, ResidualForm] = {
    "nls": OutputError(),
    "lls": LogRatio(),
    "lls_magnitude": LogRatio("lls_magnitude", real=True),
}


def residual_form(residual: str | ResidualForm) -> ResidualForm:
    """Return the residual of that name, or the residual itself.

    Raises
    ------
    InvalidInput
        If there is none of that name, or it is no residual.
    """
    if isinstance(residual, str):
        check_word("residual", residual, RESIDUALS)
        return RESIDUALS[residual]
    if not isinstance(residual, ResidualForm):
        raise InvalidInput(f"residual {residual!r} is neither a name nor a `ResidualForm`")
    return residual


def residual_error(
    form: ResidualForm, measured: ComplexArray, modelled: ComplexArray
) -> Array | ComplexArray:
    """Return what is squared: the residual, or its real part where only that counts."""
    difference = form.difference(measured, modelled)
    return difference.real if form.real else difference
