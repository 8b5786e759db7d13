"""Parameters beyond springs and dampers, and outputs beyond motor accelerations."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from derivatives import frf_derivatives

import robotmodels
from robotmodels.common.errors import InvalidInput
from robotmodels.description.robot_file import RobotFile, read_robot_file

LIBRARY = Path(robotmodels.__file__).parent / "library"
OMEGA = 2 * np.pi * np.array([2.0, 9.0, 14.0, 22.0, 47.0, 80.0])
POSITIONS = np.array([[0.3, -1.0, 0.8, -0.4, 0.9, 0.2], [-0.5, -0.3, -1.2, 0.6, -0.7, 1.0]])


def ur10(**changes):
    content = read_robot_file(LIBRARY / "ur10.yaml").model_dump(by_alias=True)
    content["springs"] += [
        {
            "name": f"cut_{axis}",
            "link": "forearm_link",
            "at": (0.0, 0.0, 0.3),
            "axis": axis,
            "stiffness": 5e4,
            "damping": 40.0,
            "distal": {"mass": 1.5, "com": (0, 0, 0.45), "inertia": (0.02, 0.02, 0.004)}
            if axis == "x"
            else None,
        }
        for axis in "xy"
    ]
    content["springs"][1]["stiffness"] = {"low": 2e4, "high": 6e4, "torque": 150.0}
    content |= changes
    return robotmodels.ElasticRobot(RobotFile.model_validate(content), LIBRARY)


def differences(robot):
    """dG/d ln theta by central differences, Richardson-extrapolated."""
    coarse, fine = (frf_derivatives(robot, POSITIONS, OMEGA, step) for step in (1e-3, 5e-4))
    return (4 * fine - coarse) / 3


EXTRA = [
    "m1.inertia",
    "m2.torque_gain",
    "m3.viscous",
    "delay",
    "payload.mass",
    "payload.com.x",
    "payload.inertia.zz",
    "cut_x.at",
]
ACCELEROMETERS = [
    {"name": "elbow", "link": "forearm_link", "at": (0, 0, 0.2), "direction": (1, 0, 0.5)},
    {"name": "tool", "link": "wrist_3_link", "at": (0, 0.1, 0), "direction": (0, 0, 1)},
]


def sensed(output):
    return ur10(
        output=output,
        accelerometers=ACCELEROMETERS,
        delay=1e-4,
        parameters={"extra": EXTRA, "tied": [["d5.stiffness", "d6.stiffness"]]},
    )


def test_every_sensitivity_equals_central_differences():
    robot = sensed("acceleration")
    G, J = robotmodels.sensitivity(robot, POSITIONS, OMEGA)
    assert G.shape == (2, 6, 8, 6)
    scale = np.abs(J).max(axis=(0, 1, 3), keepdims=True)
    np.testing.assert_allclose(J / scale, differences(robot) / scale, atol=1e-6)


def test_sensitivities_of_speed_and_angle_are_integrals_of_the_accelerations():
    acceleration, speed, angle = (
        robotmodels.sensitivity(sensed(o), POSITIONS, OMEGA)[1]
        for o in ("acceleration", "velocity", "position")
    )
    s = np.ones((len(OMEGA), 8), dtype=complex)
    s[:, :6] = 1j * OMEGA[:, None]  # accelerometers measure what they measure
    s = s[:, :, None, None]
    scale = 1e-12 * np.abs(acceleration).max(axis=(0, 1, 3), keepdims=True)
    assert (np.abs(s * speed - acceleration) <= scale).all()
    assert (np.abs(s**2 * angle - acceleration) <= scale).all()


def test_the_shift_of_the_equilibrium_is_what_the_cheaper_mode_leaves_out():
    robot = ur10()
    exact = robotmodels.sensitivity(robot, POSITIONS, OMEGA)[1]
    cheap = robotmodels.sensitivity(robot, POSITIONS, OMEGA, equilibrium_shift=False)[1]
    difference = np.abs(exact - cheap).max(axis=(0, 1, 2, 3))
    difference /= np.abs(exact).max(axis=(0, 1, 2, 3))
    names = np.array(robot.parameters.names)
    hardening = np.array([n.startswith("d2.stiffness") for n in names])
    assert difference[~hardening].max() < 0.02
    assert difference[hardening].max() < 0.5  # its slope follows its torque, which shifts
    assert difference[[n.endswith("damping") for n in names]].max() == 0
    # Turning about the vertical, joint 1 feels no gravity; joint 2 carries the arm.
    assert difference[robot.parameters.index("d1.stiffness")] < 1e-9
    assert difference[robot.parameters.index("b1x.stiffness")] > 1e-4


def test_speed_and_angle_are_integrals_of_the_acceleration():
    acceleration, speed, angle = (
        robotmodels.frequency_response(ur10(output=o), POSITIONS, OMEGA)
        for o in ("acceleration", "velocity", "position")
    )
    s = 1j * OMEGA[:, None, None]
    np.testing.assert_allclose(s * speed, acceleration, rtol=1e-12)
    np.testing.assert_allclose(s**2 * angle, acceleration, rtol=1e-12)


def test_gain_and_delay_act_as_they_should():
    plain = robotmodels.frequency_response(ur10(), POSITIONS, OMEGA)
    motors = [m.model_dump() for m in ur10().file.motors]
    motors[2]["torque_gain"] = 1.25
    robot = ur10(motors=motors, delay=2e-3)
    expected = plain * np.exp(-2e-3j * OMEGA)[:, None, None]
    expected[..., 2] *= 1.25
    G = robotmodels.frequency_response(robot, POSITIONS, OMEGA)
    np.testing.assert_allclose(G, expected, rtol=1e-12)


def test_accelerometer_rows_are_derivatives_of_where_the_sensor_is_and_points():
    robot = ur10(accelerometers=ACCELEROMETERS)
    q = robot.equilibrium(POSITIONS[:1]).coordinates[0]
    measured = robotmodels.linearize(robot, POSITIONS[0]).measured

    def sensor(name, direction, coordinates):
        model = robot.arm.model
        data = model.createData()
        pin.framesForwardKinematics(model, data, coordinates)
        pose = data.oMf[model.getFrameId(name)]
        axis = pose.rotation @ np.array(direction) / np.linalg.norm(direction)
        return pose.translation.copy(), axis

    for row, mounted in enumerate(ACCELEROMETERS, start=6):
        _, axis = sensor(mounted["name"], mounted["direction"], q)
        for i in range(len(q)):
            step = 1e-6 * np.eye(len(q))[i]
            there = sensor(mounted["name"], mounted["direction"], q + step)
            back = sensor(mounted["name"], mounted["direction"], q - step)
            along = axis @ (there[0] - back[0]) / 2e-6
            tilt = (there[1] - back[1]) @ np.array([0, 0, 9.81]) / 2e-6
            assert measured.acceleration[row, i] == pytest.approx(along, abs=1e-8)
            assert measured.position[row, i] == pytest.approx(tilt, abs=1e-7)


def test_tied_parameters_keep_their_ratio():
    robot = ur10(parameters={"tied": [["d5.stiffness", "d6.stiffness"]]})
    assert "d6.stiffness" not in robot.parameters.names
    theta = robot.parameters.values.copy()
    theta[robot.parameters.index("d5.stiffness")] *= 2
    a, b = (robot.network(POSITIONS, t).spring_stiffness for t in (None, theta))
    np.testing.assert_allclose(b[:, 4:6], 2 * a[:, 4:6])


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"extra": ["payload.mas"]}, "did you mean 'payload.mass'"),
        ({"extra": ["payload.inertia.xy"]}, "payload.inertia.xy is 0"),
        ({"extra": ["delay"]}, "delay is 0"),
        ({"extra": ["m1.inertia", "m1.inertia"]}, "'m1.inertia' is named twice"),
        ({"extra": ["payload.com"]}, "mean 'payload.com.x' or 'payload.com.y' or 'payload.com.z'?"),
        ({"extra": ["d1.stiffness"]}, "'d1.stiffness' is free without that; extra is for"),
        ({"fixed": ["m1.inertia"]}, "'m1.inertia' is fixed unless parameters.extra names it"),
        ({"fixed": ["d1.stifness"]}, "did you mean 'd1.stiffness'"),
        ({"tied": [["d1.stiffness", "d2.damping"], ["d1.stiffness", "d3.damping"]]}, "tied twice"),
    ],
)
def test_wrong_choices_of_parameters_are_named(parameters, message):
    with pytest.raises(InvalidInput, match=message):
        ur10(parameters=parameters)


def test_an_accelerometer_on_an_unknown_link_is_refused():
    wrong = [ACCELEROMETERS[0] | {"link": "forearm"}]
    with pytest.raises(InvalidInput, match=r"accelerometer 'elbow': 'forearm'.*forearm_link"):
        ur10(accelerometers=wrong)
