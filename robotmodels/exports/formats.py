"""The formats of `robotmodels.export`: how their files end, and what they cannot hold."""

from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from robotmodels.description.robot_file import RobotFile

Format = Literal["mjcf", "urdf", "state_space", "modes", "robot"]
ENDINGS: dict[Format, str] = {
    "mjcf": ".xml",
    "urdf": ".urdf",
    "state_space": ".mat",
    "modes": ".modes.json",
    "robot": ".yaml",
}


def left_out(file: "RobotFile", format: Format) -> tuple[str, ...]:
    """Return what of a robot file a format cannot hold, one line each."""
    delay = (f"delay of {file.delay:g} s of all that is measured",) if file.delay else ()
    noted = tuple(f"{line}: noted in <custom>, not simulated" for line in delay)
    friction = tuple(f"Coulomb friction of motor {m.name}" for m in file.motors if m.coulomb)
    balances = tuple(
        f"counterbalance {b.name}: no spring of MuJoCo's has its torque over the angle"
        for b in file.counterbalances
        if not b.in_mujoco
    )
    lines: dict[Format, tuple[str, ...]] = {
        "mjcf": (
            "contact: collision shapes are drawn only",
            "what the URDF draws",
            *balances,
            *noted,
        ),
        "urdf": (*_left_out_of_urdf(file), *delay),
        "state_space": friction,
        "modes": (*friction, *delay),
        "robot": (),
    }
    return lines[format]


def _left_out_of_urdf(file: "RobotFile") -> tuple[str, ...]:
    return (
        *(f"stiffness and damping of spring {spring.name}" for spring in file.springs),
        *(f"rotor inertia of motor {motor.name}" for motor in file.motors),
        *(f"torque gain of motor {motor.name}" for motor in file.motors if motor.torque_gain != 1),
        *(f"counterbalance {balance.name}" for balance in file.counterbalances),
        *(f"accelerometer {sensor.name}" for sensor in file.accelerometers),
        f"gravity {list(file.gravity)} m/s^2 in the frame of the root link",
    )
