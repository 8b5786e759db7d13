"""Springs that a robot could have: where, with which bodies, and their derivatives when rigid."""

import numpy as np
import pinocchio as pin
import pytest
from robots import HERE

import robotmodels
from robotmodels import InvalidInput
from robotmodels.description.outputs import Output
from robotmodels.elastic.possible_springs import body_beyond, possible_springs, with_springs
from robotmodels.elastic.rigid_elements import reaction_factors
from robotmodels.elastic.robot import ElasticRobot

OMEGA = 2 * np.pi * np.array([3.0, 11.0, 40.0])
TIME = 2e-3
DAMPED = (1 + 1j * OMEGA * TIME)[:, None, None]


def _robot(name, **changes):
    robot = robotmodels.load_robot(name)
    return ElasticRobot(robot.file.model_copy(update=changes), robot.folder)


def _positions(robot, count=1):
    low, high = np.clip(robot.position_limits, -1.5, 1.5).T
    return np.random.default_rng(0).uniform(low, high, (count, len(low)))


SENSORS = [
    *({"motor": f"m{i}", "quantity": "velocity"} for i in (1, 2, 3)),
    {
        "link": "link6",
        "quantity": "acceleration",
        "at": [0.0, 0.1, 0.2],
        "direction": [1.0, 0.0, 0.0],
    },
]


@pytest.mark.parametrize("outputs", [[], SENSORS])
def test_the_derivative_at_compliance_zero_is_that_of_the_full_model(outputs):
    readings = [Output.model_validate(output) for output in outputs]
    robot = _robot("manutec_r3", gravity=(0.0, 0.0, 0.0), outputs=readings)
    positions = _positions(robot)
    springs = possible_springs(robot)
    assert {spring.axis for spring in springs} == {"drive", "x", "y", "z"}
    h, f = reaction_factors(robot, springs, positions, OMEGA)
    rigid = robotmodels.frequency_response(robot, positions, OMEGA)

    def quotient(spring, k):
        soft = spring.model_copy(update={"stiffness": k, "damping": TIME * k})
        other = with_springs(robot, [soft], free=False)
        return k * (robotmodels.frequency_response(other, positions, OMEGA) - rigid)

    for i in (0, 3, 6, 9, 12, 15, 20, 25, 30, 35, 40):
        derivative = h[:, :, i, :, None] * f[:, :, i, None, :] / DAMPED
        error = 2 * quotient(springs[i], 2e8) - quotient(springs[i], 1e8) - derivative
        assert np.linalg.norm(error) < 1e-3 * np.linalg.norm(derivative), springs[i].name


def test_gravity_shifts_equilibria_by_little():
    robot = robotmodels.load_robot("manutec_r3")
    positions, spring = _positions(robot), possible_springs(robot)[2]
    h, f = reaction_factors(robot, [spring], positions, OMEGA)
    soft = spring.model_copy(update={"stiffness": 1e9, "damping": TIME * 1e9})
    bent = robotmodels.frequency_response(with_springs(robot, [soft], free=False), positions, OMEGA)
    rigid = robotmodels.frequency_response(robot, positions, OMEGA)
    derivative = h[:, :, 0, :, None] * f[:, :, 0, None, :] / DAMPED
    error = np.linalg.norm(1e9 * (bent - rigid) - derivative)
    assert error < 0.02 * np.linalg.norm(derivative)


def test_a_cut_parts_a_body_as_its_samples_are():
    rng = np.random.default_rng(3)
    axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    spread = (axes * np.array([0.01, 0.04, 0.002])) @ axes.T
    com, direction = np.array([0.1, -0.05, 0.2]), np.array([0.6, 0.0, 0.8])
    whole = pin.Inertia(5.0, com, 5.0 * (np.trace(spread) * np.eye(3) - spread))
    body = body_beyond(whole, direction, 0.3)
    points = rng.multivariate_normal(com, spread, 400_000)
    beyond = points[points @ direction > 0.3]
    around = beyond - beyond.mean(axis=0)
    second = around.T @ around / len(points) * 5.0
    inertia = np.trace(second) * np.eye(3) - second
    assert body.mass == pytest.approx(5.0 * len(beyond) / len(points), rel=0.01)
    np.testing.assert_allclose(body.com, beyond.mean(axis=0), atol=3e-3)
    np.testing.assert_allclose(body.inertia, inertia[np.triu_indices(3)], atol=2e-3)
    assert body_beyond(whole, direction, 5.0) is None


@pytest.mark.parametrize("name", ["ur10", "panda", "kr240_class", "moberg_axis1"])
def test_a_robot_with_all_possible_springs_is_the_rigid_one_when_they_are_stiff(name):
    robot = robotmodels.load_robot(name)
    stiff = [
        spring.model_copy(update={"stiffness": 1e14, "damping": 1e9})
        for spring in possible_springs(robot)
    ]
    other = with_springs(robot, stiff, free=False)
    assert other.parameters.names == robot.parameters.names
    positions = _positions(robot)
    expected = robotmodels.frequency_response(robot, positions, OMEGA)
    response = robotmodels.frequency_response(other, positions, OMEGA)
    np.testing.assert_allclose(response, expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())
    free = with_springs(robot, stiff[:1], free=True)
    assert len(free.parameters) == len(robot.parameters) + 2


def test_shares_of_cuts_are_checked():
    with pytest.raises(InvalidInput, match="between 0 and 1"):
        possible_springs(robotmodels.load_robot("ur10"), cuts=[1.0])


def test_a_spring_that_is_there_already_is_refused():
    robot = robotmodels.load_robot("ur10")
    again = robot.file.springs[0].model_copy(update={"name": "again"})
    with pytest.raises(InvalidInput, match="2 springs about axis 'drive'"):
        with_springs(robot, [again], free=True)


def test_joints_that_follow_others_move_along():
    robot = robotmodels.load_robot(HERE / "parallelogram.yaml")
    robot = ElasticRobot(robot.file.model_copy(update={"gravity": (0.0, 0.0, 0.0)}), robot.folder)
    springs = possible_springs(robot)
    positions = np.array([[0.35, -0.4]])
    h, f = reaction_factors(robot, springs, positions, OMEGA)
    rigid = robotmodels.frequency_response(robot, positions, OMEGA)
    for i, spring in enumerate(springs):
        soft = spring.model_copy(update={"stiffness": 1e9, "damping": TIME * 1e9})
        other = with_springs(robot, [soft], free=False)
        change = 1e9 * (robotmodels.frequency_response(other, positions, OMEGA) - rigid)
        derivative = h[:, :, i, :, None] * f[:, :, i, None, :] / DAMPED
        size = np.linalg.norm(derivative)
        assert np.linalg.norm(change - derivative) < 5e-3 * size + 1e-9, spring.name


def test_names_are_those_of_springs_and_unique(tmp_path):
    robot = robotmodels.load_robot("manutec_r3")
    urdf = robot.model_file.path.read_text().replace('"joint3"', '"joint.3"')
    (tmp_path / "robot.urdf").write_text(urdf)
    motors = [
        motor.model_copy(update={"joint": motor.joint.replace("joint3", "joint.3")})
        for motor in robot.file.motors
    ]
    springs = [
        spring.model_copy(
            update={
                "joint": spring.joint.replace("joint3", "joint.3"),
                "name": "joint1 x" if spring.name == "g2" else spring.name,
            }
        )
        for spring in robot.file.springs
    ]
    update = {"urdf": "robot.urdf", "motors": motors, "springs": springs}
    other = ElasticRobot(robot.file.model_copy(update=update), tmp_path)
    absent = possible_springs(other)
    assert len(absent) == len(possible_springs(robot))
    assert {"joint1 x 2", "joint_3 y"} <= {spring.name for spring in absent}


def test_two_cuts_of_one_link_keep_their_axes_apart():
    robot = robotmodels.load_robot("ur10")
    cuts = [s for s in possible_springs(robot) if s.link == "forearm_link" and s.axis == "x"]
    cut = with_springs(robot, cuts, free=True)
    absent = [s for s in possible_springs(cut) if s.link == "forearm_link"]
    assert len(absent) == 4
    assert len({spring.name for spring in absent}) == 4
    h, f = reaction_factors(cut, absent, _positions(cut), OMEGA)
    assert np.isfinite(h).all()
    assert f.any()
