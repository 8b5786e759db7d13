"""What data say about elastic robots: FRFs, fits, covariances, posteriors.

Public names that need emcee are imported when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

# Functions that share their module's name must be bound here: importing the module later would
# otherwise put the module in their place.
from estimators.covariance import Uncertainty, covariance
from estimators.frf_estimate import FrfEstimate, simulate_frf
from estimators.information import information
from estimators.least_squares import Fit, fit, multistart, perturbed_starts, reweighted
from estimators.residuals import lls, lls_magnitude, nls
from estimators.weights import optimal_weights, user_weights

if TYPE_CHECKING:
    from estimators.posterior import Posterior, sample_posterior

__all__ = [
    "Fit",
    "FrfEstimate",
    "Posterior",
    "Uncertainty",
    "covariance",
    "fit",
    "information",
    "lls",
    "lls_magnitude",
    "multistart",
    "nls",
    "optimal_weights",
    "perturbed_starts",
    "reweighted",
    "sample_posterior",
    "simulate_frf",
    "user_weights",
]

_LATER = {
    "Posterior": "estimators.posterior",
    "sample_posterior": "estimators.posterior",
}


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'estimators' has no attribute {name!r}")
    return getattr(import_module(_LATER[name]), name)


def __dir__() -> list[str]:
    return __all__
