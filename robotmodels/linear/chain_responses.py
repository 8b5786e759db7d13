"""FRFs of coupled chains, free or with position controllers on chosen motors, [HBH] (4) and (9)."""

from collections.abc import Sequence

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray, check_above_zero
from robotmodels.common.deprecation import renamed_keywords
from robotmodels.common.errors import InvalidInput
from robotmodels.linear.coupled_chains import CoupledChains
from robotmodels.linear.linear_model import LinearModel
from robotmodels.linear.modes import resonances
from robotmodels.linear.response import check_omega


def position_controlled(model: LinearModel, gains: Array) -> LinearModel:
    """Return the model with position controllers tau_j = -K_R,j theta_j added to its torques.

    Parameters
    ----------
    model : LinearModel
        Chains or a robot.
    gains : ndarray, (n,)
        K_R on the motor shafts; zero leaves a motor free [N m/rad, N/m].

    Raises
    ------
    InvalidInput
        If there is not one gain, finite and not negative, for each motor.
    """
    gains = _checked_gains(gains, model.selector.shape[1])
    S = model.selector
    return LinearModel(
        model.mass, model.damping, model.stiffness + (S * gains) @ S.T, S, model.measurement
    )


@renamed_keywords(since="0.2", held="controlled")
def chain_response(
    chains: CoupledChains, omega: Array, controlled: Sequence[int] = (), gain: float | None = None
) -> ComplexArray:
    """Return accelerations over torques of the motors, (F, M, M), direct and cross.

    Parameters
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    controlled : sequence of int
        Chains whose motors a position controller holds, 0 to M - 1.
    gain : float, N/m, optional
        K_R of these controllers; ten times the stiffest spring by default.

    Raises
    ------
    InvalidInput
        If there is no such chain, or a frequency or gain is not positive.
    """
    count = len(chains.masses)
    gains = np.zeros(count)
    for chain in controlled:
        if not 0 <= chain < count:
            raise InvalidInput(f"controlled: chain {chain}; there are chains 0 to {count - 1}")
        gains[chain] = 10 * chains.springs.max() if gain is None else gain
    model = position_controlled(chains.linear_model(), gains)
    return model.frequency_response(check_omega(omega))


def constrained_response(response: ComplexArray, omega: Array, gains: Array) -> ComplexArray:
    """Return the FRFs (F, M, M) of chains under position controllers from those of free chains.

    With theta = -G tau/omega^2 and tau = u - K_R theta: (1 - G K_R/omega^2)^-1 G, so nobody need
    close these loops to get what conditions (4) and (9) ask for.

    Parameters
    ----------
    response : ndarray of complex
        Accelerations over torques of the unconstrained chains.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    gains : ndarray, (M,), N/m
        K_R, zero where a chain stays free.

    Raises
    ------
    InvalidInput
        If shapes do not fit, or a gain is negative.
    """
    response, omega = np.asarray(response, dtype=complex), check_omega(omega)
    if response.shape != (len(omega), *response.shape[-1:] * 2):
        raise InvalidInput(f"response: shape {response.shape}; ({len(omega)}, M, M) is needed")
    gains = _checked_gains(gains, response.shape[-1])
    loop = np.eye(len(gains)) - response * gains / omega[:, None, None] ** 2
    return np.asarray(np.linalg.solve(loop, response))


def modally_damped(model: LinearModel, ratio: float) -> LinearModel:
    """Return the model with every flexible mode damped by `ratio`, rigid modes free.

    Raises
    ------
    InvalidInput
        If the ratio is negative, or the mass matrix not positive definite.
    """
    check_above_zero(ratio, "damping ratio", zero=True)
    flexible = resonances(model)
    image = model.mass @ flexible.shapes
    damping = (image * (2 * ratio * flexible.frequencies)) @ image.T
    return LinearModel(model.mass, damping, model.stiffness, model.selector, model.measurement)


def _checked_gains(gains: Array, count: int) -> Array:
    values = np.asarray(gains, dtype=float)
    if values.shape != (count,) or not (np.isfinite(values) & (values >= 0)).all():
        raise InvalidInput(
            f"gains: {values.tolist()}; {count} finite numbers >= 0, one per motor, are needed"
        )
    return values
