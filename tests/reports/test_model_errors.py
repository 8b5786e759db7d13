from html import escape
from types import SimpleNamespace

import numpy as np
import pytest

from reports.sections import model_errors
from robotmodels import load_robot
from robotmodels.elastic.rigid_pose import joint_origins, part_origins

POSITION = np.array([0.3, -1.2, 0.9, -0.4, 0.7, 0.2])


@pytest.fixture(scope="module")
def ur10():
    return load_robot("ur10")


def results(robot, probabilities):
    """Return as much of a study as the picture needs."""
    names = tuple(probabilities)
    tests = SimpleNamespace(
        names=names,
        probabilities=np.array([*probabilities.values()]),
        significant=lambda level: [i for i, n in enumerate(names) if probabilities[n] < level],
    )
    return SimpleNamespace(
        trust=SimpleNamespace(tests=tests),
        robot=robot,
        plan=SimpleNamespace(positions=np.array([0.5 * POSITION, POSITION])),
        fits=SimpleNamespace(residuals=SimpleNamespace(by_position=np.array([1.0, 2.0]))),
    )


def test_parts_are_where_the_rigid_robot_has_them(ur10):
    points, joints = part_origins(ur10, POSITION), joint_origins(ur10, POSITION)[1:-1]
    for number, motor in enumerate(ur10.motor_names):
        assert points[motor] == pytest.approx(joints[number], abs=1e-12)
        assert points[f"d{number + 1}"] == pytest.approx(joints[number], abs=1e-12)
    assert 0 < np.linalg.norm(points["payload"] - joints[-1]) < 0.5


@pytest.mark.parametrize(
    ("test", "part"),
    [
        ("gain of m5", "m5"),
        ("gear ratio of m1", "m1"),
        ("b5x.stiffness", "b5x"),
        ("d1.damping in position 3", "d1"),
        ("d1.stiffness below 12.7 Hz", "d1"),
        ("payload.com.x", "payload"),
        ("delay", None),
        ("m10.inertia", None),
    ],
)
def test_tests_belong_to_parts(ur10, test, part):
    assert model_errors.part_of(test, part_origins(ur10, POSITION)) == part


def test_the_worst_position_shows_what_fails(ur10):
    shown = model_errors.picture(
        results(
            ur10, {"delay": 1e-9, "b5x.stiffness": 1e-7, "b5x.damping": 1e-6, "m1.inertia": 0.4}
        )
    )
    assert "in position 2: 1 b5x.stiffness (p-value < 0.0001)." in shown.caption
    assert escape(shown.caption) in shown.drawing
    assert model_errors.picture(results(ur10, {"delay": 1e-9, "m1.inertia": 0.4})) is None
