"""An exported MJCF file in plain MuJoCo: its equilibria and frequency responses.

Nothing of the packages is used; differences of forces give stiffness, damping and inputs.
"""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
from scipy.linalg import null_space


class ReloadedMjcf:
    """The model of a file, without friction, which has no linear response."""

    def __init__(self, path: Path) -> None:
        self.model = mujoco.MjModel.from_xml_path(str(path))
        self.data = mujoco.MjData(self.model)
        self.map, self.offset = self._constrained()
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self.shafts = self.model.jnt_dofadr[self.model.actuator_trnid[:, 0]]

    def _constrained(self) -> tuple[np.ndarray, np.ndarray]:
        """Return T and c of q = T r + c, which satisfies MuJoCo's equality constraints."""
        model, data = self.model, mujoco.MjData(self.model)
        mujoco.mj_forward(model, data)
        J = np.zeros((data.ne, model.nv))
        for row, unit in zip(J, np.eye(data.nefc), strict=False):
            mujoco.mj_mulJacTVec(model, data, row, unit)
        free = null_space(J) if data.ne else np.eye(model.nv)
        followers = model.jnt_dofadr[model.eq_obj1id]
        independent = np.setdiff1d(np.arange(model.nv), followers)
        T, c = free @ np.linalg.inv(free[independent]), np.zeros(model.nv)
        c[followers] = np.linalg.solve(J[:, followers], -data.efc_pos[: data.ne])
        return T, c

    def forces(self, q: np.ndarray, v: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return all generalised forces but inertia's, at the independent coordinates."""
        self.data.qpos[:], self.data.qvel[:], self.data.ctrl[:] = q, v, u
        mujoco.mj_forward(self.model, self.data)
        forces = self.data.qfrc_passive + self.data.qfrc_actuator - self.data.qfrc_bias
        return np.asarray(self.map.T @ forces)

    def equilibrium(self, motors: np.ndarray, joints: list[str]) -> np.ndarray:
        """Return the coordinates at rest with motors standing still, from unloaded springs on."""
        r, driven = np.zeros(self.map.shape[1]), self.map[self.shafts].argmax(axis=1)
        r[self.map[[self.model.joint(name).dofadr[0] for name in joints]].argmax(axis=1)] = motors
        r[driven] = motors
        free = np.setdiff1d(np.arange(len(r)), driven)
        still = np.zeros(self.model.nv), np.zeros(self.model.nu)
        for _ in range(30):
            K = -differences(lambda x: self.forces(self.map @ x + self.offset, *still), r, 1e-4)
            loads = self.forces(self.map @ r + self.offset, *still)
            step = np.linalg.solve(K[np.ix_(free, free)], loads[free])
            r[free] += step
            if np.abs(step).max() < 1e-13:
                return np.asarray(self.map @ r + self.offset)
        raise AssertionError("no equilibrium")

    def response(self, q: np.ndarray, omega: np.ndarray, directions: int) -> np.ndarray:
        """Return commanded torques to shaft accelerations and accelerometers, (F, m, n)."""
        T, still, off = self.map, np.zeros(self.model.nv), np.zeros(self.model.nu)
        rest = np.zeros(T.shape[1])
        K = -differences(lambda x: self.forces(q + T @ x, still, off), rest, 1e-3)
        D = -differences(lambda x: self.forces(q, T @ x, off), rest, 1e-3)
        S = differences(lambda x: self.forces(q, still, x), off, 1.0)
        self.forces(q, still, off)
        M = np.eye(self.model.nv)
        for column in M:  # mj_fullM takes other arguments before MuJoCo 3.8
            mujoco.mj_mulM(self.model, self.data, column, column.copy())
        M = T.T @ M @ T
        gear = self.model.actuator_gear[:, :1]
        C = gear * T[self.shafts]
        tilt = differences(lambda x: self._readings(q + T @ x, still), rest, 1e-3)[:directions]
        acceleration = differences(lambda x: self._readings(q, T @ x), rest, 1.0)[:directions]
        w = omega[:, None, None]
        X = np.linalg.solve(K - w**2 * M + 1j * w * D, np.broadcast_to(S, (len(w), *S.shape)))
        return np.concatenate([-(w**2) * (C @ X), (tilt - w**2 * acceleration) @ X], axis=1)

    def _readings(self, q: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        """Return the third number of each accelerometer, at rest with accelerations of joints."""
        self.data.qpos[:], self.data.qvel[:], self.data.ctrl[:] = q, 0.0, 0.0
        mujoco.mj_fwdPosition(self.model, self.data)
        mujoco.mj_fwdVelocity(self.model, self.data)
        self.data.qacc[:] = acceleration
        mujoco.mj_rnePostConstraint(self.model, self.data)
        mujoco.mj_sensorAcc(self.model, self.data)
        kinds = self.model.sensor_type == mujoco.mjtSensor.mjSENS_ACCELEROMETER
        return self.data.sensordata[self.model.sensor_adr[kinds] + 2].copy()


def differences(
    function: Callable[[np.ndarray], np.ndarray], x: np.ndarray, h: float
) -> np.ndarray:
    """Return the Jacobian by central differences of fourth order, exact for cubics."""
    columns = []
    for e in h * np.eye(len(x)):
        near = function(x + e) - function(x - e)
        far = function(x + 2 * e) - function(x - 2 * e)
        columns.append((8 * near - far) / (12 * h))
    return np.array(columns).T
