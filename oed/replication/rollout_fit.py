"""Springs and dampers of gears by rollouts in time with mujoco.sysid: a peer of fits of FRFs.

The recorded torques are replayed from standstill and the motors' angles fitted by Gauss-Newton.
Residuals are divided by the encoders' noise: divided by the size of the angles, as by default, they
are so small that mujoco.sysid's tolerances end the search far from the minimum.
"""

import io
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import mujoco
import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.description.parameters import Parameters
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.simulation.mujoco_model import PlantBuilder
from robotmodels.simulation.urdf_tree import read_tree


@dataclass(frozen=True, eq=False)
class RolloutCase:
    """Records of a robot in one position, and the model whose rollouts are to be like them.

    Attributes
    ----------
    xml : str
        XML of MuJoCo's model.
    motors : tuple of str
        The coordinate that each of n motors drives.
    ratios : ndarray, (n,)
        Its gear ratio.
    rest_angles : tuple of tuple of (str, float), (name, angle), rad
        Initial angle of every coordinate that a position sets.
    tendons : dict of str to str
        The tendon of each drive spring, by the spring's name.
    parameters : Parameters
        The drive springs' and dampers', at the values about which they are sought.
    torque, angle : ndarray, (E, K, n)
        Of E runs of K samples, motor shafts [N m, rad].
    sample_time : float, s
        Sample time.
    angle_noise : float, rad
        Standard deviation of the angles.
    """

    xml: str
    motors: tuple[str, ...]
    ratios: Array
    rest_angles: tuple[tuple[str, float], ...]
    tendons: dict[str, str]
    parameters: Parameters
    torque: Array
    angle: Array
    sample_time: float
    angle_noise: float


@dataclass(frozen=True, eq=False)
class RolloutFit:
    """Where a fit of rollouts ended.

    Attributes
    ----------
    values : ndarray, (p,)
        SI.
    ended : bool
        Whether by its tolerances, rather than by the limit of rollouts.
    rollouts : int
        Rollouts of all runs.
    seconds : float
        Seconds of wall time.
    """

    values: Array
    ended: bool
    rollouts: int
    seconds: float


def missing() -> str:
    """Return which module mujoco.sysid lacks; nothing if it can be used."""
    try:
        for name in ("optimize", "parameter", "residual", "trajectory", "timeseries"):
            import_module(f"mujoco.sysid._src.{name}")
    except ImportError as error:
        return error.name or str(error)
    return ""


def rollout_case(
    robot: ElasticRobot,
    position: Array,
    torque: Array,
    angle: Array,
    sample_time: float,
    angle_noise: float,
) -> RolloutCase:
    """Return the case of a robot whose free parameters are drive springs and dampers.

    Parameters
    ----------
    position : ndarray, (n,), rad
        Initial position.
    torque : ndarray
        See `RolloutCase`.
    angle : ndarray
        See `RolloutCase`.
    sample_time : float
        See `RolloutCase`.
    angle_noise : float
        See `RolloutCase`.
    """
    file = robot.file
    builder = PlantBuilder(file, read_tree(robot.model_file))
    builder.compile()
    motors = tuple(m.name if m.joint in builder.drives else m.joint for m in file.motors)
    at = {**dict(zip(motors, position, strict=True)), **dict(_joints(robot, position))}
    return RolloutCase(
        xml=builder.spec.to_xml(),
        motors=motors,
        ratios=np.array([m.gear_ratio for m in file.motors]),
        rest_angles=tuple((name, float(value)) for name, value in at.items()),
        tendons={s.name: str(s.joint) for s in file.springs if s.axis == "drive"},
        parameters=robot.parameters,
        torque=torque,
        angle=angle,
        sample_time=sample_time,
        angle_noise=angle_noise,
    )


def fit_rollouts(case: RolloutCase, start: Array, reach: float, limit: int) -> RolloutFit:
    """Return the fit of rollouts from one start.

    Parameters
    ----------
    start : ndarray, (p,)
        SI.
    reach : float
        Decades about the case's parameters between which values are sought.
    limit : int
        Limit of rollouts of all runs, after which the best so far is taken.
    """
    search = _parameters(case, start, reach)
    with _silent():
        residual, begun = _Residual(case, limit, search.as_vector()), time.perf_counter()
        try:
            optimum, _ = _sysid().optimize(search, residual, verbose=False, max_iters=limit)
            ln, ended = optimum.as_vector(), True
        except _EnoughError:
            ln, ended = residual.best, False
        seconds = time.perf_counter() - begun
    values = np.asarray(case.parameters.values * np.exp(ln))
    return RolloutFit(values, ended, residual.rollouts, seconds)


def misfit(case: RolloutCase, values: Array) -> float:
    """Return the rms of rollouts minus records at parameter `values` (p,), in stds of the noise."""
    search = _parameters(case, values, 1.0)
    at = search.as_vector()
    with _silent():
        residuals, _, _ = _Residual(case, 1, at)(at, search)
    return float(np.sqrt(np.mean(np.concatenate(residuals) ** 2)))


@contextmanager
def _silent() -> Iterator[None]:
    """Let nothing be told of a model without sensors and of every iteration."""
    log = logging.getLogger("absl")
    before = log.level
    log.setLevel(logging.ERROR)
    try:
        with redirect_stdout(io.StringIO()):
            yield
    finally:
        log.setLevel(before)


def _sysid() -> Any:
    """Return mujoco.sysid, whose import takes seconds."""
    return import_module("mujoco.sysid")


def _joints(robot: ElasticRobot, position: Array) -> list[tuple[str, float]]:
    return list(zip(robot.motor_joints, position, strict=True))


class _EnoughError(Exception):
    """The limit of rollouts is reached."""


class _Residual:
    """Rollouts minus records, counted; remembers the best of the start and the points asked for."""

    def __init__(self, case: RolloutCase, limit: int, start: Array) -> None:
        self.ask = _sysid().build_residual_fn(
            models_sequences=[_sequences(case)], modify_residual=_standardised(case)
        )
        self.limit, self.rollouts, self.least = limit, 0, np.inf
        self.best = np.array(start, dtype=float)

    def __call__(self, x: Array, parameters: Any) -> Any:
        points = 1 if np.ndim(x) < 2 else np.shape(x)[1]
        if self.rollouts + points > self.limit:
            raise _EnoughError
        self.rollouts += points
        residuals = self.ask(x, parameters)
        if points == 1:
            cost = float(sum(np.sum(np.square(part)) for part in residuals[0]))
            if cost < self.least:
                self.least, self.best = cost, np.array(x, dtype=float).ravel()
        return residuals


def _sequences(case: RolloutCase) -> Any:
    """Return model, torques and angles as mujoco.sysid wants them."""
    sysid = _sysid()
    spec = mujoco.MjSpec.from_string(case.xml)
    spec.option.timestep = case.sample_time
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    for motor, ratio in zip(case.motors, case.ratios, strict=True):
        actuator = spec.add_actuator(
            name=f"torque {motor}", target=motor, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        actuator.gear = [ratio, 0, 0, 0, 0, 0]
    model = spec.compile()
    rest_angles = np.zeros(model.nq)
    for name, angle in case.rest_angles:
        rest_angles[model.joint(name).qposadr[0]] = angle
    times = case.sample_time * np.arange(case.torque.shape[1])
    mapping = {
        f"{motor}_qpos": (sysid.SignalType.MjStateQPos, np.array([i]))
        for i, motor in enumerate(case.motors)
    }
    count = len(case.torque)
    return sysid.ModelSequences(
        "robot",
        spec,
        [f"run {i}" for i in range(count)],
        [sysid.create_initial_state(model, rest_angles)] * count,
        [sysid.TimeSeries(times, torque) for torque in case.torque],
        [sysid.TimeSeries(times, angle / case.ratios, mapping) for angle in case.angle],
        allow_missing_sensors=True,
    )


def _standardised(case: RolloutCase) -> Callable[..., tuple[Array, Any, Any]]:
    """Return a function that compares angles after each step with those measured then."""
    std = case.angle_noise / np.abs(case.ratios)

    def residual(
        params: Any, predicted: Any, measured: Any, model: Any, return_all: bool, state: Array
    ) -> tuple[Array, Any, Any]:
        at = [1 + int(model.joint(name).qposadr[0]) for name in case.motors]
        residuals = (state[:-1, at] - measured.data[1 : len(state)]) / std
        return residuals, measured, measured

    return residual


def _parameters(case: RolloutCase, start: Array, reach: float) -> Any:
    """Return ln(theta/case's) as mujoco.sysid's parameters, at a start."""
    sysid = _sysid()
    search, bound = sysid.ParameterDict(), reach * np.log(10)
    nominal = case.parameters
    for name, reference, value in zip(nominal.names, nominal.values, start, strict=True):
        spring, kind = name.split(".")

        def modify(
            spec: Any,
            parameter: Any,
            tendon: str = case.tendons[spring],
            kind: str = kind,
            reference: float = reference,
        ) -> None:
            setattr(spec.tendon(tendon), kind, [reference * np.exp(parameter.value[0]), 0.0, 0.0])

        search.add(sysid.Parameter(name, 0.0, -bound, bound, modifier=modify))
        search[name].value[:] = np.log(value / reference)
    return search
