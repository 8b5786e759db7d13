"""Residuals of FRFs, [WM] (4c) and (7c), and losses that count large ones less."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.frf.frf_estimate import is_full, location, vec
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import InvalidInput, check_word
from robotmodels.linear.residuals import ResidualForm, residual_error, residual_form

# Relative error of J/G, two complex products and a division of some epsilons each.
ROUNDING = 16 * float(np.finfo(float).eps)


@dataclass(frozen=True)
class Residual:
    """A residual form with its derivative and the noise it passes on.

    Attributes
    ----------
    form : ResidualForm
        What is compared, see there for `name`, `relative` and `real`.
    """

    form: ResidualForm

    @property
    def name(self) -> str:
        """What results call it."""
        return self.form.name

    @property
    def relative(self) -> bool:
        """Whether noise and slopes are divided by G."""
        return self.form.relative

    @property
    def real(self) -> bool:
        """Whether only the real part counts."""
        return self.form.real

    def error(
        self, measured: ComplexArray, modelled: ComplexArray, used: NDArray[np.bool_] | None = None
    ) -> Array | ComplexArray:
        """Return the residual (Q, F, m, n); no logarithm is taken, and 0 returned, if not `used`.

        Raises
        ------
        InvalidInput
            If a logarithm is taken of zero or of a number that is not finite.
        """
        if used is not None:
            measured = np.where(used, measured, 1.0 + 0j)
            modelled = np.where(used, modelled, 1.0 + 0j)
        if self.relative:
            for name, response in (("measured", measured), ("modelled", modelled)):
                wrong = np.argwhere(~np.isfinite(response) | (response == 0))
                if wrong.size:
                    raise InvalidInput(
                        f"{name} FRF: {response[tuple(wrong[0])]} at {location(wrong[0])} has no "
                        "logarithm; give that element the weight zero, or use the residual 'nls'"
                    )
        return residual_error(self.form, measured, modelled)

    def jacobian(
        self,
        modelled: ComplexArray,
        sensitivity: ComplexArray,
        used: NDArray[np.bool_] | None = None,
    ) -> Array | ComplexArray:
        """Return d residual / d ln theta, (Q, F, m, n, p), from dG/d ln theta.

        A magnitude's derivative that is rounding beside the phase's is zero, not information.
        """
        if used is not None:
            modelled = np.where(used, modelled, 1.0 + 0j)
            sensitivity = np.where(used[..., None], sensitivity, 0.0)
        slope = -self.form.slope(modelled)[..., None] * sensitivity
        if not self.real:
            return np.asarray(slope)
        return np.where(np.abs(slope.real) > ROUNDING * np.abs(slope), slope.real, 0.0)

    def noise(
        self,
        covariance: Array | ComplexArray,
        response: ComplexArray,
        used: NDArray[np.bool_] | None = None,
    ) -> Array | ComplexArray:
        """Return the residual's covariance R from the FRF's: to first order G_d^-1 Lambda G_d^-H.

        log(1 + eta/G) = eta/G + ...; of a circular eta/G with covariance R the real part has the
        covariance Re R / 2. The half is left out here: the factor 2 in `information` counts real
        and imaginary parts alike, so Re R is what fits there, and in the optimal weights.
        """
        full = is_full(covariance, response.shape)
        slope = self.form.slope(response if used is None else np.where(used, response, 1.0 + 0j))
        v = vec(slope)
        outer = v[..., :, None] * np.conj(v[..., None, :]) if full else np.abs(slope) ** 2
        covariance = np.asarray(covariance * outer)
        return np.asarray(covariance.real) if self.real or not full else covariance


def find_residual(residual: str | ResidualForm | Residual) -> Residual:
    """Return the residual of that name or form, or `residual` itself if it is one.

    Raises
    ------
    InvalidInput
        If there is none of that name, or it is no residual.
    """
    return residual if isinstance(residual, Residual) else Residual(residual_form(residual))


def nls(measured: ComplexArray, modelled: ComplexArray) -> ComplexArray:
    """Nonlinear least squares residual $G_m - G$ of a measured FRF $G_m$, [WM] (4c)."""
    return np.asarray(find_residual("nls").error(measured, modelled), dtype=complex)


def lls(measured: ComplexArray, modelled: ComplexArray) -> ComplexArray:
    """Log residual $log(G_m / G)$, [WM] (7c); the ratio keeps the phase in (-pi, pi].

    Raises
    ------
    InvalidInput
        If an FRF is zero or not finite, with position, frequency and element.
    """
    return np.asarray(find_residual("lls").error(measured, modelled), dtype=complex)


def lls_magnitude(measured: ComplexArray, modelled: ComplexArray) -> Array:
    """Log residual of the magnitudes only, $log |G_m / G|$: LLSM of [WM] 6, real part of (7c)."""
    return find_residual("lls_magnitude").error(measured, modelled).real


def _linear(z: Array) -> tuple[Array, Array, Array]:
    return z, np.ones_like(z), np.zeros_like(z)


def _soft_l1(z: Array) -> tuple[Array, Array, Array]:
    t = 1 + z
    return 2 * (np.sqrt(t) - 1), t**-0.5, -0.5 * t**-1.5


def _huber(z: Array) -> tuple[Array, Array, Array]:
    inside = z <= 1
    root = np.sqrt(np.where(inside, 1.0, z))
    return (
        np.where(inside, z, 2 * root - 1),
        1 / root,
        np.where(inside, 0.0, -0.5 / root**3),
    )


def _cauchy(z: Array) -> tuple[Array, Array, Array]:
    t = 1 + z
    return np.log1p(z), 1 / t, -1 / t**2


LOSSES: dict[str, Callable[[Array], tuple[Array, Array, Array]]] = {
    "linear": _linear,
    "soft_l1": _soft_l1,
    "huber": _huber,
    "cauchy": _cauchy,
}


def check_loss(name: str) -> str:
    """Return `name` if there is a loss of that name.

    Raises
    ------
    InvalidInput
        If there is none.
    """
    check_word("loss", name, LOSSES)
    return name


def robust_loss(name: str, squares: Array, variance: Array) -> Array:
    """Return s^2 rho(z/s^2) and its first two derivatives by z, (3, r).

    The losses rho are those of `scipy.optimize.least_squares`; a residual counts in full up to
    about its own standard deviation s.

    Parameters
    ----------
    squares : ndarray, (r,)
        Squared residuals z.
    variance : ndarray, (r,)
        Their expected values s^2.
    """
    values = LOSSES[name](squares / variance)
    return np.stack([variance * values[0], values[1], values[2] / variance])


def loss_factors(loss: str) -> tuple[float, float]:
    """Return E[rho' + 2 z rho''] and E[z rho'^2] with z = u^2 of a normal u.

    By these a robust loss scales bread and meat where the noise is normal; one and one for
    "linear".
    """
    u = np.linspace(-10.0, 10.0, 20001)
    density = np.exp(-(u**2) / 2)
    density /= density.sum()
    _, first, second = LOSSES[loss](u**2)
    return float(density @ (first + 2 * u**2 * second)), float(density @ (u * first) ** 2)
