"""How much of the springs' part of another record's deflections a fit explains."""

import numpy as np

from estimators.deflection.assumptions import DeflectionAssumptions
from estimators.deflection.axis_deflection import RecordEstimate
from estimators.deflection.joint_movement import JointMovement, SmoothMovement
from estimators.deflection.load_balance import gear_torque, moving

_ROUNDS = 4


def explained_share(
    here: RecordEstimate, at: DeflectionAssumptions, movement: JointMovement, centred: bool
) -> tuple[float, ...]:
    """Return the share for each gear of the fit; offset, delay and hysteresis are fitted anew."""
    smooth = movement.low_passed(at.low_pass)
    return tuple(_share(here, at, smooth, i, centred) for i in range(len(here.axes)))


def _share(
    here: RecordEstimate, at: DeflectionAssumptions, smooth: SmoothMovement, i: int, centred: bool
) -> float:
    axis = here.axes[i]
    j, delays = axis.motor, np.zeros(len(smooth.measured.on_both_sides))
    for _ in range(_ROUNDS):
        angle, speed, _ = (part[:, j] for part in smooth.links(delays))
        bent = angle - smooth.motor(smooth.measured.time)[:, j]
        torque = gear_torque(smooth.torques(delays), at, here.payload)[:, j]
        if smooth.measured.senses_torque[j]:
            torque = smooth.gear_torque[:, j]
        used, predicted = moving(smooth, speed, at), -axis.compliance * torque
        columns = [np.ones_like(angle), -np.sign(speed), -speed]
        X = np.stack(columns if at.delays else columns[:2], axis=1)[used]
        nuisance = np.linalg.lstsq(X, (bent - predicted)[used], rcond=None)[0]
        delays[j] += nuisance[2] if at.delays else 0.0
    spring_part = bent[used] - X @ nuisance
    remainder = spring_part - predicted[used]
    if centred:
        remainder, spring_part = remainder - remainder.mean(), spring_part - spring_part.mean()
    return float(1 - remainder @ remainder / (spring_part @ spring_part))
