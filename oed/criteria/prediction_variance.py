"""Criteria for those who want predictions: the variance of FRFs, resonances, any quantity.

A prediction's variance is g' M^-1 g with g its derivative by ln theta, so its mean over many
predictions is tr(L M^-1) with L the mean of g g', which `ICriterion` takes.
"""

import numpy as np

from estimators.validation.quantities import Quantity, Resonances, log_gradients
from oed.criteria.criteria import ICriterion
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import InvalidInput
from robotmodels.linear.response import Elastic, sensitivity


def prediction_matrix(gradients: Array | ComplexArray, shares: Array | None = None) -> Array:
    """Return L, (p, p), the mean of Re(conj(g) g') over all predictions.

    Parameters
    ----------
    gradients : ndarray or ndarray of complex, (..., p)
        Derivatives of the predictions; complex ones count both parts.
    shares : ndarray, optional
        Weight of each prediction, of the leading shape; equal if None.

    Raises
    ------
    InvalidInput
        If there is no prediction, one is not finite, or shares do not fit.
    """
    g = np.asarray(gradients)
    flat = g.reshape(-1, g.shape[-1]) if g.ndim else np.zeros((0, 1))
    if len(flat) == 0 or not np.isfinite(flat).all():
        raise InvalidInput(f"gradients: shape {g.shape}; finite numbers of shape (..., p) needed")
    w = np.ones(len(flat)) if shares is None else np.asarray(shares, dtype=float).ravel()
    if len(w) != len(flat) or not (np.isfinite(w) & (w >= 0)).all() or not w.any():
        raise InvalidInput(f"shares: {len(w)} of them; {len(flat)} numbers >= 0 are needed")
    return np.asarray(((flat.conj().T * (w / w.sum())) @ flat).real)


def prediction_std(gradients: Array | ComplexArray, covariance: Array) -> Array:
    """Return the standard deviations sqrt(g* C g) of predictions, (...).

    Parameters
    ----------
    gradients : ndarray or ndarray of complex, (..., p)
        Derivatives of the predictions by ln theta.
    covariance : ndarray, (p, p)
        Covariance C of ln theta.
    """
    variance = np.sum((gradients.conj() @ covariance) * gradients, axis=-1).real
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def log_frf_gradients(robot: Elastic, positions: Array, omega: Array) -> ComplexArray:
    """Return the derivatives of ln G by ln theta, (Q, F, n, n, p); zero where G is zero.

    Parameters
    ----------
    robot : Elastic
        A model with `parameters` and `network(positions)`.
    positions : ndarray, (Q, n), rad
        Where FRFs are to be predicted.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    """
    response, jacobian = sensitivity(robot, np.atleast_2d(positions), np.asarray(omega, float))
    nonzero = np.where(response == 0, 1.0, response)[..., None]
    return np.asarray(np.where((response == 0)[..., None], 0.0, jacobian / nonzero))


def log_resonance_gradients(robot: Elastic, positions: Array) -> Array:
    """Return the derivatives of ln frequencies of the resonances by ln theta, (Q, k, p).

    By central differences, the equilibria moving with the parameters. Two modes that cross within
    the step of 1e-4 are exchanged; a mean over a workspace does not notice.

    Parameters
    ----------
    robot : Elastic
        A model with `parameters` and `network(positions)`.
    positions : ndarray, (Q, n), rad
        Where resonances are to be predicted.
    """
    return np.asarray(log_gradients(robot, Resonances(motors="free"), positions))


def purpose_criterion(
    robot: Elastic, quantity: str | Quantity, positions: Array, parameters: Array | None = None
) -> ICriterion:
    """Return the mean relative variance of a quantity over positions: I- or V-optimality.

    Parameters
    ----------
    robot : Elastic
        Robot that designs are for.
    quantity : str or Quantity
        As in `estimators.predict`; any function of model, positions and parameters will do, such
        as one that returns `robotmodels.loop_margins(...).gain_margin`.
    positions : ndarray, (Q, n), rad
        Where it is to be known, measured in or not.
    parameters : ndarray, (p,), optional
        Parameters at which derivatives are taken; the robot's by default.

    Raises
    ------
    InvalidInput
        For an unknown quantity, or one that does not exist in a position.
    IdentificationError
        If the robot has no equilibrium in a position.
    """
    return ICriterion(prediction_matrix(log_gradients(robot, quantity, positions, parameters)))
