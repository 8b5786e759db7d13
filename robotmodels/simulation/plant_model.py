"""The compiled robot in MuJoCo: coordinates, mass and forces; what compiled loops call of it."""

import ctypes
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import llvmlite.binding
import mujoco
import numpy as np

from robotmodels.common.arrays import Array, IntArray
from robotmodels.description.model_files import ModelSource
from robotmodels.description.robot_file import RobotFile
from robotmodels.elastic.coordinate_map import CoordinateMap, coordinate_map
from robotmodels.simulation.mujoco_model import PlantBuilder
from robotmodels.simulation.urdf_tree import read_tree

_CALLED = (
    "mj_kinematics", "mj_comPos", "mj_tendon", "mj_makeM", "mj_factorM", "mj_fwdVelocity",
    "mj_comVel", "mj_rne", "mj_solveM", "mju_cholFactor", "mju_cholSolve",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class PlantModel:
    """A compiled model whose joints are the drives, the torsions and the elastic motors.

    Attributes
    ----------
    model : mujoco.MjModel
        MuJoCo's model.
    data : mujoco.MjData
        Its working memory.
    motors : ndarray of int, (n,)
        Coordinate of each motor: its shaft, or the joint that it drives rigidly.
    gears : ndarray of int, (n,)
        Tendon of each motor; -1 where the drive is rigid.
    independent : ndarray of int
        Coordinates that follow no other.
    coordinate_map : CoordinateMap
        From them to all d.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    motors: IntArray
    gears: IntArray
    independent: IntArray
    coordinate_map: CoordinateMap

    @property
    def constraints(self) -> Array:
        """Rows J, one for each follower, with J dq = 0, (f, d)."""
        rows = np.eye(self.model.nv)
        rows[:, self.independent] -= self.coordinate_map.matrix
        return np.delete(rows, self.independent, axis=0)

    @property
    def names(self) -> list[str]:
        """Names of the coordinates."""
        return [self.model.joint(i).name for i in range(self.model.njnt)]

    def coordinate(self, name: str) -> int:
        """Return the index of a joint, torsion or elastic motor among the coordinates."""
        return int(self.model.joint(name).qposadr[0])

    def mass(self, coordinates: Array) -> Array:
        """Return the mass matrix, motors included, (d, d)."""
        self.data.qpos[:] = coordinates
        mujoco.mj_forward(self.model, self.data)
        return self._mass()

    def _mass(self) -> Array:
        dense = np.eye(self.model.nv)
        for column in dense:  # mj_fullM takes other arguments before MuJoCo 3.8
            mujoco.mj_mulM(self.model, self.data, column, column.copy())
        return dense

    def obey_couplings(self) -> None:
        """Correct accelerations for joints that follow others, and sensors by them (Gauss)."""
        if len(self.independent) == self.model.nv:
            return
        T, M = self.coordinate_map.matrix, self._mass()
        free = np.linalg.solve(self.coordinate_map.congruent(M), T.T @ (M @ self.data.qacc))
        self.data.qacc[:] = T @ free
        mujoco.mj_rnePostConstraint(self.model, self.data)
        mujoco.mj_sensorAcc(self.model, self.data)

    def mobility(self, coordinates: Array, forces: Array) -> Array:
        """Return the accelerations, (d, n), by `forces`, (d, n), without any others."""
        T = self.coordinate_map.matrix
        mass = self.coordinate_map.congruent(self.mass(coordinates))
        return np.asarray(T @ np.linalg.solve(mass, T.T @ forces))

    def static_forces(self, coordinates: Array) -> Array:
        """Return the forces of springs and gravity at rest, (d,)."""
        self.data.qpos[:] = coordinates
        self.data.qvel[:] = 0.0
        self.data.qfrc_applied[:] = 0.0
        mujoco.mj_forward(self.model, self.data)
        return np.asarray(self.data.qfrc_passive - self.data.qfrc_bias)


def build_plant(file: RobotFile, urdf: ModelSource) -> PlantModel:
    """Return the robot with all springs, dampers and viscous friction of its file."""
    builder = PlantBuilder(file, read_tree(urdf))
    model = builder.compile()
    names = [model.joint(i).name for i in range(model.njnt)]
    tendons = [model.tendon(i).name for i in range(model.ntendon)]
    joint_names = [m.name if m.name in names else m.joint for m in file.motors]
    gears = [tendons.index(m.joint) if m.joint in tendons else -1 for m in file.motors]
    where = [int(model.joint(name).qposadr[0]) for name in joint_names]
    columns, reduction = coordinate_map(names, builder.couplings)
    independent = np.array([names.index(name) for name in columns])
    if reduction is None:
        reduction = CoordinateMap(np.eye(len(names)), np.zeros(len(names)))
    data = mujoco.MjData(model)
    return PlantModel(model, data, np.array(where), np.array(gears), independent, reduction)


@cache
def register_mujoco() -> None:
    """Tell numba's linker where MuJoCo's functions are, so that compiled loops can call them."""
    folder = Path(mujoco.__file__).parent
    pattern = "*mujoco*.[ds][lyo]*"  # .so, .dylib, .dll
    (library,) = [p for p in folder.glob(pattern) if p.suffix != ".py" and p.is_file()]
    loaded = ctypes.CDLL(str(library))
    for name in _CALLED:
        address = ctypes.cast(getattr(loaded, name), ctypes.c_void_p).value
        llvmlite.binding.add_symbol(name, address)


def addresses(plant: PlantModel) -> tuple[int, int]:
    """Return where MuJoCo's model and data are in memory."""
    return int(plant.model._address), int(plant.data._address)
