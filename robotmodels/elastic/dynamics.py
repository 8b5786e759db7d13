"""Mass and gravity of an elastic arm, by Pinocchio, one call per position.

A joint turns all that it carries, and with it what the joints among that do to the potential:
with L_j = d(sum of m c)/dq_j and w_i the axis of joint i (zero where it slides), which carries j,
g_j = -gravity . L_j and dg_j/dq_i = (w_i x gravity) . L_j. Counterbalances take their torques from
g and their slopes from its diagonal.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from robotmodels.common.arrays import Array
from robotmodels.elastic.arm import Arm

_PART = 64
"""Positions whose matrices stay in the cache."""


@dataclass(frozen=True, eq=False)
class Gravity:
    """Gravity on an arm, less what its counterbalances carry, at Q coordinate vectors.

    Attributes
    ----------
    arm : Arm
        The arm.
    turned : ndarray, (3, Q, D), m/s^2
        w x gravity of each of the D joints.
    moments : ndarray, (3, Q, D)
        L of each joint [kg m], of one that slides [kg].
    balance : ndarray, (2, Q, D), or None
        Torques of the counterbalances on the joints, and their slopes; None without any.
    """

    arm: Arm
    turned: Array
    moments: Array
    balance: Array | None = None

    @cached_property
    def torques(self) -> Array:
        """The gravity torques g, (Q, d) [N m or N]."""
        torques = np.einsum("k,kqd->qd", -self.arm.model.gravity.linear, self.moments)
        if self.balance is not None:
            torques -= self.balance[0]
        reduction = self.arm.coordinate_map
        return np.asarray(torques if reduction is None else torques @ reduction.matrix)

    @property
    def slopes(self) -> Array:
        """The derivatives dg/dq, (Q, d, d), symmetric [N m/rad, N/rad or N/m]."""
        products = self.turned.transpose(1, 2, 0) @ self.moments.transpose(1, 0, 2).copy()
        entries = self.arm.carrier_first
        slopes = products.reshape(-1, entries.size)[:, entries]
        if not self.arm.serial:
            slopes *= (self.arm.carries | self.arm.carries.T).ravel()
        slopes = slopes.reshape(products.shape)
        if self.balance is not None:
            diagonal = np.einsum("qii->qi", slopes)
            diagonal -= self.balance[1]
        reduction = self.arm.coordinate_map
        return np.asarray(slopes if reduction is None else reduction.congruent(slopes))

    def write_slopes(self, out: Array) -> None:
        """Write dg/dq to `out`, (Q, d, d), in parts that stay in the cache."""
        for start in range(0, len(out), _PART):
            part = slice(start, start + _PART)
            balance = None if self.balance is None else self.balance[:, part]
            here = Gravity(self.arm, self.turned[:, part], self.moments[:, part], balance)
            out[part] = here.slopes

    def slopes_times(self, shift: Array) -> Array:
        """Return dg/dq times `shift`, (Q, d), without forming dg/dq."""
        carries, reduction = self.arm.carries, self.arm.coordinate_map
        shift = shift if reduction is None else shift @ reduction.matrix.T
        carried = (self.moments * shift) @ carries.T
        carriers = (self.turned * shift) @ (carries & ~carries.T)
        products = (self.turned * carried + self.moments * carriers).sum(axis=0)
        if self.balance is not None:
            products = products - self.balance[1] * shift
        return np.asarray(products if reduction is None else products @ reduction.matrix)

    @property
    def slope_bounds(self) -> Array:
        """Bounds on the sum of magnitudes in each row of dg/dq, (Q, d)."""
        carries = self.arm.carries
        turned, moments = (np.sqrt((a * a).sum(axis=0)) for a in (self.turned, self.moments))
        bounds = turned * (moments @ carries.T) + moments * (turned @ carries)
        if self.balance is not None:
            bounds = bounds + np.abs(self.balance[1])
        if (reduction := self.arm.coordinate_map) is not None:
            sizes = np.abs(reduction.matrix)
            bounds = bounds @ sizes * sizes.sum(axis=1).max()
        return np.asarray(bounds)


def gravity(arm: Arm, coordinates: Array) -> Gravity:
    """Return gravity at `coordinates` (Q, d) [rad or m]."""
    model, data = arm.model, arm.model.createData()
    joints = arm.joints(coordinates)
    axes, moments = (np.empty((*joints.shape, k)) for k in (6, 3))
    turning, moving = _columns(data.J, 6), _columns(data.Jcom, 3)
    for i, q in enumerate(joints):
        pin.jacobianCenterOfMass(model, data, q)
        axes[i] = turning
        moments[i] = moving
    return _gravity(arm, joints, axes, moments * data.mass[0])


def mass_and_gravity(arm: Arm, coordinates: Array, size: int) -> tuple[Array, Gravity]:
    """Return mass matrices padded with zeros, (Q, size, size), and gravity at `coordinates`."""
    model, data = arm.model, arm.model.createData()
    joints, reduction = arm.joints(coordinates), arm.coordinate_map
    axes, moments = np.empty((2, *joints.shape, 6))
    mass = np.zeros((len(coordinates), size, size))
    arm_mass = mass[:, : arm.size, : arm.size]
    # On the way to the mass matrix, columns of Ag become the momentum of all that a joint moves.
    turning, moving, matrix = (
        _columns(a, k) for a, k in ((data.J, 6), (data.Ag, 6), (data.M, model.nv))
    )
    for i, q in enumerate(joints):
        pin.crba(model, data, q, pin.Convention.WORLD)
        axes[i] = turning
        moments[i] = moving
        arm_mass[i] = matrix if reduction is None else reduction.congruent(matrix)
    return mass, _gravity(arm, joints, axes, moments[..., :3])


def mass_matrices(arm: Arm, coordinates: Array) -> Array:
    """Return the mass matrices (Q, d, d) at `coordinates` (Q, d)."""
    return mass_and_gravity(arm, coordinates, arm.size)[0]


def gravity_torques(arm: Arm, coordinates: Array) -> Array:
    """Return gravity torques g, (Q, d), at `coordinates` (Q, d)."""
    return gravity(arm, coordinates).torques


def _columns(matrix: Array, rows: int) -> Array:
    """Return a view of the columns, one per joint, of what Pinocchio will fill: as they lie."""
    return np.asarray(matrix.T.reshape(-1, rows))  # with one joint, a vector


def _gravity(arm: Arm, joints: Array, axes: Array, moments: Array) -> Gravity:
    """Return gravity from the joints' angles, (Q, D), twists, (Q, D, 6), and L, (Q, D, 3)."""
    gx, gy, gz = arm.model.gravity.linear
    cross = np.array([[0.0, -gz, gy], [gz, 0.0, -gx], [-gy, gx, 0.0]])
    turned = (axes[..., 3:] @ cross).transpose(2, 0, 1)
    balance = np.zeros((2, *joints.shape))
    for item in arm.counterbalances:
        balance[:, :, item.column] += item.law(joints[:, item.column])
    return Gravity(
        arm,
        turned.copy(),
        moments.transpose(2, 0, 1).copy(),
        balance if arm.counterbalances else None,
    )
