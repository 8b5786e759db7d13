"""Friction of motors and of joints: what robot files say of it, and what it is to linear models.

Coulomb friction is coulomb tanh(speed / width). To a Gaussian speed, such as that of a multisine
with many lines, the best linear substitute (Booton 1954) is a damper of
E[coulomb tanh(v / width) v] / E[v^2]; of sharp friction, coulomb sqrt(2 / pi) / (rms of v).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from robotmodels.common.arrays import Array, real_numbers
from robotmodels.common.errors import InvalidInput
from robotmodels.common.yaml_files import FileSection
from robotmodels.description.names import Name
from robotmodels.description.ranges import Friction

if TYPE_CHECKING:
    from robotmodels.description.robot_file import RobotFile

Width = Annotated[float, Field(ge=1e-6, le=1e6)]
"""Of tanh [rad/s or m/s]."""
Speed = Annotated[float, Field(ge=1e-9, le=1e6)]
"""Root mean square [rad/s or m/s]."""


class JointFriction(FileSection):
    """Friction of a joint behind its gear's spring.

    Coulomb friction is (coulomb + load |torque of gravity|) tanh(speed / coulomb_width). At the
    rms speed `coulomb_speed`, frequency responses count it as a damper.
    """

    name: Name
    joint: str
    viscous: Friction = 0.0
    coulomb: Friction = 0.0
    coulomb_width: Width = 1e-3
    coulomb_speed: Speed | None = None
    load: Annotated[float, Field(ge=0, le=1)] = 0.0

    @property
    def equivalent(self) -> float:
        """Damping that Coulomb friction counts as in frequency responses [N m s/rad]."""
        return equivalent_damping(self.coulomb, self.coulomb_width, self.coulomb_speed)

    @property
    def per_load(self) -> float:
        """What each N m of gravity's torque adds to that damping [s/rad]."""
        return equivalent_damping(self.load, self.coulomb_width, self.coulomb_speed)


_NORMAL = np.linspace(-8.0, 8.0, 8001)
_WEIGHTS = np.exp(-(_NORMAL**2) / 2) * (_NORMAL[1] - _NORMAL[0]) / np.sqrt(2 * np.pi)


def equivalent_damping(coulomb: float, width: float, speed: float | None) -> float:
    """Return the damper that Coulomb friction is to a Gaussian speed [N m s/rad].

    Parameters
    ----------
    coulomb : float, N m
        Coulomb friction.
    width : float, rad/s
        Of its tanh; zero where it is sharp.
    speed : float, rad/s, or None
        Root mean square of the speed; without it, friction is left to simulations.
    """
    if speed is None or coulomb == 0:
        return 0.0
    if width == 0:
        return float(coulomb * np.sqrt(2 / np.pi) / speed)
    share = np.tanh(speed * _NORMAL / width) * _NORMAL
    return float(coulomb * (_WEIGHTS @ share) / speed)


@dataclass(frozen=True)
class EquivalentDamper:
    """What Coulomb friction is beside viscous friction, of one motor or joint.

    Attributes
    ----------
    name : str
        Name of the motor or friction.
    viscous : float
        Viscous friction [N m s/rad].
    coulomb : float
        Coulomb friction [N m].
    speed : float or None
        Rms speed at which it counts as a damper [rad/s].
    equivalent : float
        That damper [N m s/rad].
    per_load : float
        What each N m of gravity's torque adds to it [s/rad].
    """

    name: str
    viscous: float
    coulomb: float
    speed: float | None
    equivalent: float
    per_load: float = 0.0

    @property
    def dominates(self) -> bool:
        """Whether Coulomb friction damps more than viscous friction does."""
        return self.equivalent > self.viscous


def friction_sentences(file: "RobotFile") -> list[str]:
    """Return what Coulomb friction is in frequency responses, in words."""
    dampers = equivalent_dampers(file)
    sentences = [
        f"Coulomb friction of {x.name}, {x.coulomb:.4g} N m, counts as {x.equivalent:.4g} N m "
        f"s/rad at {x.speed:.4g} rad/s rms"
        + (f" and {x.per_load:.4g} more for each N m of gravity's torque" if x.per_load else "")
        + f", beside {x.viscous:.4g} of viscous friction"
        + ("; it DOMINATES, so responses hold for this amplitude" if x.dominates else "")
        for x in dampers
        if x.speed is not None
    ]
    others = ", ".join(x.name for x in dampers if x.speed is None)
    if others and (sentences or file.friction):
        sentences.append(
            f"Coulomb friction of {others} is in simulations only (coulomb_speed: in responses too)"
        )
    return sentences


def equivalent_dampers(file: "RobotFile") -> tuple[EquivalentDamper, ...]:
    """Return the damper of each motor and joint with Coulomb friction, values on its own side."""
    return tuple(
        EquivalentDamper(
            item.name,
            item.viscous,
            item.coulomb,
            item.coulomb_speed,
            item.equivalent,
            getattr(item, "per_load", 0.0),
        )
        for item in file.frictional
        if item.coulomb or getattr(item, "load", 0.0)
    )


def shaft_friction(file: "RobotFile") -> Array:
    """Return the Coulomb friction that each motor overcomes, its joint's included, (n,) [N m]."""
    joints = {item.joint: item.coulomb for item in file.friction}
    return np.array([m.coulomb + joints.get(m.joint, 0.0) / abs(m.gear_ratio) for m in file.motors])


def at_speeds(file: "RobotFile", speeds: Sequence[float] | Array) -> "RobotFile":
    """Return the robot file whose Coulomb friction counts as damping at the motors' rms speeds.

    Parameters
    ----------
    file : RobotFile
        The robot file.
    speeds : array_like, (n,), rad/s
        Rms speeds on the motor shafts. A joint's is that of its motor over the gear ratio.

    Raises
    ------
    InvalidInput
        If there is not one speed above zero for each motor.
    """
    rms = real_numbers(speeds, "speeds [rad/s]")
    if rms.shape != (len(file.motors),) or not (rms > 0).all():
        raise InvalidInput(
            f"speeds: {rms.tolist()}; {len(file.motors)} positive numbers are needed, one per motor"
        )
    pairs = list(zip(file.motors, rms.tolist(), strict=True))
    motors = [motor.model_copy(update={"coulomb_speed": speed}) for motor, speed in pairs]
    joints = {motor.joint: speed / abs(motor.gear_ratio) for motor, speed in pairs}
    friction = [
        item.model_copy(update={"coulomb_speed": joints.get(item.joint, item.coulomb_speed)})
        for item in file.friction
    ]
    return file.model_copy(update={"motors": motors, "friction": friction})
