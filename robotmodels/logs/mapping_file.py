"""The schema of a mapping file: which channel of a log is which signal, in which unit.

    schema: import/1
    robot: robot.yaml            # or a built-in name; needed for what depends on joints
    joints: [a1, a2, a3]         # that the log has, by names of motors or joints; all by default
    ratios: [257, 267, 252]      # signed motor turns per turn of the joint; by default the robot's
    couplings:                   # of wrists: motor over ratio is the joint's angle and a share of
      a6: {a5: 1.0}              # others', as of a5 in motor a6
    torque_constants: [1.8, 1.9, 1.9]    # [N m/A], make motor torques of currents
    start_pose: [0.0, -1.57, 1.57]       # added to all angles of joints [rad or m]
    time:                        # of all tables; names such as t or time are looked for by default
      column: t                  # with stamps, numbers or ISO
      unit: ms                   # of the stamps, also such as 100 ns; s by default
      counter: cycle             # counts samples; takes the place of stamps that jitter
      sample_time: 0.004         # [s], where there are no stamps, or of one count
    tables:                      # other times, by the name of a table
      block_2: {sample_time: 0.001}
    period: 2.0                  # of the excitation [s], 0 for none; looked for by default
    transient: 1                 # periods at the beginning of a run that are dropped
    signals:                     # a list
      column: q_*                # channel, list of them, or pattern such as q_{0..5}, of joints in
                                 # their order
      role: motor_angle          # or motor_velocity, motor_acceleration, motor_torque,
                                 # motor_current, link_angle, link_velocity, joint_torque,
                                 # reference_angle, reference_velocity, reference_torque,
                                 # accelerometer, other
      joint: a2                  # or joints, a list; by default those of the log
      unit: deg                  # as pint or people write units, such as 0.229 rpm, or counts or
                                 # %, ‰, 0.1 %; the file's by default
      side: motor                # of the gear, motor or joint
      sign: -1                   # or one for each joint
      counts_per_turn: 4096      # of a unit of counts
      full_scale: 50.0           # what 100 % are [SI]
      delay: 0.003               # by which it is late, taken out [s]
      wrapped: true              # jumps by whole turns are taken out, by default where a counter
                                 # begins anew
      name: s1                   # of an accelerometer in the robot file, or of another signal

`signals` is a list; of one entry, what its keys mean. What is left out must follow from log and
robot.
"""

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from robotmodels.common.yaml_files import FileSection, read_yaml
from robotmodels.data_files.file_guard import PathLike
from robotmodels.description.ranges import GearRatio, Positive, Seconds

Role = Literal[
    "motor_angle",
    "motor_velocity",
    "motor_acceleration",
    "motor_torque",
    "motor_current",
    "link_angle",
    "link_velocity",
    "joint_torque",
    "reference_angle",
    "reference_velocity",
    "reference_torque",
    "accelerometer",
    "other",
]
Side = Literal["motor", "joint"]
Sign = Annotated[int, Field(ge=-1, le=1)]
Delay = Annotated[float, Field(ge=-10, le=10)]


class TimeChoice(FileSection):
    """Where the time of a table's rows comes from."""

    column: str = ""
    unit: str = ""
    counter: str = ""
    sample_time: Seconds | None = None


class Signal(FileSection):
    """Channels of one role."""

    column: str | tuple[str, ...]
    role: Role
    joint: str = ""
    joints: tuple[str, ...] = ()
    unit: str = ""
    side: Side | None = None
    sign: Sign | tuple[Sign, ...] = 1
    counts_per_turn: Positive | None = None
    full_scale: Positive | None = None
    delay: Delay = 0.0
    wrapped: bool | None = None
    name: str = ""

    @model_validator(mode="after")
    def _entries_fit(self) -> Self:
        if self.joint and self.joints:
            raise ValueError("joint and joints: one of them is needed")
        signs = (self.sign,) if isinstance(self.sign, int) else self.sign
        if 0 in signs:
            raise ValueError("sign: 0; 1 or -1 is needed")
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Joints that it names, none where it leaves them open."""
        return (self.joint,) if self.joint else self.joints

    @property
    def patterns(self) -> tuple[str, ...]:
        """Its channels, or patterns of them."""
        return (self.column,) if isinstance(self.column, str) else self.column


class Mapping(FileSection):
    """What the channels of a log mean."""

    schema_: Literal["import/1"] = Field(alias="schema")
    robot: str = ""
    joints: tuple[str, ...] = ()
    ratios: tuple[GearRatio, ...] = ()
    couplings: dict[str, dict[str, GearRatio]] = {}
    torque_constants: tuple[GearRatio, ...] = ()
    start_pose: tuple[float, ...] = ()
    time: TimeChoice = TimeChoice()
    tables: dict[str, TimeChoice] = {}
    period: Annotated[float, Field(ge=0, le=1e6)] | None = None
    transient: Annotated[int, Field(ge=0, le=10_000)] | None = None
    signals: Annotated[tuple[Signal, ...], Field(min_length=1, max_length=1000)]


def read_mapping(path: PathLike) -> Mapping:
    """Read a mapping file.

    Raises
    ------
    InvalidInput
        Naming the file, the line and the key at fault.
    """
    return read_yaml(Path(path), Mapping)
