"""What is measured on a robot: its encoders, torque sensors and sensors on links, row by row.

outputs:                            # the rows of the FRFs, in this order
  - {motor: m1, quantity: angle}    # on the motor shaft; or velocity, acceleration, torque
  - {joint: shoulder, quantity: angle}     # behind the gear; or velocity, acceleration
  - {spring: d1, quantity: torque}  # what the spring and its damper exert on what is beyond
  - name: tip                       # by default made of the two words before
    link: forearm                   # a sensor on a link
    quantity: acceleration          # or angular_velocity; force or torque of the payload
    at: [0.0, 0.0, 0.3]             # where it sits, in the link's frame [m]
    direction: [1.0, 0.0, 0.0]      # along which, or about which, it measures
    gain: 1.0                       # reading over true value; below zero turns the sign
    delay: 0.0                      # of this reading [s]
    lag: 0.0                        # time constant of its first-order lag [s]
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import Field, model_validator

from robotmodels.common.yaml_files import FileSection
from robotmodels.description.names import Name
from robotmodels.description.ranges import LEAST_DIRECTION, Vector

if TYPE_CHECKING:
    from robotmodels.description.robot_file import RobotFile

Quantity = Literal["angle", "velocity", "acceleration", "angular_velocity", "torque", "force"]

ORDERS = {"angle": 0, "velocity": 1, "acceleration": 2}
"""Times by which an angle is differentiated."""

_QUANTITIES: dict[str, tuple[Quantity, ...]] = {
    "motor": ("angle", "velocity", "acceleration", "torque"),
    "joint": ("angle", "velocity", "acceleration"),
    "spring": ("torque",),
    "link": ("acceleration", "angular_velocity", "force", "torque"),
}
_UNITS = {
    "angle": "rad",
    "velocity": "rad/s",
    "acceleration": "rad/s^2",
    "angular_velocity": "rad/s",
    "torque": "N m",
    "force": "N",
}
_SLIDING = {"angle": "m", "velocity": "m/s", "acceleration": "m/s^2", "torque": "N"}

Time = Annotated[float, Field(ge=0, le=1e3)]
"""A delay or a time constant [s]."""


class Output(FileSection):
    """One reading: what it is of, and how far it is from the true value."""

    name: Name | None = None
    motor: str | None = None
    joint: str | None = None
    spring: str | None = None
    link: str | None = None
    quantity: Quantity
    at: Vector | None = None
    direction: Vector | None = None
    gain: Annotated[float, Field(ge=-1e9, le=1e9)] = 1.0
    delay: Time = 0.0
    lag: Time = 0.0

    @property
    def kind(self) -> str:
        """What it is of: "motor", "joint", "spring" or "link"."""
        return next(kind for kind in _QUANTITIES if getattr(self, kind) is not None)

    @property
    def of(self) -> str:
        """Name of the motor, joint, spring or link."""
        return str(getattr(self, self.kind))

    @property
    def label(self) -> str:
        """Its name, or the words that stand for it."""
        return self.name or f"{self.of} {self.quantity.replace('_', ' ')}"

    @property
    def who(self) -> str:
        """What errors call it."""
        accelerometer = self.link is not None and self.quantity == "acceleration"
        return f"{'accelerometer' if accelerometer else 'output'} {self.label!r}"

    @property
    def point(self) -> tuple[float, float, float]:
        """Where a sensor on a link sits, in the link's frame [m]."""
        return self.at or (0.0, 0.0, 0.0)

    @property
    def order(self) -> int:
        """Times by which an encoder's angle is differentiated; 0 of every other reading."""
        return ORDERS[self.quantity] if self.encoder else 0

    @property
    def encoder(self) -> bool:
        """Whether the angle of a motor or a joint is read, whatever is made of it."""
        return self.kind in ("motor", "joint") and self.quantity in ORDERS

    @property
    def ideal(self) -> bool:
        """Whether the true value is read, neither scaled nor late."""
        return (self.gain, self.delay, self.lag) == (1.0, 0.0, 0.0)

    def unit(self, sliding: bool = False) -> str:
        """Return the unit; `sliding` of a prismatic joint or its spring."""
        if self.kind == "link":
            return "m/s^2" if self.quantity == "acceleration" else _UNITS[self.quantity]
        return (_SLIDING if sliding and self.kind != "motor" else _UNITS)[self.quantity]

    @model_validator(mode="after")
    def _of_one_thing(self) -> Self:
        kinds = [kind for kind in _QUANTITIES if getattr(self, kind) is not None]
        if len(kinds) != 1:
            raise ValueError(f"give one of motor, joint, spring and link, not {len(kinds)}")
        who, kind = self.who, kinds[0]
        if self.quantity not in _QUANTITIES[kind]:
            raise ValueError(
                f"{who}: quantity {self.quantity!r} is not measured on a {kind}; "
                f"{', '.join(_QUANTITIES[kind])} can be"
            )
        if abs(self.gain) < 1e-9:
            raise ValueError(f"{who}: gain must not be zero, nor below 1e-9 in size")
        if kind != "link" and (self.at or self.direction):
            raise ValueError(f"{who}: 'at' and 'direction' belong to sensors on links")
        if kind == "link" and math.hypot(*(self.direction or ())) < LEAST_DIRECTION:
            raise ValueError(f"{who}: a direction other than zero is needed, in the link's frame")
        return self


def outputs_of(file: "RobotFile") -> tuple[Output, ...]:
    """Return what a robot file measures: `outputs`, or its motors and then its accelerometers."""
    if file.outputs:
        return tuple(file.outputs)
    quantity = "angle" if file.output == "position" else file.output
    motors = (Output(name=m.name, motor=m.name, quantity=quantity) for m in file.motors)
    sensors = (
        Output(name=s.name, link=s.link, quantity="acceleration", at=s.at, direction=s.direction)
        for s in file.accelerometers
    )
    return (*motors, *sensors)


def check_outputs(file: "RobotFile") -> None:
    """Refuse outputs of what the robot file does not have, or beside the older keys.

    Raises
    ------
    ValueError
        Naming the output.
    """
    if not file.outputs:
        return
    for key in ("output", "accelerometers"):
        if key in file.model_fields_set:
            raise ValueError(f"give either 'outputs' or {key!r}; outputs hold both")
    names: dict[str, Sequence[str]] = {
        "motor": [motor.name for motor in file.motors],
        "spring": [spring.name for spring in file.springs],
    }
    for output in file.outputs:
        who, kind = output.who, output.kind
        if kind in names and output.of not in names[kind]:
            raise ValueError(f"{who}: no {kind} {output.of!r}; there are {', '.join(names[kind])}")
        if kind == "link" and output.quantity in ("force", "torque"):
            carrier = file.payload.link if file.payload else None
            if carrier != output.link:
                raise ValueError(
                    f"{who}: a force or torque on a link is that of the payload, which is on "
                    f"{carrier or 'no link'}"
                )
