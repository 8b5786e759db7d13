"""An elastic robot in MuJoCo, made from the robot file and the URDF alone.

An independent judge of `robotmodels`: it shares the schema of the robot file and the builder of
the simulated plant, and nothing else.
Rigid-body terms come from MuJoCo, everything else from a few plain formulas:

- motors behind a drive spring are balls on their own hinges beside the arm,
- derivatives of gravity are finite differences,
- responses are dense solves of (M, D, K).
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from robotmodels.description.robot_file import Hardening, RobotFile
from robotmodels.simulation.mujoco_model import PlantBuilder
from robotmodels.simulation.urdf_tree import read_tree


@dataclass(frozen=True, eq=False)
class MujocoArm:
    """The robot of `file`, with the URDF at `urdf`."""

    file: RobotFile
    urdf: Path

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The compiled model; its joints are the drives, the torsions and the elastic motors."""
        return PlantBuilder(self.file, read_tree(self.urdf), fuse=False).compile()

    @cached_property
    def data(self) -> mujoco.MjData:
        """MuJoCo's working memory."""
        return mujoco.MjData(self.model)

    @cached_property
    def _slopes(self) -> dict[bytes, np.ndarray]:
        """Gravity's derivatives found so far, by coordinates; dampers move none of these."""
        return {}

    @cached_property
    def names(self) -> list[str]:
        """Names of the coordinates."""
        return [self.model.joint(i).name for i in range(self.model.njnt)]

    def order(self, names: tuple[str, ...]) -> np.ndarray:
        """Return where the coordinates `names` are in this model."""
        assert sorted(names) == sorted(self.names)
        return np.array([self.names.index(name) for name in names])

    def mass(self, q: np.ndarray) -> np.ndarray:
        """Return the mass matrix, motors included."""
        self._at(q)
        mujoco.mj_makeM(self.model, self.data)
        dense = np.eye(self.model.nv)
        for column in dense:  # mj_fullM takes other arguments before MuJoCo 3.8
            mujoco.mj_mulM(self.model, self.data, column, column.copy())
        return dense

    def gravity(self, q: np.ndarray) -> np.ndarray:
        """Return the generalised torques that hold the arm against gravity."""
        self._at(q)
        bias = np.zeros(self.model.nv)
        mujoco.mj_rne(self.model, self.data, 0, bias)  # at rest: gravity alone
        return bias

    def gravity_stiffness(self, q: np.ndarray) -> np.ndarray:
        """Return dg/dq by central differences of fourth order."""
        if (known := self._slopes.get(q.tobytes())) is not None:
            return known
        h = 1e-3
        columns = []
        for e in h * np.eye(len(q)):
            near = self.gravity(q + e) - self.gravity(q - e)
            far = self.gravity(q + 2 * e) - self.gravity(q - 2 * e)
            columns.append((8 * near - far) / (12 * h))
        return self._slopes.setdefault(q.tobytes(), np.array(columns).T)

    def _at(self, q: np.ndarray) -> None:
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)

    # Springs and motors

    def elongations(self) -> np.ndarray:
        """Return each spring's elongation per coordinate, (s, d)."""
        motor = {m.joint: m.name for m in self.file.motors}
        a = np.zeros((len(self.file.springs), self.model.nv))
        for row, spring in zip(a, self.file.springs, strict=True):
            if spring.axis == "drive":
                row[self.names.index(spring.joint)] = 1.0
                if spring.joint in motor:
                    row[self.names.index(motor[spring.joint])] = -1.0
            else:
                row[self.names.index(spring.name)] = 1.0
        return a

    def held(self) -> np.ndarray:
        """Return the coordinates that motors hold: their own, or joints that they drive rigidly."""
        return np.array([self.names.index(name) for name in self._motor_coordinates()])

    def _motor_coordinates(self) -> list[str]:
        return [m.name if m.name in self.names else m.joint for m in self.file.motors]

    def rest(self, position: np.ndarray) -> np.ndarray:
        """Return the coordinates with unloaded springs."""
        q = np.zeros(self.model.nv)
        for motor, angle in zip(self.file.motors, position, strict=True):
            q[self.names.index(motor.joint)] = angle
        q[self.held()] = position
        return q

    def equilibrium(self, position: np.ndarray, factors: dict[str, float]) -> np.ndarray:
        """Return the coordinates where springs and gravity balance, motors standing still."""
        q = self.rest(position)
        free = np.setdiff1d(np.arange(len(q)), self.held())
        a = self.elongations()
        # That of the unloaded arm will do: Newton's steps stay nearly exact.
        by_q = self.gravity_stiffness(q)
        for _ in range(50):
            force, slope = self._springs(a @ q, factors)
            K = by_q + a.T @ np.diag(slope) @ a
            step = np.linalg.solve(K[np.ix_(free, free)], (self.gravity(q) + a.T @ force)[free])
            q[free] -= step
            if np.abs(step).max(initial=0.0) < 1e-12:
                return q
        raise AssertionError("MuJoCo's equilibrium did not converge")

    def _springs(
        self, elongation: np.ndarray, factors: dict[str, float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return torques and slopes; `factors` multiply the file's numbers, by name."""
        torque, slope = np.zeros_like(elongation), np.zeros_like(elongation)
        for i, spring in enumerate(self.file.springs):
            k, x = spring.stiffness, elongation[i]
            if isinstance(k, Hardening):
                low = k.low * factors.get(f"{spring.name}.stiffness.low", 1.0)
                high = k.high * factors.get(f"{spring.name}.stiffness.high", 1.0)
                kappa = (high - low) / (3 * (3 * k.torque / (2 * low + high)) ** 2)
                torque[i], slope[i] = low * x + kappa * x**3, low + 3 * kappa * x**2
            else:
                slope[i] = k * factors.get(f"{spring.name}.stiffness", 1.0)
                torque[i] = slope[i] * x
        return torque, slope

    # Linear model

    def linear_model(
        self, position: np.ndarray, factors: dict[str, float], *, gravity_shift: bool = True
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return mass, damping, stiffness, selector; unloaded without `gravity_shift`."""
        q = self.equilibrium(position, factors) if gravity_shift else self.rest(position)
        a = self.elongations()
        slope = self._springs(a @ q, factors)[1]
        c = [s.damping * factors.get(f"{s.name}.damping", 1.0) for s in self.file.springs]
        damping = a.T @ np.diag(c) @ a
        selector = np.zeros((len(q), len(self.file.motors)))
        for j, (motor, i) in enumerate(zip(self.file.motors, self.held(), strict=True)):
            damping[i, i] += motor.viscous * motor.gear_ratio**2
            selector[i, j] = motor.gear_ratio
        stiffness = self.gravity_stiffness(q) + a.T @ np.diag(slope) @ a
        return self.mass(q), damping, stiffness, selector

    def frequency_response(
        self,
        positions: np.ndarray,
        omega: np.ndarray,
        factors: dict[str, float] | None = None,
        *,
        gravity_shift: bool = True,
    ) -> np.ndarray:
        """Return G, (Q, F, m, n): motor torque to motor and sensor accelerations, dense solves."""
        response = []
        for position in positions:
            M, D, K, S = self.linear_model(position, factors or {}, gravity_shift=gravity_shift)
            tilt, acceleration = self._sensors(position, factors or {})
            w = np.asarray(omega)[:, None, None]
            X = np.linalg.solve(K - w**2 * M + 1j * w * D, np.broadcast_to(S, (len(w), *S.shape)))
            outputs = [-(w**2) * (S.T @ X), (tilt - w**2 * acceleration) @ X]
            late = np.exp(-1j * w * self.file.delay)
            response.append(late * np.concatenate(outputs, axis=1))
        return np.array(response)

    def _sensors(
        self, position: np.ndarray, factors: dict[str, float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return what a tilt and an acceleration add to the accelerometers, by coordinate."""
        if not self.file.accelerometers:
            return np.zeros((2, 0, self.model.nv))
        q, h = self.equilibrium(position, factors), 1e-5
        still = np.zeros_like(q)
        tilt = [
            (self._readings(q + h * e, still) - self._readings(q - h * e, still)) / (2 * h)
            for e in np.eye(len(q))
        ]
        rest = self._readings(q, still)
        acceleration = [self._readings(q, e) - rest for e in np.eye(len(q))]
        return np.array(tilt).T, np.array(acceleration).T

    def _readings(self, q: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        """Return what the accelerometers read at rest with given joint accelerations."""
        self._at(q)
        mujoco.mj_comVel(self.model, self.data)
        self.data.qacc[:] = acceleration
        mujoco.mj_rnePostConstraint(self.model, self.data)
        mujoco.mj_sensorAcc(self.model, self.data)
        readings = self.data.sensordata.reshape(-1, 3)
        directions = np.array([a.direction for a in self.file.accelerometers])
        directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        return np.einsum("ij,ij->i", readings, directions)
