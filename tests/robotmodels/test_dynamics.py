"""Mass and gravity in one call against Pinocchio's own functions, and products against matrices."""

import numpy as np
import pinocchio as pin
import pytest
from robots import CRANE, PENDULUM, SPLIT, WALL, built

from robotmodels.elastic.arm import Arm
from robotmodels.elastic.dynamics import gravity, gravity_torques, mass_and_gravity


def branched() -> Arm:
    """Return two branches of turning and sliding joints with random bodies, gravity aslant."""
    pin.seed(1)
    model = pin.Model()
    model.gravity.linear = np.array([1.0, -2.0, -9.0])
    kinds = [pin.JointModelRZ, pin.JointModelPX, pin.JointModelRY, pin.JointModelPZ] * 2
    for i, kind in enumerate(kinds):
        parent = {0: 0, 4: 2}.get(i, i)  # the second half starts in the middle of the first
        joint = model.addJoint(parent, kind(), pin.SE3.Random(), f"j{i}")
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Random())
    return Arm(model, {f"j{i}": i for i in range(len(kinds))}, ())


ARMS = {c["name"]: built(c).arm for c in (CRANE, PENDULUM, SPLIT, WALL)} | {"branched": branched()}


@pytest.mark.parametrize("name", ARMS)
def test_mass_and_gravity_are_those_of_pinocchio(name: str) -> None:
    arm = ARMS[name]
    model, data = arm.model, arm.model.createData()
    q = np.random.default_rng(0).uniform(-2, 2, (5, model.nv))
    mass, load = mass_and_gravity(arm, q, model.nv + 2)
    assert not mass[:, model.nv :].any()
    assert not mass[:, :, model.nv :].any()
    for i, at in enumerate(q):
        expected = np.reshape(pin.crba(model, data, at), (model.nv, model.nv))
        np.testing.assert_allclose(mass[i, : model.nv, : model.nv], expected, rtol=0, atol=1e-11)
        slopes = np.reshape(
            pin.computeGeneralizedGravityDerivatives(model, data, at), (model.nv, model.nv)
        )
        np.testing.assert_allclose(load.slopes[i], slopes, rtol=0, atol=1e-10)
        torques = np.reshape(pin.computeGeneralizedGravity(model, data, at), -1)
        np.testing.assert_allclose(load.torques[i], torques, rtol=0, atol=1e-10)
    np.testing.assert_allclose(gravity_torques(arm, q), load.torques, rtol=0, atol=1e-10)
    np.testing.assert_allclose(gravity(arm, q).slopes, load.slopes, rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", ARMS)
def test_products_and_bounds_are_those_of_the_matrix(name: str) -> None:
    arm = ARMS[name]
    rng = np.random.default_rng(1)
    load = gravity(arm, rng.uniform(-2, 2, (5, arm.model.nv)))
    shift = rng.normal(size=(5, arm.model.nv))
    expected = np.einsum("qij,qj->qi", load.slopes, shift)
    np.testing.assert_allclose(load.slopes_times(shift), expected, rtol=0, atol=1e-10)
    rows = np.abs(load.slopes).sum(axis=2)
    assert np.all(load.slope_bounds >= rows - 1e-10)


def test_slopes_are_written_part_by_part() -> None:
    arm = ARMS[PENDULUM["name"]]
    load = gravity(arm, np.linspace(-2, 2, 150)[:, None])
    out = np.zeros((150, 3, 3))
    load.write_slopes(out[:, 1:2, 1:2])
    np.testing.assert_array_equal(out[:, 1:2, 1:2], load.slopes)
    assert np.count_nonzero(out) == np.count_nonzero(load.slopes)


def test_an_arm_is_serial_unless_it_branches() -> None:
    assert ARMS[SPLIT["name"]].serial
    assert not ARMS["branched"].serial
