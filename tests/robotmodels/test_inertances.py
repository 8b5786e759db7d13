"""Free motor inertias: in the network, in its sensitivities and on the kernel's fast path."""

from dataclasses import replace

import numpy as np
import pytest
from derivatives import apart, frf_derivatives, information_of

import robotmodels
from robotmodels import kernel
from robotmodels.common.errors import InvalidInput
from robotmodels.linear.noise import RelativeNoise

OMEGA = 2 * np.pi * np.linspace(3, 60, 9)


@pytest.fixture(name="manutec", scope="module")
def _manutec():
    return robotmodels.load_robot("manutec_r3_26")


def _positions(robot, count=2):
    low, high = np.clip(robot.position_limits, -1.5, 1.5).T
    return np.random.default_rng(0).uniform(low, high, (count, len(low)))


def _with(robot, **choice):
    """Return `robot` with other free parameters."""
    parameters = robot.file.parameters.model_copy(update=choice)
    return replace(robot, file=robot.file.model_copy(update={"parameters": parameters}))


def test_the_network_without_free_inertias_is_the_same_model(manutec):
    positions = _positions(manutec)
    fixed = _with(manutec, extra=[]).network(positions).linear_model()
    free = manutec.network(positions)
    assert free.inertances is not None
    assert free.only_springs
    for name in ("mass", "damping", "stiffness"):
        found = getattr(free.linear_model(), name)
        np.testing.assert_allclose(found, getattr(fixed, name), rtol=1e-14, atol=1e-12)


@pytest.mark.parametrize(
    "choice",
    [
        {"extra": ["m1.inertia", "m2.inertia"]},
        {"extra": ["m1.viscous", "m3.inertia", "m3.viscous"]},
        {"extra": ["m1.inertia", "m2.inertia"], "tied": [["m1.inertia", "m2.inertia"]]},
        {"extra": ["m1.inertia", "payload.mass"], "tied": [["m1.inertia", "payload.mass"]]},
        {"extra": ["m2.inertia", "m1.torque_gain"]},
    ],
)
def test_sensitivities_are_exact_and_count_nothing_twice(manutec, choice):
    robot = _with(manutec, **choice)
    positions = _positions(robot, 1)
    _, J = robotmodels.sensitivity(robot, positions, OMEGA)
    expected = frf_derivatives(robot, positions, OMEGA)
    size = np.abs(expected).max(axis=(0, 1, 2, 3))
    assert np.max(np.abs(J - expected) / size) < 1e-6


def test_a_rigid_drive_may_have_a_free_inertia():
    robot = _with(robotmodels.load_robot("manutec_r3"), extra=["m5.inertia", "m5.viscous"])
    assert robot.elements.inertial_names == (robot.motor_names[4],)
    positions = _positions(robot, 2)
    G, J = robotmodels.sensitivity(robot, positions, OMEGA, equilibrium_shift=False)
    size = np.abs(J).max(axis=(0, 1, 2, 3))
    found = frf_derivatives(robot, positions, OMEGA)[..., -2:]
    assert np.max(np.abs(J[..., -2:] - found) / size[-2:]) < 1e-6
    _check_information(robot, positions, G, J)


def test_information_takes_the_fast_path(manutec):
    positions = _positions(manutec)
    assert manutec.tangents(positions, equilibrium_shift=False) is None
    G, J = robotmodels.sensitivity(manutec, positions, OMEGA, equilibrium_shift=False)
    _check_information(manutec, positions, G, J)


def _check_information(robot, positions, G, J):
    noise = RelativeNoise()
    found = kernel.information(robot.network(positions), OMEGA, noise)
    assert apart(found, information_of(J, noise.variance(G))) < 1e-9


@pytest.mark.parametrize(
    ("choice", "names"),
    [
        ({"extra": ["payload.mass"]}, "payload.mass"),
        ({"extra": ["m1.torque_gain", "m1.inertia"]}, "m1.torque_gain"),
        (
            {"extra": ["m1.inertia", "payload.mass"], "tied": [["m1.inertia", "payload.mass"]]},
            "m1.inertia",
        ),
    ],
)
def test_the_kernel_refuses_what_it_does_not_know(manutec, choice, names):
    network = _with(manutec, **choice).network(_positions(manutec, 1))
    assert not network.only_springs
    with pytest.raises(InvalidInput, match=f"free parameters {names}: the kernel supports"):
        kernel.information(network, OMEGA, RelativeNoise())
    G = network.frequency_response(OMEGA)
    with pytest.raises(InvalidInput, match=f"free parameters {names}: the kernel supports"):
        kernel.CostKernel(network, OMEGA, G, np.ones(G.shape))
