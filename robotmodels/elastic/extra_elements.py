"""Parameters beyond springs and dampers: inertias, payload, spring locations, gains, delay.

Each is a positive number that scales one entry of the robot file; an entry below zero, such as
a coordinate of a centre of mass, keeps its sign.
"""

import math
from typing import Any

import numpy as np

from robotmodels.description.counterbalances import Counterbalance
from robotmodels.description.outputs import Output
from robotmodels.description.robot_file import Body, RobotFile

_OF_MOTORS = {
    "inertia": "kg m^2",
    "viscous": "N m s/rad",
    "torque_gain": "-",
    "torque_delay": "s",
    "torque_lag": "s",
}
_OF_OUTPUTS = {"gain": "-", "delay": "s", "lag": "s"}
_COM = ("x", "y", "z")
_BALANCED = (
    ("sinusoid", "amplitude", "N m"),
    ("spring", "stiffness", "N/m"),
    ("spring", "preload", "N"),
    ("gas", "force", "N"),
)
_INERTIA = ("xx", "xy", "xz", "yy", "yz", "zz")


def extra_elements(file: RobotFile) -> dict[str, tuple[float, str]]:
    """Return magnitude and unit of everything that ``parameters.extra`` may name."""
    table: dict[str, tuple[float, str]] = {}
    table |= {
        f"{motor.name}.{name}": (getattr(motor, name), unit)
        for motor in file.motors
        for name, unit in _OF_MOTORS.items()
    }
    for spring in file.springs:
        if spring.at is not None:
            table[f"{spring.name}.at"] = (float(np.linalg.norm(spring.at)), "m")
    for item in file.friction:
        table[f"{item.name}.viscous"] = (item.viscous, "N m s/rad")
    for balance in file.counterbalances:
        for law, entry, unit in _BALANCED:
            if (section := getattr(balance, law)) is not None:
                table[f"{balance.name}.{entry}"] = (abs(getattr(section, entry)), unit)
    if file.payload is not None:
        table["payload.mass"] = (file.payload.mass, "kg")
        for axis, value in zip(_COM, file.payload.com, strict=True):
            table[f"payload.com.{axis}"] = (abs(value), "m")
        for axes, value in zip(_INERTIA, file.payload.inertia, strict=True):
            table[f"payload.inertia.{axes}"] = (abs(value), "kg m^2")
    table |= {
        f"{output.label}.{name}": (abs(getattr(output, name)), unit)
        for output in file.outputs
        for name, unit in _OF_OUTPUTS.items()
    }
    table["delay"] = (file.delay, "s")
    return table


def apply_extra(file: RobotFile, values: dict[str, float]) -> RobotFile:
    """Return `file` with the named extras at other magnitudes."""
    changes: dict[str, Any] = {}
    if "delay" in values:
        changes["delay"] = values["delay"]
    changes["motors"] = [motor.model_copy(update=_of(values, motor.name)) for motor in file.motors]
    changes["outputs"] = [_output(output, _of(values, output.label)) for output in file.outputs]
    # A cut moves as a whole, whichever of its springs is named.
    moved = {
        (s.link, s.at): values[f"{s.name}.at"] for s in file.springs if f"{s.name}.at" in values
    }
    changes["springs"] = [
        spring.model_copy(update={"at": _at_distance(spring.at, moved[spring.link, spring.at])})
        if spring.at is not None and (spring.link, spring.at) in moved
        else spring
        for spring in file.springs
    ]
    changes["friction"] = [f.model_copy(update=_of(values, f.name)) for f in file.friction]
    changes["counterbalances"] = [_balanced(each, values) for each in file.counterbalances]
    if file.payload is not None:
        changes["payload"] = file.payload.model_copy(update=_body(file.payload, values))
    return file.model_copy(update=changes)


def _balanced(balance: Counterbalance, values: dict[str, float]) -> Counterbalance:
    sections: dict[str, Any] = {}
    for law, entry, _ in _BALANCED:
        name, section = f"{balance.name}.{entry}", getattr(balance, law)
        if section is not None and name in values:
            old = sections.get(law, section)
            change = {entry: float(np.copysign(values[name], getattr(section, entry)))}
            sections[law] = old.model_copy(update=change)
    return balance.model_copy(update=sections)


def _of(values: dict[str, float], owner: str) -> dict[str, float]:
    prefix = f"{owner}."
    return {n.removeprefix(prefix): v for n, v in values.items() if n.startswith(prefix)}


def _output(output: Output, values: dict[str, float]) -> Output:
    if "gain" in values:
        values["gain"] = math.copysign(values["gain"], output.gain)
    return output.model_copy(update=values)


def _at_distance(at: tuple[float, ...], distance: float) -> tuple[float, ...]:
    return tuple(float(x) for x in np.array(at) * distance / np.linalg.norm(at))


def _body(body: Body, values: dict[str, float]) -> dict[str, object]:
    def signed(name: str, labels: tuple[str, ...], old: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(
            float(np.copysign(values.get(f"payload.{name}.{label}", abs(x)), x))
            for label, x in zip(labels, old, strict=True)
        )

    return {
        "mass": values.get("payload.mass", body.mass),
        "com": signed("com", _COM, body.com),
        "inertia": signed("inertia", _INERTIA, body.inertia),
    }
