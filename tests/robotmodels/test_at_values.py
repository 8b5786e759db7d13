"""A robot at other values is the robot whose file says so."""

import numpy as np
import pytest

from robotmodels import CoupledChains, InvalidInput, WithParameters, load_robot, sensitivity

OMEGA = 2 * np.pi * np.array([3.0, 12.0])
POSITIONS = np.array([[0.1, 0.4, -0.9, 0.2, 0.5, 0.0]])


@pytest.mark.parametrize("equilibrium_shift", [True, False])
def test_responses_and_slopes_are_those_at_the_values(equilibrium_shift):
    robot = load_robot("manutec_r3_hardening")
    values = robot.parameters.values * np.linspace(0.9, 1.2, len(robot.parameters))
    other = WithParameters(robot, values)
    found = sensitivity(other, POSITIONS, OMEGA, equilibrium_shift=equilibrium_shift)
    expected = sensitivity(robot, POSITIONS, OMEGA, values, equilibrium_shift=equilibrium_shift)
    for one, two in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(other.parameters.values, values)
    # Values that are given still count.
    again = sensitivity(
        other, POSITIONS, OMEGA, robot.parameters.values, equilibrium_shift=equilibrium_shift
    )[0]
    np.testing.assert_array_equal(
        again, sensitivity(robot, POSITIONS, OMEGA, equilibrium_shift=equilibrium_shift)[0]
    )
    own, tangents = (
        other.network(POSITIONS),
        other.tangents(POSITIONS, equilibrium_shift=equilibrium_shift),
    )
    np.testing.assert_array_equal(
        own.spring_stiffness, robot.network(POSITIONS, values).spring_stiffness
    )
    assert (tangents is None) == (
        robot.tangents(POSITIONS, values, equilibrium_shift=equilibrium_shift) is None
    )


def test_systems_of_springs_alone():
    chain = CoupledChains([[1.0, 2.0]], [[300.0]], [[0.0]], [[4.0]])
    other = WithParameters(chain, chain.parameters.values * 2)
    nowhere = np.zeros((1, 0))
    found = sensitivity(other, nowhere, OMEGA)[0]
    expected = sensitivity(chain, nowhere, OMEGA, chain.parameters.values * 2)[0]
    np.testing.assert_array_equal(found, expected)
    assert other.tangents(nowhere) is None


def test_values_that_do_not_fit():
    chain = CoupledChains([[1.0, 2.0]], [[300.0]], [[0.0]], [[4.0]])
    with pytest.raises(InvalidInput, match="positive"):
        _ = WithParameters(chain, -chain.parameters.values).parameters
