import numpy as np
import pytest

import robotmodels
from robotmodels import ElasticRobot, LinearModel
from robotmodels.linear.coupled_chains import CoupledChains
from robotmodels.linear.modes import anti_resonances, damped_modes, resonances

HZ = 2 * np.pi
NAMES = (
    "kr240_class",
    "kr300",
    "manutec_r3",
    "manutec_r3_26",
    "manutec_r3_hardening",
    "moberg_axis1",
    "panda",
    "ur10",
    "ur5",
    "xarm7",
)
MOTORS = dict.fromkeys(NAMES, 6) | {"moberg_axis1": 1, "panda": 7, "xarm7": 7}


@pytest.fixture(scope="module", params=NAMES)
def robot(request: pytest.FixtureRequest) -> ElasticRobot:
    return robotmodels.load_robot(request.param)


def random_positions(robot: ElasticRobot, count: int) -> np.ndarray:
    low, high = robot.position_limits.T
    return np.random.default_rng(7).uniform(low, high, (count, len(low)))


def test_the_list() -> None:
    assert robotmodels.builtin_robots() == NAMES


def test_named_after_its_file_and_sourced(robot: ElasticRobot) -> None:
    assert robot.name in NAMES
    assert len(robot.file.source) > 100
    assert "ILLUSTRATIVE" in robot.file.source
    assert len(robot.motor_names) == MOTORS[robot.name]


def test_stands_everywhere_and_has_a_finite_frf(robot: ElasticRobot) -> None:
    positions = random_positions(robot, 20)
    at = robot.equilibrium(positions)
    assert np.abs(at.elongations).max() < 0.01
    G = robotmodels.frequency_response(robot, positions, HZ * np.geomspace(1, 100, 5))
    n = MOTORS[robot.name]
    assert G.shape == (20, 5, n, n)
    assert np.isfinite(G).all()
    assert np.abs(G - np.swapaxes(G, -1, -2)).max() < 1e-9 * np.abs(G).max()


def test_flexible_modes_can_be_seen(robot: ElasticRobot) -> None:
    model = robot.network(random_positions(robot, 20)).linear_model()
    hertz = resonances(model).frequencies / HZ
    assert hertz.min() > 5
    visible = (hertz < 100).sum(axis=-1)
    assert (visible >= min(hertz.shape[-1], len(robot.motor_names)) * 0.8).all()
    for motor in range(len(robot.motor_names)):
        assert anti_resonances(model, motor).min() > 2.5 * HZ
    slow = damped_modes(model.at(0))
    ratios = slow.damping_ratios[slow.frequencies < 60 * HZ]
    assert ratios.min() > 0.005
    assert ratios.max() < 0.5


def test_every_parameter_acts_on_the_frf(robot: ElasticRobot) -> None:
    omega = HZ * np.geomspace(2, 80, 6)
    positions = random_positions(robot, 3)
    G, J = robotmodels.sensitivity(robot, positions, omega, equilibrium_shift=False)
    effect = np.abs(J).max(axis=(0, 1, 2, 3)) / np.abs(G).max()
    assert effect.min() > 1e-5, robot.parameters.names[int(effect.argmin())]


def test_holding_the_equilibria_changes_as_little_as_documented(robot: ElasticRobot) -> None:
    """The figures of `sensitivity` and of `oed.information`."""
    omega = HZ * np.geomspace(2, 80, 40)
    positions = random_positions(robot, 15)
    G, exact = robotmodels.sensitivity(robot, positions, omega)
    fixed = robotmodels.sensitivity(robot, positions, omega, equilibrium_shift=False)[1]
    axes = (0, 1, 2, 3)
    assert (np.abs(exact - fixed).max(axes) < 0.05 * np.abs(exact).max(axes)).all()
    weight = 1 / np.sqrt(robotmodels.RelativeNoise().variance(G))[..., None]
    std = []
    for J in (exact, fixed):
        whitened = (weight * J).reshape(-1, J.shape[-1])
        information = 2 * (whitened.conj().T @ whitened).real
        std.append(np.sqrt(np.diag(np.linalg.inv(information))))
    np.testing.assert_allclose(std[1], std[0], rtol=3e-3)


def test_manutec_r3_modes_lie_between_19_1_and_50_9_hz() -> None:
    robot = robotmodels.load_robot("manutec_r3")
    poses = [[-60, 20, 90, 0, -110, 0], [0] * 6, [0, 45, 60, 0, 30, 0]]
    model = robotmodels.linearize(robot, np.deg2rad(poses))
    hertz = resonances(model).frequencies / HZ
    assert hertz.shape == (3, 3)
    assert hertz.min() == pytest.approx(19.1, abs=0.05)
    assert hertz.max() == pytest.approx(50.9, abs=0.05)


def test_manutec_r3_has_the_published_values_on_the_arm_side() -> None:
    file = robotmodels.load_robot("manutec_r3").file
    ratio = np.array([m.gear_ratio for m in file.motors])
    assert ratio == pytest.approx([-105, 210, 60, -99, 79.2, -99])
    square = ratio**2
    springs = np.array([[s.stiffness, s.damping] for s in file.springs])
    assert springs[:, 0] == pytest.approx(np.array([43, 8, 58]) * square[:3])
    assert springs[:, 0] == pytest.approx([474.1e3, 352.8e3, 208.8e3], rel=1e-4)
    assert springs[:, 1] == pytest.approx(np.array([0.005, 0.01, 0.04]) * square[:3])
    viscous = np.array([m.viscous for m in file.motors])
    assert viscous[:3] == pytest.approx([0.13 / 160, 0.1 / 130, 0.2 / 130], rel=1e-4)
    assert viscous[3:] * square[3:] == pytest.approx([9.8, 0.03, 3.92], rel=1e-4)
    coulomb = np.array([m.coulomb for m in file.motors])
    assert coulomb[:3] == pytest.approx([0.4, 0.5, 0.7])
    assert coulomb[3:] * np.abs(ratio[3:]) == pytest.approx([21.8, 30.1, 10.9], rel=1e-4)


def test_manutec_r3_weighs_what_is_published() -> None:
    robot = robotmodels.load_robot("manutec_r3")
    # At the zero pose (upright; y is up) joint 2 carries the lever arms along z only.
    g = 9.81
    lever_from_joint_2 = {"load": (15.0, -0.155 + 0.1), "4": (28.7, -0.155), "5": (5.2, -0.155)}
    torque = sum(m * z for m, z in lever_from_joint_2.values()) + 0.5 * (-0.155 + 0.05)
    at = robot.equilibrium(np.zeros((1, 6)))
    g2 = 1
    # The sag itself moves the levers by a few parts in a hundred.
    assert at.slopes[0, g2] * at.elongations[0, g2] == pytest.approx(g * torque, rel=0.05)


def test_manutec_r3_26_has_the_unknowns_of_wernholt_and_moberg() -> None:
    small, large = (robotmodels.load_robot(name) for name in ("manutec_r3", "manutec_r3_26"))
    names = large.parameters.names
    assert len(names) == 26
    assert sum(n.endswith(".stiffness") for n in names) == 12
    assert sum(n.endswith(".damping") for n in names) == 12
    assert names[24:] == ("m1.inertia", "m2.inertia")
    assert sum(s.axis == "drive" for s in large.file.springs) == 6
    assert large.file.motors == small.file.motors
    assert large.file.springs[:3] == small.file.springs
    assert large.file.payload == small.file.payload


def test_manutec_r3_26_stiffened_is_manutec_r3() -> None:
    small, large = (robotmodels.load_robot(name) for name in ("manutec_r3", "manutec_r3_26"))
    position = np.deg2rad([-60.0, 20, 90, 0, -110, 0])
    rigid = large.parameters.values.copy()
    rigid[3:12] *= 1e5
    measured = resonances(robotmodels.linearize(small, position)).frequencies
    found = resonances(robotmodels.linearize(large, position, rigid)).frequencies[:3]
    assert found == pytest.approx(measured, rel=1e-3)


def test_manutec_r3_hardening_differs_from_manutec_r3_26_in_its_gears_only() -> None:
    soft, linear = (robotmodels.load_robot(f"manutec_r3_{n}") for n in ("hardening", "26"))
    assert soft.file.motors == linear.file.motors
    assert soft.file.payload == linear.file.payload
    for gear, nominal in zip(soft.file.springs, linear.file.springs, strict=True):
        assert gear.damping == nominal.damping
        if nominal.axis == "drive":
            assert gear.stiffness.low == pytest.approx(0.85 * nominal.stiffness, rel=1e-5)
            assert gear.stiffness.high == pytest.approx(1.25 * nominal.stiffness, rel=1e-5)
        else:
            assert gear == nominal


def four_masses() -> CoupledChains:
    """The benchmark as published, on the motor side, with its first spring at 100 N m/rad."""
    return CoupledChains(
        [[5e-3, 2e-3, 0.02, 0.02]], [[100.0, 110.0, 80.0]], [[0.0]], [[0.08, 0.06, 0.08]]
    )


def stiff_axis() -> LinearModel:
    robot = robotmodels.load_robot("moberg_axis1")
    values = robot.parameters.values.copy()
    values[robot.parameters.index("g1.stiffness.low")] = 100 * 220**2
    return robotmodels.linearize(robot, np.zeros(1), values)


def test_moberg_axis1_published_resonances_and_anti_resonances() -> None:
    model = stiff_axis()
    assert resonances(model).frequencies / HZ == pytest.approx([12.40, 19.12, 54.67], rel=1e-3)
    assert anti_resonances(model, 0) / HZ == pytest.approx([5.25, 15.38, 52.32], rel=1e-3)


def test_moberg_axis1_equals_four_masses_on_the_motor_side() -> None:
    chain = four_masses().linear_model()
    friction = np.diag([6e-3, 0, 0, 0])
    chain = LinearModel(chain.mass, chain.damping + friction, chain.stiffness, chain.selector)
    omega = HZ * np.geomspace(1, 100, 50)
    expected = chain.frequency_response(omega)
    assert np.abs(stiff_axis().frequency_response(omega) / expected - 1).max() < 1e-9


def test_moberg_axis1_does_not_feel_gravity() -> None:
    robot = robotmodels.load_robot("moberg_axis1")
    at = robot.equilibrium(np.array([[-1.0], [0.0], [2.0]]))
    assert np.abs(at.elongations).max() < 1e-12
    assert at.slopes[:, 0] == pytest.approx(16.7 * 220**2, rel=1e-12)
    assert "g1.stiffness.high" not in robot.parameters.names


def test_kr240_class_has_the_published_joint_stiffnesses() -> None:
    robot = robotmodels.load_robot("kr240_class")
    assert robot.parameters.values[:6] == pytest.approx([3.8e6, 6.6e6, 3.9e6, 5.6e5, 6.6e5, 4.7e5])
    total = sum(i.mass for i in robot.arm.model.inertias)
    assert 900 < total < 1300  # with 240 kg of payload


def test_panda_fingers_are_locked() -> None:
    robot = robotmodels.load_robot("panda")
    assert set(robot.file.lock) == {"panda_finger_joint1", "panda_finger_joint2"}
    assert robot.rigid.nv == 7
