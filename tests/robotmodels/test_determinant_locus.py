"""Stability by encirclements against the poles of the closed loop.

Larger gains have motions so fast that the poles' rational approximation of delays misses some.
"""

import numpy as np
import pytest
import yaml
from robots import HERE, built, changed

from robotmodels import default_controller, determinant_loci, linear_feedback, loop_margins
from robotmodels.simulation.linear_feedback import LinearFeedback
from robotmodels.simulation.loop_plant import loop_plant, loop_poles

CONTENT = yaml.safe_load((HERE / "two_joints.yaml").read_text())
POSITIONS = np.array([[-0.8, 0.4], [-1.5, 1.2], [1.4, 0.2]])
LAG, SPEED = 0.002, 0.08


def _continuous(gains):
    """K (1 + Td s) / (1 + T s) for each motor."""
    n = len(gains)
    K = np.diag(gains)
    return LinearFeedback(-np.eye(n) / LAG, np.eye(n), -K * (SPEED - LAG) / LAG**2, K * SPEED / LAG)


def _sampled(robot, factor):
    feedback = linear_feedback(default_controller(robot, 1e-3))
    return feedback.filtered(0, None, factor).filtered(1, None, factor)


@pytest.mark.parametrize("delay", [0.0, 2.3e-3])
@pytest.mark.parametrize("sampled", [True, False])
def test_unstable_poles_are_counted(sampled, delay):
    motors = [motor | {"torque_delay": delay} for motor in CONTENT["motors"]]
    robot = built(changed(CONTENT, motors=motors))
    counts = []
    for factor in (-0.3, 0.03, 0.3, 1.0, 3.0, 10.0):
        feedback = _sampled(robot, factor) if sampled else _continuous([20 * factor, 8 * factor])
        margins = loop_margins(robot, POSITIONS, feedback)
        loci = determinant_loci(robot, POSITIONS, feedback)
        models = robot.network(POSITIONS).linear_model()
        for i, locus in enumerate(loci):
            poles = loop_poles(loop_plant(models.at(i), feedback.sample_time), feedback)
            growing = np.abs(poles) > 1 + 1e-6 if sampled else poles.real > 1e-3
            assert locus.unstable == growing.sum()
            assert locus.stable == margins.stable[i]
            counts.append(locus.unstable)
    assert min(counts) == 0 < max(counts)


def test_an_upright_robot_is_unstable_without_feedback():
    nothing = LinearFeedback(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((2, 0)), np.zeros((2, 2)))
    locus = determinant_loci(built(CONTENT), POSITIONS[1:2], nothing)[0]
    assert locus.open_unstable == locus.unstable > 0
    np.testing.assert_allclose(locus.values, 1.0)
