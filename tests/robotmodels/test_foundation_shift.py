"""A foundation that shifts: a torsion about a point far below the base."""

import numpy as np
import pytest

from robotmodels import Frame, load_robot, tool_model, with_springs
from robotmodels.description.robot_file import Spring

ROBOT = load_robot("ur10")
AT = np.array([[0.3, -1.0, 1.2, 0.4, 0.5, 0.1]])
STIFFNESS, DEPTH = 1e6, 100.0


def test_every_link_shifts_alike():
    spring = Spring(
        name="shift",
        link="world",
        at=(0.0, 0.0, -DEPTH),
        axis="x",
        stiffness=STIFFNESS * DEPTH**2,
        damping=1.0,
    )
    robot = with_springs(ROBOT, [spring], free=True)
    stiff = [
        value * (1e6 if name.endswith(".stiffness") and name != "shift.stiffness" else 1.0)
        for name, value in zip(robot.parameters.names, robot.parameters.values, strict=True)
    ]
    for link in ("forearm_link", "wrist_1_link"):
        model = tool_model(robot, AT, Frame(link), np.array(stiff))
        compliance = model.compliance()[0, :3, :3]
        assert compliance[1, 1] == pytest.approx(1 / STIFFNESS, rel=0.03)
        assert abs(compliance[0, 0]) < 1e-3 / STIFFNESS
