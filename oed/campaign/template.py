"""A campaign file to start from."""

import os
from pathlib import Path

from robotmodels import ElasticRobot, load_robot
from robotmodels.common.atomic_files import write_text
from robotmodels.common.errors import InvalidInput
from robotmodels.description.joint_drives import joint_drives
from robotmodels.description.urdf_check import checked_urdf

_TEXT = """\
schema: campaign/1
robot: {robot}
guesses_within: {within}     # factor that values may be off by; robot: as the file states
targets:                # relative standard deviations, by kind, name or pattern
  stiffness: 0.01
  damping: 0.05
minutes: 60             # robot time at most, moves included

candidates: {{sobol: 512}}   # positions to choose from; obstacles and floor as in a study
multisine:
  band: [1.0, 60.0]     # [Hz]
  sample_time: 0.002    # of the controller [s]
  period: 4.0           # [s]
  detection: 5          # of five lines one stays empty and shows noise and distortion

# Peaks on the motor shafts: replace them by what this robot may do, one number per motor.
limits:
{limits}
  # rms_torque: 1.0     # root mean square, gravity included [N m]: continuous torque of the motor
  swing: 0.02           # deviation from a position, arm side [rad; m]
  margin: 0.1
moves: {{speed: 0.5, acceleration: 1.0}}    # between positions, arm side [rad/s, rad/s^2]
settle: 1.0             # rest after each move [s]
# carrier: {{speed: 10.0}}    # slow sines of all motors against friction [rad/s]
files: [csv]            # for the controller; also mat, trajectory (a bag of ROS 2)

seed: 1
output: {output}
"""

_SPEED_SHARE = 0.3
"""Part of the velocity that the URDF allows."""


def write_template(robot: str, path: Path) -> None:
    """Write a commented campaign file for a built-in robot or a robot file.

    Raises
    ------
    InvalidInput
        If the file exists, or there is no such robot.
    """
    if path.exists():
        raise InvalidInput(f"{path}: the file is there already; nothing is overwritten")
    model = load_robot(robot)
    is_file = Path(robot).suffix in (".yaml", ".yml")
    text = _TEXT.format(
        robot=os.path.relpath(robot, path.parent) if is_file else robot,
        within="robot" if model.file.guessed or model.file.fitted else "2.0",
        limits=_limits(model),
        output=f"{path.stem}_{model.name}",
    )
    write_text(path, text)


def _limits(robot: ElasticRobot) -> str:
    """Return the lines of torque and speed, by the URDF's limits of efforts and velocities."""
    motors, drives = robot.file.motors, joint_drives(checked_urdf(robot.model_file))
    pairs = [(drives[motor.joint], abs(motor.gear_ratio)) for motor in motors]
    torque = [None if d.effort is None else d.effort / ratio for d, ratio in pairs]
    speed = [None if d.velocity is None else _SPEED_SHARE * d.velocity * r for d, r in pairs]
    lines = []
    for key, values, words in (
        ("torque", torque, "gravity included [N m]; by the URDF's efforts"),
        ("speed", speed, f"[rad/s]; {_SPEED_SHARE:.0%} of the URDF's velocities"),
    ):
        numbers = [1.0 if value is None else float(f"{value:.3g}") for value in values]
        off = "# " if None in values else ""
        lines.append(f"  {off}{key}: {numbers}    # {words}")
    return "\n".join(lines)
