"""An exported MJCF file in plain MuJoCo: its equilibria and frequency responses.

Nothing of the packages is used; differences of forces give stiffness, damping and inputs.
"""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np


class ReloadedMjcf:
    """The model of a file, without friction, which has no linear response."""

    def __init__(self, path: Path) -> None:
        self.model = mujoco.MjModel.from_xml_path(str(path))
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self.data = mujoco.MjData(self.model)
        self.shafts = self.model.jnt_dofadr[self.model.actuator_trnid[:, 0]]

    def forces(self, q: np.ndarray, v: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return all generalised forces but inertia's."""
        self.data.qpos[:], self.data.qvel[:], self.data.ctrl[:] = q, v, u
        mujoco.mj_forward(self.model, self.data)
        return self.data.qfrc_passive + self.data.qfrc_actuator - self.data.qfrc_bias

    def equilibrium(self, motors: np.ndarray, joints: list[str]) -> np.ndarray:
        """Return the coordinates at rest with motors standing still, from unloaded springs on."""
        q = np.zeros(self.model.nv)
        q[[self.model.joint(name).dofadr[0] for name in joints]] = motors
        q[self.shafts] = motors
        free = np.setdiff1d(np.arange(len(q)), self.shafts)
        still = np.zeros_like(q), np.zeros(self.model.nu)
        for _ in range(30):
            K = -differences(lambda x: self.forces(x, *still), q, 1e-4)
            step = np.linalg.solve(K[np.ix_(free, free)], self.forces(q, *still)[free])
            q[free] += step
            if np.abs(step).max() < 1e-13:
                return q
        raise AssertionError("no equilibrium")

    def response(self, q: np.ndarray, omega: np.ndarray, directions: int) -> np.ndarray:
        """Return commanded torques to shaft accelerations and accelerometers, (F, m, n)."""
        still, off = np.zeros(self.model.nv), np.zeros(self.model.nu)
        K = -differences(lambda x: self.forces(x, still, off), q, 1e-3)
        D = -differences(lambda x: self.forces(q, x, off), still, 1e-3)
        S = differences(lambda x: self.forces(q, still, x), off, 1.0)
        self.forces(q, still, off)
        M = np.eye(self.model.nv)
        for column in M:  # mj_fullM takes other arguments before MuJoCo 3.8
            mujoco.mj_mulM(self.model, self.data, column, column.copy())
        gear = self.model.actuator_gear[:, :1]
        C = gear * np.eye(self.model.nv)[self.shafts]
        tilt = differences(lambda x: self._readings(x, still), q, 1e-3)[:directions]
        acceleration = differences(lambda x: self._readings(q, x), still, 1.0)[:directions]
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
