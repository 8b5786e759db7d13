"""A small model for statistical tests of fits: two coupled chains of two masses, quick to fit."""

import numpy as np
from derivatives import circular

from estimators import FrfEstimate
from robotmodels import CoupledChains, RelativeNoise, frequency_response

OMEGA = np.linspace(2.0, 30.0, 24)
POSITIONS = np.zeros((1, 0))


def two_chains(extra=()):
    return CoupledChains(
        masses=np.array([[1.0, 2.0], [1.5, 1.0]]),
        springs=np.array([[200.0], [150.0]]),
        couplings=np.array([[0.0, 0.6], [0.6, 0.0]]),
        dampers=np.array([[2.0], [1.5]]),
        extra=extra,
    )


def one_chain(extra=("m1", "m2")):
    return CoupledChains(
        masses=np.array([[1.0, 2.0]]),
        springs=np.array([[200.0]]),
        couplings=np.zeros((1, 1)),
        dampers=np.array([[4.0]]),
        extra=extra,
    )


def truth(model, omega=OMEGA):
    return np.asarray(frequency_response(model, POSITIONS, omega))


def with_errors(response, errors, covariance, omega=OMEGA):
    return FrfEstimate(POSITIONS, omega, response + errors, covariance, np.ones(1, dtype=int))


def drawn(response, rng, noise=RelativeNoise(0.02, 0.005), omega=OMEGA, stated=1.0):  # noqa: B008
    """Return the FRFs with errors of the law, whose stated variance is `stated` times the true."""
    variance = noise.variance(response)
    errors = np.sqrt(variance) * circular(rng, *response.shape)
    return with_errors(response, errors, stated * variance, omega)
