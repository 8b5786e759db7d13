"""Plans for a robot controller: reference trajectories as CSV or MATLAB files, or a bag of ROS 2.

A controller is told motor positions on the arm side [rad] and motor speeds on the motor shaft
[rad/s]: during a move both belong to the same path; under excitation the position rests and the
speed is the multisine's. One sample per sample time of the plan. Controllers of ROS 2 follow
positions, see `export_trajectory`.
"""

import csv
import io
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

from oed.experiment.experiment_plan import ExperimentPlan
from oed.experiment.played_steps import PlayedStep, played_steps
from oed.experiment.trajectory_bag import write_trajectories
from robotmodels.common.arrays import Array
from robotmodels.common.atomic_files import staged_folder
from robotmodels.common.errors import InvalidInput

_SEQUENCE = ("step", "kind", "file", "visit", "position", "block", "run", "repeats", "drop")

_DECAY = 12.0
"""Time constants of the position loop after which a trajectory rests, to 6e-6 of where it was."""


def export_csv(
    plan: ExperimentPlan,
    folder: str | os.PathLike[str],
    gear_ratios: Sequence[float] | Array,
) -> None:
    """Write CSV files into `folder`; ``sequence.csv`` says in which order to play them.

    ``sequence.csv`` has a row per step: its kind (move, settle, ramp, excitation or fall), the
    file, visit, position, block, run (all counted from 1), how often in a row to repeat the file,
    and how many of these to drop as transient. Every other file holds ``time`` [s],
    ``<motor>.position`` [rad, arm side] and ``<motor>.speed`` [rad/s, motor shaft].

    Parameters
    ----------
    gear_ratios : sequence of float or ndarray, (n,)
        Motor angle per arm angle.

    Raises
    ------
    InvalidInput
        If the folder cannot be written to, or there is not a ratio for every motor.
    """
    ratios = _checked_ratios(plan, gear_ratios)
    header = ["time", *(f"{m}.position" for m in plan.motors), *(f"{m}.speed" for m in plan.motors)]
    rows: list[tuple[Any, ...]] = [_SEQUENCE]
    with staged_folder(Path(folder)) as stage:
        for step in played_steps(plan, ratios):
            time = np.arange(len(step.speeds)) * plan.multisine.sample_time
            table = np.column_stack([time, step.positions, step.speeds])
            name = f"{step.name}.csv"
            np.savetxt(stage / name, table, "%.12g", ",", header=_csv_line(header), comments="")
            numbers = (step.visit, step.position, step.block or "", step.run or "")
            rows.append((len(rows), step.kind, name, *numbers, step.repeats, step.drop))
        with (stage / "sequence.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows(rows)


def export_mat(
    plan: ExperimentPlan,
    folder: str | os.PathLike[str],
    gear_ratios: Sequence[float] | Array,
) -> None:
    """Write one MATLAB file per visit into `folder`: ``visit_001.mat``, ...

    Variables: ``robot``, ``motors`` (cell array), ``visit`` and ``position_number`` (counted from
    1), ``position`` (1, n) [rad, arm side], ``move_position`` (K, n) [rad, arm side] and
    ``move_speed`` (K, n) [rad/s, motor shaft] of the move that leads there, ``reference``
    (N, n, runs, blocks) [rad/s, motor shaft], one period each, ``periods``,
    ``transient_periods``, ``envelope`` (N,), factors of the first period's samples, ``fall``,
    factors of the samples that end a run, ``settle``, rest after the move [s], ``sample_time`` [s],
    ``lines``, ``detection``, ``gear_ratios``.

    Raises
    ------
    InvalidInput
        As `export_csv`.
    """
    from scipy.io import savemat

    ratios = _checked_ratios(plan, gear_ratios)
    with staged_folder(Path(folder)) as stage:
        for visit, q in enumerate(plan.visits):
            path = plan.move_to(visit)
            content: dict[str, Any] = {
                "robot": plan.robot,
                "motors": np.array(plan.motors, dtype=object),
                "visit": visit + 1,
                "position_number": int(q) + 1,
                "position": plan.positions[q],
                "move_position": path.positions,
                "move_speed": ratios * path.speeds,
                "reference": np.transpose(plan.reference(visit), (2, 3, 1, 0)),
                "periods": plan.periods,
                "transient_periods": plan.transient_periods,
                "envelope": plan.envelope,
                "fall": plan.fall,
                "settle": plan.settle,
                "sample_time": plan.multisine.sample_time,
                "lines": plan.multisine.lines,
                "detection": plan.multisine.detection,
                "gear_ratios": ratios,
            }
            savemat(stage / f"visit_{visit + 1:03d}.mat", content, do_compression=True)


def export_trajectory(
    plan: ExperimentPlan,
    folder: str | os.PathLike[str],
    gear_ratios: Sequence[float] | Array,
    position_gain: Sequence[float] | Array,
    joints: Sequence[str],
) -> None:
    """Write a bag of ROS 2 with a ``trajectory_msgs/msg/JointTrajectory`` for each move and run.

    They are in the order of the plan, in the topic ``/joint_trajectory``; the ``frame_id`` says
    which it is, such as ``visit 1, block 1, run 2``. Positions and velocities are those of the arm
    side. A controller with this position gain k and its speed fed forward follows them as one that
    is told the speeds r of the plan around a resting position: p' + k p = r.

    Parameters
    ----------
    gear_ratios : sequence of float or ndarray, (n,)
        Motor angle per arm angle.
    position_gain : sequence of float or ndarray, (n,), 1/s
        Of the controller.
    joints : sequence of str
        Names of the joints, one per motor.

    Raises
    ------
    InvalidInput
        As `export_csv`; or if a position gain is zero, with which runs do not end where they begin.
    """
    ratios, gains = _checked_ratios(plan, gear_ratios), np.asarray(position_gain, dtype=float)
    for motor, gain in zip(plan.motors, gains, strict=True):
        if not gain > 0:
            raise InvalidInput(
                f"trajectory: the position gain of motor {motor!r} is {gain:g}; without one a "
                "trajectory drifts away from its position; take csv or mat"
            )
    with staged_folder(Path(folder)) as stage:
        bag = stage / "bag"
        write_trajectories(
            bag, joints, plan.multisine.sample_time, _joint_motion(plan, ratios, gains)
        )
        for file in bag.iterdir():
            file.rename(stage / file.name)
        bag.rmdir()


def _joint_motion(
    plan: ExperimentPlan, ratios: Array, gains: Array
) -> Iterator[tuple[str, Array, Array]]:
    """Yield name, positions and velocities (K, n) on the arm side of each move and run."""
    T = plan.multisine.sample_time
    tail = np.zeros((int(np.ceil(_DECAY / (gains.min() * T))), len(ratios)))
    run: list[PlayedStep] = []
    for step in played_steps(plan, ratios):
        if not step.run:
            yield f"visit {step.visit}, {step.kind}", step.positions, step.speeds / ratios
            continue
        run.append(step)
        if step.kind == ("fall" if plan.ramp else "excitation"):
            name = f"visit {step.visit}, block {step.block}, run {step.run}"
            speeds = np.concatenate([*(np.tile(s.speeds, (s.repeats, 1)) for s in run), tail])
            r = speeds / ratios
            # p' + k p = r by the trapezoidal rule
            parts = zip(gains * T / 2, r.T, strict=True)
            away = np.stack([lfilter([T / 2] * 2, [1 + h, h - 1], x) for h, x in parts], axis=-1)
            yield name, run[0].positions[0] + away, r - gains * away
            run = []


def _csv_line(cells: Sequence[str]) -> str:
    """Return a line of a CSV file; a name may have a comma."""
    line = io.StringIO()
    csv.writer(line, lineterminator="").writerow(cells)
    return line.getvalue()


def _checked_ratios(plan: ExperimentPlan, gear_ratios: Sequence[float] | Array) -> Array:
    ratios = np.asarray(gear_ratios, dtype=float)
    n = len(plan.motors)
    if ratios.shape != (n,) or not (np.isfinite(ratios) & (ratios != 0)).all():
        raise InvalidInput(
            f"gear_ratios: {n} numbers other than zero are needed, one per motor: "
            f"{', '.join(plan.motors)}"
        )
    return ratios
