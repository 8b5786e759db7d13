"""The schema of a robot file: URDF, motors, springs, payload, choice of parameters.

    schema: robot/1
    name: my robot               # what people read
    source: data sheet of 2019   # where the numbers come from
    urdf: my_robot.urdf          # or a .xacro or an MJCF (.xml); relative to this file, or
                                 # example-robot-data:... in that package
    model: my_robot.xml          # the same as urdf, in place of it
    xacro:                       # of a .xacro
      arguments: {prefix: left_} # of its macros
      packages: [../ros/src]     # folders in which the packages of $(find NAME) lie
    gravity: [0.0, 0.0, -9.81]   # acceleration in the frame of the URDF's root [m/s^2]
    lock: {finger: 0.0}          # joints held rigid, at an angle [rad; m]
    motors:                      # in the order of the FRFs' rows and columns; values on the shaft
      name: m1                   # of the motor, used in parameters such as m1.inertia
      joint: shoulder            # that it drives
      gear_ratio: -101           # motor turns per turn of the joint, of either sign
      inertia: 3.9e-4            # of the rotor and what turns with it [kg m^2]
      viscous: 2.0e-3            # friction [N m s/rad]
      coulomb: 0.05              # friction, in simulations in closed loop [N m]
      coulomb_width: 0.0         # sharp, or the width of tanh(speed / width) [rad/s]
      coulomb_speed: 5.0         # rms speed at which FRFs count it as a damper [rad/s]; else not
      torque_gain: 1.0           # torque over commanded torque
      torque_delay: 0.0          # of the torque after the command [s]
      torque_lag: 0.0            # time constant of its first-order lag [s]
    springs:                     # spring-damper pairs, values on the arm side
      name: d1                   # of the spring, used in parameters such as d1.stiffness
      joint: shoulder            # whose gear or bearing it is; or link
      link: forearm              # that it cuts, the root link for an elastic foundation
      at: [0.0, 0.0, 0.3]        # where the cut is, in the link's frame [m]
      axis: drive                # drive for a gear; x, y or z for bearings and links
      stiffness: 4.0e4           # [N m/rad], or {low, high, torque} of a gear that hardens:
                                 # its slope at rest, and its slope where it holds that torque
      damping: 60.0              # [N m s/rad]
      distal:                    # the part of the link beyond the cut
        mass: 3.0                # [kg]
        com: [0.0, 0.0, 0.4]     # centre of mass, in the link's frame [m]
    counterbalances:             # torques on joints over their angles, link side
      name: b1                   # used in parameters such as b1.amplitude
      joint: shoulder            # whose angle counts
      sinusoid:                  # amplitude sin(angle + phase); or spring, gas or table
        amplitude: 7000.0        # [N m]
        phase: -1.48             # [rad]
    friction:                    # of joints, behind the springs of their gears
      name: f1                   # used in parameters such as f1.viscous
      joint: shoulder            # that it brakes
      viscous: 20.0              # [N m s/rad]
      coulomb: 50.0              # [N m]
      coulomb_width: 0.001       # of tanh(speed / width) [rad/s]
      coulomb_speed: 0.05        # as of a motor [rad/s]
      load: 0.02                 # Coulomb friction per torque of gravity
    parameters:                  # by default every stiffness, then every damping is estimated
      fixed: [d1.damping]        # known, not estimated
      tied: [[d1.stiffness, d2.stiffness]]    # each group keeps its ratios
      extra: [m1.inertia, payload.mass]       # estimated too
    payload:                     # a rigid body on a link
      link: tool0                # that carries it
      mass: 10.0                 # [kg]
      com: [0.0, 0.0, 0.1]       # centre of mass, in the link's frame [m]
    outputs:                     # what is measured, the rows of the FRFs; by default the motors'
                                 # accelerations, from angles. See `robotmodels.description.outputs`
      motor: m1                  # whose encoder, or torque by its current; or one of these:
      joint: shoulder            # whose encoder is behind the gear
      spring: d1                 # whose torque is measured
      link: forearm              # that a sensor sits on
      quantity: acceleration     # angle, velocity, acceleration, angular_velocity, torque, force
      name: s1                   # of the reading, used in parameters such as s1.gain
      at: [0.0, 0.0, 0.3]        # of a sensor on a link, in the link's frame [m]
      direction: [1.0, 0.0, 0.0] # along which it measures, in the link's frame
      gain: 1.0                  # reading over true value
      delay: 0.0                 # of this reading [s]
      lag: 0.0                   # time constant of its first-order lag [s]
    output: acceleration         # of the motors, or velocity or position; without outputs
    accelerometers:              # further rows then; outputs hold them too
      name: s1                   # of the sensor
      link: forearm              # that it sits on
      at: [0.0, 0.0, 0.3]        # in the link's frame [m]
      direction: [1.0, 0.0, 0.0] # along which it measures, in the link's frame
    delay: 0.0                   # of all that is measured [s]
    guessed: {d1.damping: 1.0}   # standard deviations of the logarithms of guesses: a prior
    fitted:                      # of identified values, written by `oed export`
      relative_std: {d1.stiffness: 0.01}      # standard deviations of their logarithms
      verdict: trustworthy       # on the fit, see `estimators.VERDICTS`
      provenance: {residual: nls}             # data, settings and programs behind them, in words

`motors`, `springs`, `counterbalances`, `friction` and `outputs` are lists; of one entry each,
what its keys mean. The older keys `output` (acceleration, velocity or position of the motors) and
`accelerometers` are read as well.
"""

import math
from collections import Counter
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AliasChoices,
    BeforeValidator,
    ConfigDict,
    Field,
    model_validator,
)

from robotmodels.common.arrays import Array
from robotmodels.common.symmetric_matrices import symmetric_matrix
from robotmodels.common.yaml_files import FileSection, read_yaml
from robotmodels.description.counterbalances import Counterbalance
from robotmodels.description.friction import JointFriction, Speed, equivalent_damping
from robotmodels.description.names import Name
from robotmodels.description.outputs import Output, Time, check_outputs
from robotmodels.description.ranges import (
    LEAST_DIRECTION,
    Damping,
    Friction,
    GearRatio,
    JointLimit,
    Mass,
    Moment,
    RotorInertia,
    Stiffness,
    Vector,
)


def _six_inertias(value: object) -> object:
    """Expand three diagonal entries to xx, xy, xz, yy, yz, zz."""
    if isinstance(value, list | tuple) and len(value) == 3:
        xx, yy, zz = value
        return (xx, 0.0, 0.0, yy, 0.0, zz)
    if isinstance(value, list | tuple) and len(value) != 6:
        raise ValueError(f"3 or 6 numbers are needed (xx, yy, zz, or all six), found {len(value)}")
    return tuple(value) if isinstance(value, list) else value


Inertia = Annotated[
    tuple[Moment, Moment, Moment, Moment, Moment, Moment],
    BeforeValidator(
        _six_inertias,
        json_schema_input_type=tuple[Moment, Moment, Moment]
        | tuple[Moment, Moment, Moment, Moment, Moment, Moment],
    ),
    Field(description="xx, yy, zz, or xx, xy, xz, yy, yz, zz [kg m^2]"),
]


class Motor(FileSection):
    """A motor; its values are on the motor shaft."""

    name: Name
    joint: str
    gear_ratio: GearRatio
    inertia: RotorInertia
    viscous: Friction = 0.0
    coulomb: Friction = 0.0
    coulomb_width: Friction = 0.0
    coulomb_speed: Speed | None = None
    torque_gain: Annotated[float, Field(ge=1e-6, le=1e6)] = 1.0
    torque_delay: Time = 0.0
    torque_lag: Time = 0.0

    @model_validator(mode="after")
    def _ratio_is_not_zero(self) -> Self:
        if abs(self.gear_ratio) < 1e-6:
            raise ValueError(
                f"motor {self.name!r}: gear_ratio must not be zero, nor below 1e-6 in size"
            )
        return self

    @property
    def equivalent(self) -> float:
        """Damping that Coulomb friction counts as in frequency responses, on the shaft."""
        return equivalent_damping(self.coulomb, self.coulomb_width, self.coulomb_speed)


class Hardening(FileSection):
    """A cubic spring: slope `low` at rest, `high` where its torque is `torque`."""

    low: Stiffness
    high: Stiffness
    torque: Annotated[float, Field(ge=1e-9, le=1e12)]


class Body(FileSection):
    """Mass [kg], centre of mass [m] in the link frame, inertia about it [kg m^2]."""

    mass: Mass
    com: Vector
    inertia: Inertia

    @property
    def inertia_matrix(self) -> Array:
        """The inertia, (3, 3) [kg m^2]."""
        return symmetric_matrix(self.inertia)


class Spring(FileSection):
    """A spring-damper pair on the arm side, at a joint or at a cut through a link."""

    name: Name
    joint: str | None = None
    link: str | None = None
    at: Vector | None = None
    axis: Literal["drive", "x", "y", "z"]
    stiffness: Stiffness | Hardening
    damping: Damping
    distal: Body | None = None

    @model_validator(mode="after")
    def _joint_or_link(self) -> Self:
        who = f"spring {self.name!r}"
        if (self.joint is None) == (self.link is None):
            raise ValueError(f"{who}: give either joint or link")
        if self.joint is not None and self.at is not None:
            raise ValueError(f"{who}: 'at' belongs to a cut through a link, not to a joint")
        if self.joint is not None and self.distal is not None:
            raise ValueError(f"{who}: 'distal' belongs to a cut through a link, not to a joint")
        if self.link is not None and self.at is None:
            raise ValueError(f"{who}: a cut through link {self.link!r} needs 'at', a point [m]")
        if self.link is not None and self.axis == "drive":
            raise ValueError(f"{who}: a cut has axes x, y, z; 'drive' belongs to a joint")
        if self.axis != "drive" and isinstance(self.stiffness, Hardening):
            raise ValueError(f"{who}: only a drive spring can be nonlinear")
        return self


class Choice(FileSection):
    """Which parameters are free; default: every stiffness, then every damping."""

    fixed: list[str] = []
    tied: list[Annotated[list[str], Field(min_length=2)]] = []
    extra: list[str] = []


class Payload(Body):
    """A rigid body fastened to a link."""

    link: str


class Accelerometer(FileSection):
    """A sensor on a link: where it sits and along which axis it measures, in the link frame.

    Like a payload, it moves with the part beyond the last cut through its link.
    """

    name: Name
    link: str
    at: Vector
    direction: Vector

    @model_validator(mode="after")
    def _direction_is_not_zero(self) -> Self:
        if math.hypot(*self.direction) < LEAST_DIRECTION:
            raise ValueError(f"accelerometer {self.name!r}: direction must not be zero")
        return self


class Fitted(FileSection):
    """How certain the values of a fit are and where they come from.

    `relative_std` holds standard deviations of ln theta of parameters whose interval can be quoted,
    `correlation` in each row a parameter's correlations with those before it.
    """

    relative_std: dict[str, Annotated[float, Field(gt=0)]] = {}
    correlation: list[list[Annotated[float, Field(gt=-1, lt=1)]]] = []
    verdict: str = ""
    provenance: dict[str, str] = {}

    @model_validator(mode="after")
    def _rows_below_the_diagonal(self) -> Self:
        lengths, p = [len(row) for row in self.correlation], len(self.relative_std)
        if lengths and lengths != list(range(p)):
            raise ValueError(
                f"fitted.correlation: rows of lengths {lengths[:8]}; {p} rows with 0 to {p - 1} "
                "numbers are needed, one for each entry of relative_std"
            )
        return self


class Xacro(FileSection):
    """How the macros of a xacro file are expanded."""

    arguments: dict[str, str | bool | int | float] = {}
    packages: list[str] = []

    @property
    def argument_words(self) -> tuple[tuple[str, str], ...]:
        """Names and values of the arguments, as xacro takes them."""
        words = {
            k: str(v).lower() if isinstance(v, bool) else str(v) for k, v in self.arguments.items()
        }
        return tuple(words.items())


def _urdf_or_model(schema: dict[str, Any]) -> None:
    """Let a JSON Schema have either key for the model file."""
    schema["properties"]["model"] = schema["properties"]["urdf"]
    schema["required"].remove("urdf")
    schema["oneOf"] = [{"required": ["urdf"]}, {"required": ["model"]}]


class RobotFile(FileSection):
    """A robot file, ``schema: robot/1``."""

    model_config = ConfigDict(json_schema_extra=_urdf_or_model)

    schema_: Literal["robot/1"] = Field(alias="schema")
    name: str
    source: str = ""
    urdf: str = Field(validation_alias=AliasChoices("urdf", "model"))
    xacro: Xacro | None = None
    gravity: Vector = (0.0, 0.0, -9.81)
    lock: dict[str, JointLimit] = {}
    motors: list[Motor] = Field(min_length=1, max_length=64)
    springs: list[Spring] = Field(min_length=1, max_length=256)
    counterbalances: list[Counterbalance] = Field([], max_length=64)
    friction: list[JointFriction] = Field([], max_length=64)
    parameters: Choice = Choice()
    payload: Payload | None = None
    outputs: list[Output] = Field([], max_length=512)
    output: Literal["acceleration", "velocity", "position"] = "acceleration"
    accelerometers: list[Accelerometer] = Field([], max_length=256)
    delay: float = Field(0.0, ge=0, le=1e3)
    guessed: dict[str, Annotated[float, Field(ge=1e-6, le=10)]] = {}
    fitted: Fitted | None = None

    @property
    def frictional(self) -> tuple[Motor | JointFriction, ...]:
        """Everything that has friction: motors, on their shafts, then joints."""
        return (*self.motors, *self.friction)

    @model_validator(mode="after")
    def _names_are_unique(self) -> Self:
        groups = (
            self.motors,
            self.springs,
            self.counterbalances,
            self.friction,
            self.accelerometers,
        )
        names = Counter(item.name for group in groups for item in group)
        names.update(output.label for output in self.outputs)
        for name, count in names.items():
            if count > 1:
                raise ValueError(f"the name {name!r} is used {count} times; names are unique")
        for joint, count in Counter(m.joint for m in self.motors).items():
            if count > 1:
                raise ValueError(f"joint {joint!r} has {count} motors; one at most")
        for joint, count in Counter(item.joint for item in self.friction).items():
            if count > 1:
                raise ValueError(f"joint {joint!r} has {count} entries of friction; one at most")
        for (owner, axis), count in Counter((_owner(s), s.axis) for s in self.springs).items():
            if count > 1:
                raise ValueError(f"{owner} has {count} springs about axis {axis!r}; one at most")
        check_outputs(self)
        return self


def _owner(spring: Spring) -> str:
    return f"joint {spring.joint!r}" if spring.joint else f"link {spring.link!r} at {spring.at}"


def read_robot_file(path: Path) -> RobotFile:
    """Read a robot file.

    Raises
    ------
    InvalidInput
        Naming the file and the key at fault.
    """
    return read_yaml(path, RobotFile)
