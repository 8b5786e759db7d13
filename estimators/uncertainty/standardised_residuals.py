"""Residuals over their standard deviations: standard normal if model and noise are right."""

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from robotmodels.common.arrays import Array


def standardised_residuals(fit: FittedModel) -> Array:
    """Return real and imaginary parts of the residuals over their standard deviations.

    Standard deviations are those of the noise less what the fit takes up, line by line.

    Parameters
    ----------
    fit : Fit or RunFit
        A fit.

    Returns
    -------
    ndarray, (parts, Q, F, k)
        For Q positions or visits, F lines and k elements; one part where residuals are real.
        Not a number where an element is not used.
    """
    linear = fit.linearise()
    variance = np.where(linear.used, linear.element_variances, np.nan) / linear.parts
    parts = [linear.residuals.real, linear.residuals.imag][: linear.parts]
    return np.asarray(np.stack(parts) / np.sqrt(variance))
