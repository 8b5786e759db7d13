"""Files for a controller, read back and checked before anybody may play them."""

import csv
import shutil
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from oed.experiment.experiment_plan import ExperimentPlan
from oed.experiment.limits import UNITS, Limits
from oed.experiment.loop_settings import Format, LoopSettings
from oed.experiment.plan_export import export_csv, export_mat, export_trajectory
from oed.experiment.predicted_peaks import START
from oed.experiment.prepare import controller_of, friction_of, gear_ratios, limits_of
from oed.experiment.trajectory_bag import read_trajectories
from oed.experiment.trajectory_check import Trajectory, TrajectoryCheck
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array
from robotmodels.common.atomic_files import write_text
from robotmodels.common.errors import InvalidInput
from robotmodels.data_files.file_guard import library_errors
from robotmodels.elastic.rigid_pose import holding_torques
from robotmodels.simulation.discrete_loop import sampled_loop

_CLOCK = 1e-3
"""Largest deviation of times, in parts of a sample: nanoseconds in messages, digits in files."""

_README = """\
Files for the controller of {robot}, one sample every {sample_time:g} s.

csv/sequence.csv      the order in which to play csv/*.csv, and how often each
mat/visit_*.mat       the same for MATLAB, a file for each visit
trajectory            a bag of ROS 2 with a JointTrajectory for each move and run

Positions are on the arm side [rad; m]; speeds in csv and mat are of the motor shafts [rad/s],
velocities in trajectories of the arm side.

Moves begin and end at rest; every run begins and ends at rest in the position of its visit. Brakes
are released before the move and stay so until the last run has ended; in between the motors hold
the arm, also at rest.
Stop if a motor exceeds its limit. What the files lead to by the model, on the motor shafts (swing
on the arm side), with the robot file's payload and friction:

"""


def write_controller_files(
    plan: ExperimentPlan,
    folder: Path,
    formats: Iterable[Format],
    settings: LoopSettings,
    robot: ElasticRobot,
) -> None:
    """Write the files of a plan into a folder, a subfolder for each format, and check them.

    Subfolders of earlier plans are removed first, and those that fail the check.

    Parameters
    ----------
    settings : LoopSettings
        Limits and controller that the files are checked against.
    robot : ElasticRobot
        The robot that the plan was made for.

    Raises
    ------
    InvalidInput
        Naming file, motor, time, value and limit, if a sample exceeds one; or if files cannot be
        written or read.
    """
    ratios, controller = gear_ratios(robot), controller_of(settings, robot)
    joints = [motor.joint for motor in robot.file.motors]
    follow = partial(export_trajectory, position_gain=controller.position_gain, joints=joints)
    exports: dict[Format, Callable[..., None]] = {
        "csv": export_csv,
        "mat": export_mat,
        "trajectory": follow,
    }
    for name in formats:
        shutil.rmtree(folder / name, ignore_errors=True)
        exports[name](plan, folder / name, ratios)
        try:
            largest = check_files(plan, folder / name, name, settings, robot)
        except InvalidInput:
            shutil.rmtree(folder / name)
            raise
    text = _README.format(robot=plan.robot, sample_time=plan.multisine.sample_time)
    table = _table(plan.motors, largest, limits_of(settings, robot))
    write_text(folder / "README.txt", text + table)


def _table(motors: tuple[str, ...], largest: dict[str, Array], limits: Limits) -> str:
    """Return the largest magnitudes of runs beside their limits, a line per quantity."""
    rows = [["", *motors]]
    for name, bounds in zip(UNITS, limits.bounds(motors), strict=True):
        if name == "position" or name not in largest:
            continue
        rows.append([f"{name} [{UNITS[name]}]", *(f"{x:.4g}" for x in largest[name])])
        rows.append(["    limit", *(f"{x:.4g}".replace("inf", "none") for x in bounds[:, 1])])
    return "".join(f"{row[0]:<32}{''.join(f'{x:>10}' for x in row[1:])}\n" for row in rows)


def check_files(
    plan: ExperimentPlan,
    folder: Path,
    name: Format,
    settings: LoopSettings,
    robot: ElasticRobot,
) -> dict[str, Array]:
    """Read the files of one format in a folder and check every sample of every visit.

    Returns
    -------
    dict of str to ndarray, (n,)
        Largest magnitudes of all runs by quantity, see `TrajectoryCheck.check`.

    Raises
    ------
    InvalidInput
        As `write_controller_files`.
    """
    read = {"csv": _read_csv, "mat": _read_mat, "trajectory": _read_bag}[name]
    checks: dict[int, TrajectoryCheck] = {}
    largest: dict[str, Array] = {}
    ratios = gear_ratios(robot)
    for trajectory in read(folder, ratios, plan.multisine.sample_time):
        q = int(plan.visits[trajectory.visit])
        if q not in checks:
            checks[q] = _check_at(plan, plan.positions[q], ratios, settings, robot)
        for quantity, values in checks[q].check(trajectory).items():
            largest[quantity] = np.maximum(largest.get(quantity, 0.0), values)
    return largest


def _check_at(
    plan: ExperimentPlan,
    position: Array,
    ratios: Array,
    settings: LoopSettings,
    robot: ElasticRobot,
) -> TrajectoryCheck:
    """Return what must hold in one position."""
    controller = controller_of(settings, robot)
    here = position[None]
    return TrajectoryCheck(
        limits=limits_of(settings, robot),
        moves=plan.moves,
        position=position,
        ratios=ratios,
        controller=controller,
        loop=sampled_loop(robot.network(here).linear_model().at(0), controller),
        hold=holding_torques(robot, robot.equilibrium(here).coordinates)[0],
        friction=friction_of(settings, robot),
    )


def _read_csv(folder: Path, ratios: Array, sample_time: float) -> Iterator[Trajectory]:
    """Yield what ``sequence.csv`` and the files that it names tell."""
    n = len(ratios)
    with library_errors(folder, "a sequence of csv files", KeyError):
        with (folder / "sequence.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        parts: list[tuple[str, Array]] = []
        for row, after in zip(rows, [*rows[1:], None], strict=True):
            name = folder / row["file"]
            table = np.loadtxt(name, delimiter=",", skiprows=1, ndmin=2)
            _check_clock(name, table[:, 0], sample_time)
            repeats = min(int(row["repeats"]), _settled(len(table), sample_time))
            parts += [(str(name), table[:, 1:])] * repeats
            if after is None or not row["run"] or _run_of(row) != _run_of(after):
                samples = np.concatenate([each for _, each in parts])
                pieces = tuple((each, len(values)) for each, values in parts)
                visit = int(row["visit"]) - 1
                yield Trajectory(pieces, visit, not row["run"], samples[:, :n], samples[:, n:])
                parts = []


def _run_of(row: dict[str, str]) -> tuple[str, str, str]:
    return row["visit"], row["block"], row["run"]


def _read_mat(folder: Path, ratios: Array, sample_time: float) -> Iterator[Trajectory]:
    """Yield what the files of MATLAB tell."""
    from scipy.io import loadmat

    for visit, path in enumerate(sorted(folder.glob("visit_*.mat"))):
        with library_errors(path, "a visit for MATLAB", Exception):
            content = loadmat(path)
            move, speeds = content["move_position"], content["move_speed"]
            references = content["reference"]  # (N, n, runs, blocks)
            rise, fall = (content[name].reshape(-1, 1) for name in ("envelope", "fall"))
            _check_clock(path, content["sample_time"].ravel() * [0, 1], sample_time)
            periods = content["periods"].item() + content["transient_periods"].item()
            periods = min(periods, 1 + _settled(len(references), sample_time))
        if len(move):
            yield Trajectory(((str(path), len(move)),), visit, True, move, speeds)
        runs = references.reshape(*references.shape[:2], -1)
        for run in np.moveaxis(runs, 2, 0):
            parts = [rise * run, *[run] * (periods - 1), fall * run[: len(fall)]]
            told = np.concatenate(parts)
            position = np.tile(content["position"], (len(told), 1))
            yield Trajectory(((str(path), len(told)),), visit, False, position, told)


def _read_bag(folder: Path, ratios: Array, sample_time: float) -> Iterator[Trajectory]:
    """Yield what the messages of a bag tell."""
    for name, times, positions, velocities in read_trajectories(folder):
        where = f"{folder}, {name}"
        _check_clock(where, times, sample_time)
        visit, _, step = name.removeprefix("visit ").partition(",")
        if not visit.isdigit():
            raise InvalidInput(f"{where}: a visit's number is needed")
        pieces = ((where, len(positions)),)
        is_move = "run" not in step
        yield Trajectory(pieces, int(visit) - 1, is_move, positions, velocities * ratios)


def _settled(samples: int, sample_time: float) -> int:
    """Return the repetitions of a period after which more of them tell nothing new."""
    return 1 + int(np.ceil(START / (samples * sample_time)))


def _check_clock(where: object, times: Array, sample_time: float) -> None:
    """Refuse times (K,) that are not those of the samples."""
    off = np.abs(times - sample_time * np.arange(len(times))) > _CLOCK * sample_time
    if off.any():
        k = int(off.argmax())
        raise InvalidInput(
            f"{where}: sample {k + 1} at {times[k]:.6g} s; {k * sample_time:.6g} s, sampled every "
            f"{sample_time:g} s, is planned; the visit is not offered"
        )
