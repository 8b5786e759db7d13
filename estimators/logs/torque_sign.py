"""The sign of torques: motors of a robot that moves do work against friction, on the whole."""

import numpy as np

from robotmodels.common.arrays import Array

_MOVING = 0.05  # of the largest speed
_PARTS = 10


def torque_sign(stamps: Array, angle: Array, torque: Array) -> tuple[int, str]:
    """Return the sign of torques, or currents, and what it rests on.

    Parameters
    ----------
    stamps : ndarray, (N,), s
        Times.
    angle, torque : ndarray, (N, n)
        Of all joints: single ones fail on coupled arms.
    """
    if angle.shape != torque.shape or len(stamps) < 4 * _PARTS:
        return 1, "sign not determined: other joints or another clock than the angles"
    velocity = np.gradient(angle, stamps, axis=0)
    fastest = np.nanmax(np.abs(velocity), axis=0)
    moving = np.abs(velocity) > _MOVING * np.where(fastest > 0, fastest, np.inf)
    if not moving.any():
        return 1, "sign not determined: nothing moves"
    power = np.where(moving, velocity * torque, 0.0)
    total = np.nansum(power, axis=1)
    parts = np.array([part.mean() for part in np.array_split(total, _PARTS)])
    mean, error = parts.mean(), parts.std(ddof=1) / np.sqrt(_PARTS)
    sign = 1 if mean >= 0 else -1
    share = abs(mean) / error if error > 0 else np.inf
    clear = share > 2
    told = f"sign {'+' if sign > 0 else '-'}" if clear else "sign open, taken as +"
    reason = f"{told}: over moving samples, torque times velocity is {min(share, 99):.1f} standard"
    return (sign if clear else 1), f"{reason} errors {'above' if sign > 0 else 'below'} zero"
