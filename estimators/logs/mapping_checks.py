"""Whether mapped signals fit each other: velocities, encoders behind the gears, signs, copies."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from estimators.logs.shift_regression import Relation, angle_relation, velocity_relation
from estimators.logs.torque_balance import torque_findings
from estimators.logs.torque_sign import torque_sign
from robotmodels.common.arrays import Array
from robotmodels.logs.importer import Import

_ROWS = 20_000
_FACTOR = 0.02  # from one, beyond which a unit, a side or a ratio is wrong
_LATE = 0.1  # of a sample time, from which a delay is told
_VELOCITIES = (("motor_velocity", "motor_angle"), ("link_velocity", "link_angle"))


def mapping_findings(source: Import) -> tuple[str, ...]:
    """Return what mapped signals say against their mapping, and how late they are, in words."""
    run = max(source.runs, key=len)
    low, high = run.first, min(run.stop, run.first + _ROWS)
    signals = {role: source.joint_values(role, low, high) for role in source.roles}
    times = source.clock.sample_times(low, high)
    lines: list[str] = []
    for role, angle in _VELOCITIES:
        if role in signals and angle in signals:
            lines += _related(source, role, angle, times, signals, integrate=True)
    if "link_angle" in signals and "motor_angle" in signals:
        lines += _related(source, "link_angle", "motor_angle", times, signals, integrate=False)
    if "motor_torque" in signals and "motor_angle" in signals:
        both = np.isfinite(signals["motor_torque"][0] + signals["motor_angle"][0])
        sign, reason = torque_sign(
            times, signals["motor_angle"][:, both], signals["motor_torque"][:, both]
        )
        if sign < 0:
            lines.append(f"motor_torque: its sign seems wrong: {reason}")
        if source.robot is not None and source.binding.joints == source.robot.motor_names:
            step = source.clock.sample_time
            both = (signals["motor_angle"], signals["motor_torque"])
            lines += torque_findings(source.robot, step, *both)
    return (*lines, *_accelerometers(source), *_copies(source))


def _related(
    source: Import,
    role: str,
    angle: str,
    times: Array,
    signals: dict[str, Array],
    *,
    integrate: bool,
) -> Iterator[str]:
    relate = velocity_relation if integrate else angle_relation
    for j, joint in enumerate(source.binding.joints):
        relation = relate(times, signals[angle][:, j], signals[role][:, j])
        if relation is not None and relation.determined:
            yield from _told(relation, f"{role} of {joint}", angle, source.clock.sample_time)


def _told(relation: Relation, name: str, angle: str, step: float) -> Iterator[str]:
    factor = 1 / relation.factor
    if abs(factor - 1) > _FACTOR:
        yield (
            f"{name} is {factor:.4g} times what {angle} says; a unit, a side of the gear, a ratio "
            "or a sign is wrong"
        )
    if abs(relation.lag) > max(_LATE * step, 3 * relation.lag_std):
        yield (
            f"{name} is late against {angle} by {1e3 * relation.lag:.2f} +- "
            f"{1e3 * relation.lag_std:.2g} ms"
        )


def _accelerometers(source: Import) -> Iterator[str]:
    """Yield where accelerometers sit by the robot file, or that nobody tells."""
    file = None if source.robot is None else source.robot.file
    sensors = {} if file is None else {sensor.name: sensor for sensor in file.accelerometers}
    for name, signal in source.others.items():
        if signal.role == "accelerometer" and name in sensors:
            sensor = sensors[name]
            position = ", ".join(f"{x:g}" for x in sensor.at)
            axis = ", ".join(f"{x:g}" for x in sensor.direction)
            yield f"accelerometer {name}: on {sensor.link} at ({position}) m along ({axis})"
        elif signal.role == "accelerometer":
            yield (
                f"accelerometer {name}: not in the robot file, which would say its place and axis; "
                "it is kept as a signal"
            )


def _copies(source: Import) -> Iterator[str]:
    """Yield a warning for each two channels with the same numbers, such as simulated ones."""
    for one, other in combinations(source.present, 2):
        if one.table.rows != other.table.rows or one.channel == other.channel:
            continue
        first, second = (signal.table.values(signal.channel, 1000) for signal in (one, other))
        if np.ptp(first) > 0 and np.array_equal(first, second):
            yield (
                f"{other.channel} ({other.role}) repeats {one.channel} ({one.role}) number by "
                "number; it is a copy, or not measured"
            )
