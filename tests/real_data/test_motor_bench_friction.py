"""The motor bench as a robot file: friction of the load's bearing is not the spring's damper."""

from pathlib import Path
from typing import Any

import pytest
from test_motor_bench_frf import bench, estimate  # noqa: F401

from estimators import Fit, FrfEstimate, choose_structure, covariance, fit, score_tests
from robotmodels import ElasticRobot
from robotmodels.description.robot_file import RobotFile

PUBLISHED = {"g.stiffness": 552.5, "m.inertia": 0.004796, "payload.inertia.zz": 0.004804}
EXTRA = ["m.inertia", "m.viscous", "payload.inertia.zz", "delay"]


def bench_robot(friction: bool) -> ElasticRobot:
    """Return the bench in units of its unknown torque constant, all numbers free."""
    content: dict[str, Any] = {
        "schema": "robot/1",
        "name": "bench",
        "urdf": "bench.urdf",
        "gravity": [0, 0, 0],
        "motors": [
            {"name": "m", "joint": "shaft", "gear_ratio": 1, "inertia": 5e-3, "viscous": 0.02}
        ],
        "springs": [
            {"name": "g", "joint": "shaft", "axis": "drive", "stiffness": 500.0, "damping": 0.02}
        ],
        "payload": {"link": "load", "mass": 1.0, "com": [0, 0, 0], "inertia": [5e-3] * 3},
        "delay": 1e-4,
        "parameters": {"extra": EXTRA + ["f.viscous"] * friction},
    }
    if friction:
        content["friction"] = [{"name": "f", "joint": "shaft", "viscous": 0.02}]
    return ElasticRobot(RobotFile.model_validate(content), Path(__file__).parent)


@pytest.fixture(scope="module")
def fits(estimate: FrfEstimate) -> tuple[Fit, Fit]:  # noqa: F811
    return tuple(fit(bench_robot(friction), estimate, "lls", "user") for friction in (False, True))


def named(one: Fit) -> dict[str, float]:
    return dict(zip(one.parameters.names, one.parameters.values.tolist(), strict=True))


def test_with_friction_of_the_load_the_published_values_come_out(fits: tuple[Fit, Fit]) -> None:
    values = named(fits[1])
    for name, published in PUBLISHED.items():
        assert values[name] == pytest.approx(published, rel=0.002)
    std = dict(zip(values, covariance(fits[1], "empirical").std.tolist(), strict=True))
    assert values["f.viscous"] == pytest.approx(0.117, rel=0.05)
    assert std["f.viscous"] < 0.15


def test_the_springs_damper_swallows_it_no_more(fits: tuple[Fit, Fit]) -> None:
    before, after = fits
    assert named(before)["g.damping"] > 0.03  # the bearing's friction
    assert abs(named(before)["g.stiffness"] / PUBLISHED["g.stiffness"] - 1) > 0.03
    assert "at a bound: g.damping" in after.message  # too small to be seen
    assert named(after)["g.damping"] < 1e-3
    assert after.data_cost < 0.15 * before.data_cost


def test_the_score_tests_name_the_friction_and_no_spring(fits: tuple[Fit, Fit]) -> None:
    first = score_tests(fits[0])[0]
    assert first.name == "friction behind the gear of shaft"
    # One linear step from the fit without it, against the refit with it.
    assert first.estimate == pytest.approx(named(fits[1])["f.viscous"], rel=0.1)
    assert choose_structure(fits[1]).springs == ()
