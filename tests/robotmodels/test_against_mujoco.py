"""The elastic robot against MuJoCo, which shares no code with it but the robot file's schema."""

from copy import deepcopy
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
from mujoco_arm import MujocoArm
from robots import CRANE, PANDA, SENSED, SPLIT, WALL, built

from robotmodels import ElasticRobot, frequency_response, load_robot, sensitivity
from robotmodels.description.robot_file import RobotFile
from robotmodels.description.urdf import locate
from robotmodels.elastic.dynamics import gravity

OMEGA = 2 * np.pi * np.geomspace(2.0, 80.0, 6)
NAMES = ("ur10", "split", "wall", "panda", "crane")


@dataclass(frozen=True, eq=False)
class Case:
    """A robot, its judge, and ten random positions."""

    robot: ElasticRobot
    judge: MujocoArm
    positions: np.ndarray
    coordinates: np.ndarray  # the judge's equilibria, in the robot's order

    @property
    def order(self) -> np.ndarray:
        return self.judge.order(self.robot.coordinate_names)


def judge_of(robot: ElasticRobot) -> MujocoArm:
    return MujocoArm(robot.file, locate(robot.file.urdf, robot.folder))


@cache
def case(name: str) -> Case:
    contents = {"split": SPLIT, "wall": WALL, "panda": PANDA, "crane": CRANE}
    robot = built(contents[name]) if name in contents else load_robot(name)
    judge = judge_of(robot)
    rng = np.random.default_rng(NAMES.index(name))
    positions = rng.uniform(*robot.position_limits.T, (10, len(robot.motor_names)))
    order = judge.order(robot.coordinate_names)
    coordinates = np.array([judge.equilibrium(p, {})[order] for p in positions])
    return Case(robot, judge, positions, coordinates)


def arm_size(robot: ElasticRobot) -> int:
    return robot.arm.model.nv


def relative(found: np.ndarray, expected: np.ndarray, axes: tuple[int, ...]) -> float:
    """Return the largest error relative to the largest entry along `axes`."""
    scale = np.abs(expected).max(axis=axes, keepdims=True)
    return float((np.abs(found - expected) / np.where(scale > 0, scale, 1.0)).max())


@cache
def expected_sensitivity(name: str) -> np.ndarray:
    """Return dG/d ln theta by central differences of the judge's responses."""
    c = case(name)
    step = 1e-4
    groups = {group[0]: group for group in c.robot.file.parameters.tied}
    columns = []
    for parameter in c.robot.parameters.names:
        tied = groups.get(parameter, [parameter])
        plus, minus = (
            c.judge.frequency_response(c.positions, OMEGA, dict.fromkeys(tied, np.exp(h)))
            for h in (step, -step)
        )
        columns.append((plus - minus) / (2 * step))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("name", NAMES)
def test_equilibria(name: str) -> None:
    c = case(name)
    found = c.robot.equilibrium(c.positions).coordinates
    np.testing.assert_allclose(found, c.coordinates[:, : found.shape[1]], rtol=0, atol=1e-9)
    rest = np.array([c.judge.rest(p)[c.order] for p in c.positions])[:, : found.shape[1]]
    assert 1e-4 < np.abs(found - rest).max() < 0.1  # there is something to find


@pytest.mark.parametrize("name", NAMES)
def test_mass_matrices(name: str) -> None:
    c = case(name)
    found = c.robot.network(c.positions).linear_model().mass
    back = np.argsort(c.order)
    expected = [c.judge.mass(q[back])[np.ix_(c.order, c.order)] for q in c.coordinates]
    assert relative(found, np.array(expected), (1, 2)) < 1e-10


@pytest.mark.parametrize("name", NAMES)
def test_gravity_and_its_derivative(name: str) -> None:
    c = case(name)
    d = arm_size(c.robot)
    load = gravity(c.robot.arm, c.coordinates[:, :d])
    torques, slopes = load.torques, load.slopes
    back = np.argsort(c.order)
    expected = np.array([c.judge.gravity(q[back])[c.order] for q in c.coordinates])
    by_q = np.array(
        [c.judge.gravity_stiffness(q[back])[np.ix_(c.order, c.order)] for q in c.coordinates]
    )
    assert relative(torques, expected[:, :d], (1,)) < 1e-10
    assert relative(slopes, by_q[:, :d, :d], (1, 2)) < 1e-9
    assert not expected[:, d:].any()  # motors carry no weight


@pytest.mark.parametrize("name", NAMES)
def test_frequency_responses(name: str) -> None:
    c = case(name)
    found = frequency_response(c.robot, c.positions, OMEGA)
    expected = c.judge.frequency_response(c.positions, OMEGA)
    assert relative(found, expected, (2, 3)) < 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_exact_sensitivities(name: str) -> None:
    c = case(name)
    found = sensitivity(c.robot, c.positions, OMEGA)[1]
    assert relative(found, expected_sensitivity(name), (1, 2, 3)) < 1e-4


def test_sensitivities_without_sag_are_not_exact() -> None:
    """A negative control: the tolerance above would notice."""
    c = case("split")
    found = sensitivity(c.robot, c.positions, OMEGA, equilibrium_shift=False)[1]
    assert relative(found, expected_sensitivity("split"), (1, 2, 3)) > 1e-3


def test_responses_without_sag_are_not_exact() -> None:
    """A negative control: linearised where the springs are unloaded."""
    c = case("ur10")
    found = frequency_response(c.robot, c.positions, OMEGA)
    expected = c.judge.frequency_response(c.positions, OMEGA, gravity_shift=False)
    assert relative(found, expected, (2, 3)) > 1e-4


@pytest.mark.parametrize(
    ("name", "content", "pair"),
    [
        ("split", SPLIT, ("b2x", "b2z")),
        ("split", SPLIT, ("a3x", "a3y")),
        ("wall", WALL, ("b3z", "b3x")),
    ],
)
def test_the_order_of_torsions_matters(
    name: str, content: dict[str, Any], pair: tuple[str, str]
) -> None:
    """A negative control: two torsions of a joint or cut in the opposite order."""
    c = case(name)
    springs = list(content["springs"])
    i, j = (next(k for k, s in enumerate(springs) if s["name"] == n) for n in pair)
    springs[i], springs[j] = springs[j], springs[i]
    swapped = MujocoArm(RobotFile.model_validate(content | {"springs": springs}), c.judge.urdf)
    found = frequency_response(c.robot, c.positions, OMEGA)
    assert relative(found, swapped.frequency_response(c.positions, OMEGA), (2, 3)) > 1e-5


def scaled(content: dict[str, Any], name: str, factor: float) -> dict[str, Any]:
    """Return `content` with one of its extra parameters multiplied."""
    copy = deepcopy(content)
    owner, _, rest = name.partition(".")
    if name == "delay":
        copy["delay"] *= factor
    elif owner == "payload" and rest == "com.z":
        copy["payload"]["com"][2] *= factor
    elif owner == "payload":
        copy["payload"][rest] *= factor
    elif rest == "at":
        for spring in copy["springs"]:
            if spring["name"] in ("a3x", "a3y"):  # one cut
                spring["at"] = [x * factor for x in spring["at"]]
    else:
        (motor,) = (m for m in copy["motors"] if m["name"] == owner)
        motor[rest] *= factor
    return copy


def test_accelerometers_and_parameters_beyond_springs() -> None:
    robot = built(SENSED)
    judge = judge_of(robot)
    positions = case("split").positions[:2]
    G, J = sensitivity(robot, positions, OMEGA)
    assert G.shape[2:] == (6 + 3, 6)
    expected = judge.frequency_response(positions, OMEGA)
    assert relative(G, expected, (3,)) < 1e-6  # row by row: the foot moves little
    step = 1e-4
    for name in SENSED["parameters"]["extra"]:
        files = (RobotFile.model_validate(scaled(SENSED, name, np.exp(h))) for h in (step, -step))
        plus, minus = (MujocoArm(f, judge.urdf).frequency_response(positions, OMEGA) for f in files)
        column = J[..., robot.parameters.index(name)]
        assert relative(column, (plus - minus) / (2 * step), (1, 2, 3)) < 1e-4, name


def test_a_joint_without_motor_on_its_drive_spring() -> None:
    """A spring between two links that no motor acts on."""
    motors = [m for m in WALL["motors"] if m["joint"] != "wrist_2_joint"]
    robot = built(WALL | {"motors": motors})
    positions = case("wall").positions[:, [0, 1, 2, 4]]
    expected = judge_of(robot).frequency_response(positions, OMEGA)
    assert relative(frequency_response(robot, positions, OMEGA), expected, (2, 3)) < 1e-6


def without_drives(*springs: str) -> dict[str, Any]:
    """Return the crane with some of its drives rigid."""
    return CRANE | {"springs": [s for s in CRANE["springs"] if s["name"] not in springs]}


def without_joints(*joints: str, **lock: float) -> dict[str, Any]:
    """Return the crane with some of its joints locked."""
    motors = [m for m in CRANE["motors"] if m["joint"] not in joints]
    springs = [s for s in CRANE["springs"] if s.get("joint") not in joints]
    return CRANE | {"motors": motors, "springs": springs, "lock": CRANE["lock"] | lock}


VARIANTS: dict[str, dict[str, Any]] = {
    "rigid drives under bearing torsions, one prismatic, one continuous": without_drives(
        "dt", "ds"
    ),
    "every ratio of the other sign": CRANE
    | {"motors": [m | {"gear_ratio": -m["gear_ratio"]} for m in CRANE["motors"]]},
    "a spring without motor on a prismatic joint": CRANE
    | {"motors": [m for m in CRANE["motors"] if m["joint"] != "slide"]},
    "the other branch locked": without_joints("nod", nod=1.2),
    "a continuous and a prismatic joint locked": without_joints("turn", "slide", turn=5, slide=0.3),
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_odd_robots(variant: str) -> None:
    robot = built(VARIANTS[variant] | {"parameters": {"fixed": ["fz.damping"]}})
    judge = judge_of(robot)
    positions = np.random.default_rng(5).uniform(
        *robot.position_limits.T, (3, len(robot.motor_names))
    )
    G, J = sensitivity(robot, positions, OMEGA)
    assert relative(G, judge.frequency_response(positions, OMEGA), (2, 3)) < 1e-6
    for name in ("fx.stiffness", "dw.damping"):
        plus, minus = (
            judge.frequency_response(positions, OMEGA, {name: np.exp(h)}) for h in (1e-4, -1e-4)
        )
        column = J[..., robot.parameters.index(name)]
        assert relative(column, (plus - minus) / 2e-4, (1, 2, 3)) < 1e-4, name
