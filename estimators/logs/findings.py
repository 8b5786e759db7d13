"""What a log contradicts: values of the robot file, limits of its joints."""

import re
from collections.abc import Sequence

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.logs.log import Log

_INERTIA = re.compile(r"(^|[^a-z])(j_?m\w*|rotor_?inertia|motor_?inertia|inertia_?motor)$", re.I)
_RATIO = re.compile(r"(^|[^a-z])(u|ratio|gear_?ratios?|i_gear|uebersetzung)$", re.I)
_DIFFER = 0.05


def constant_findings(log: Log, robot: ElasticRobot | None) -> list[str]:
    """Return where constants beside the channels differ from the robot file's motors."""
    if robot is None:
        return []
    motors = robot.file.motors
    lines = []
    for name, values in log.constants.items():
        tail = name.rpartition(".")[2]
        if len(values) != len(motors) or np.iscomplexobj(values):
            continue
        if _INERTIA.search(tail):
            stated, what = [motor.inertia for motor in motors], "inertia"
        elif _RATIO.search(tail):
            stated, what = [abs(motor.gear_ratio) for motor in motors], "gear ratio"
        else:
            continue
        for motor, value, nominal in zip(motors, np.abs(values), stated, strict=True):
            if abs(value - nominal) > _DIFFER * nominal:
                lines.append(
                    f"{name}: {what} of {motor.name} is {value:.5g} in the log, {nominal:.5g} in "
                    "the robot file; one of them is wrong"
                )
    return lines


def pose_findings(angles: Array, limits: Array | None, joints: Sequence[str]) -> list[str]:
    """Return where angles leave the limits of their joints, as those from a start pose do.

    Parameters
    ----------
    angles : ndarray, (n, 2), rad
        Least and largest angle of each joint.
    limits : ndarray, (n, 2) or None, rad
        Of the joints.
    """
    if limits is None or len(limits) != len(angles):
        return []
    lines = []
    for name, (low, high), (least, most) in zip(joints, angles, limits, strict=True):
        if low < least or high > most:
            lines.append(
                f"{name}: angles from {low:.3g} to {high:.3g} rad leave the joint's limits, "
                f"{least:.3g} to {most:.3g}; they seem to count from a start pose: state start_pose"
            )
    return lines
