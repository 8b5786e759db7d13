"""The formats of `robotmodels.export`: how their files end, and what they cannot hold."""

from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from robotmodels.description.friction import JointFriction
    from robotmodels.description.outputs import Output
    from robotmodels.description.robot_file import Motor, RobotFile

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
    sharp = tuple(f"Coulomb friction of {_whose(x)}" for x in file.frictional if x.coulomb)
    smooth = [x for x in file.frictional if x.coulomb and x.coulomb_width]
    onset = tuple(f"smooth onset of Coulomb friction of {_whose(x)}" for x in smooth)
    loaded = tuple(f"Coulomb friction by the load of {_whose(x)}" for x in file.friction if x.load)
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
            *onset,
            *loaded,
            *noted,
            *_left_out_of_mjcf(file),
        ),
        "urdf": (*_left_out_of_urdf(file), *onset, *loaded, *delay, *_late_torques(file)),
        "state_space": (*sharp, *loaded),
        "modes": (*sharp, *loaded, *delay, *_late_torques(file)),
        "robot": (),
    }
    return lines[format]


def _whose(item: "Motor | JointFriction") -> str:
    return f"motor {item.name}" if hasattr(item, "gear_ratio") else f"joint {item.joint}"


def _left_out_of_urdf(file: "RobotFile") -> tuple[str, ...]:
    from robotmodels.description.outputs import outputs_of  # `oed --help` waits for no schema

    return (
        *(f"stiffness and damping of spring {spring.name}" for spring in file.springs),
        *(f"rotor inertia of motor {motor.name}" for motor in file.motors),
        *(f"torque gain of motor {motor.name}" for motor in file.motors if motor.torque_gain != 1),
        *(f"counterbalance {balance.name}" for balance in file.counterbalances),
        *(
            output.who
            for output in outputs_of(file)
            if output.kind != "motor" or output.name is None
        ),
        f"gravity {list(file.gravity)} m/s^2 in the frame of the root link",
    )


def _left_out_of_mjcf(file: "RobotFile") -> tuple[str, ...]:
    changed = [output.who for output in file.outputs if not output.ideal]
    return (
        *_late_torques(file),
        *(f"gain, delay and lag of {who}: noted in <custom>, not simulated" for who in changed),
        *(f"{o.who}: MuJoCo has no such sensor" for o in file.outputs if not _in_mujoco(file, o)),
    )


def _in_mujoco(file: "RobotFile", output: "Output") -> bool:
    if output.kind == "spring":
        return sensed_joint(file, output) is not None
    return output.kind != "joint" or output.quantity != "acceleration"


def _late_torques(file: "RobotFile") -> tuple[str, ...]:
    late = [motor.name for motor in file.motors if motor.torque_delay or motor.torque_lag]
    return tuple(f"delay and lag of the torque of motor {name}" for name in late)


def sensed_joint(file: "RobotFile", output: "Output") -> str | None:
    """Return the joint on whose drive spring a torque sensor is; None of other outputs."""
    springs = {spring.name: spring for spring in file.springs}
    spring = springs[output.of] if output.kind == "spring" else None
    return spring.joint if spring is not None and spring.axis == "drive" else None
