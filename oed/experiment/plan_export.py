"""Plans for a robot controller: reference trajectories as CSV or MATLAB files.

A controller is told motor positions on the arm side [rad] and motor speeds on the motor shaft
[rad/s]: during a move both belong to the same path; under excitation the position rests and the
speed is the multisine's. One sample per sample time of the plan.
"""

import csv
import io
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from oed.experiment.experiment_plan import ExperimentPlan
from robotmodels.common.arrays import Array
from robotmodels.common.atomic_files import staged_folder
from robotmodels.common.errors import InvalidInput

_SEQUENCE = ("step", "kind", "file", "visit", "position", "block", "run", "repeats", "drop")


def export_csv(
    plan: ExperimentPlan,
    folder: str | os.PathLike[str],
    gear_ratios: Sequence[float] | Array,
) -> None:
    """Write CSV files into `folder`; ``sequence.csv`` says in which order to play them.

    ``sequence.csv`` has a row per step: its kind (move, ramp or excitation), the file, visit,
    position, block, run (all counted from 1), how often in a row to repeat the file, and how many
    of these periods to drop as transient. Every other file holds ``time`` [s], ``<motor>.position``
    [rad, arm side] and ``<motor>.speed`` [rad/s, motor shaft].

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
        for row, positions, speeds in _steps(plan, ratios):
            time = np.arange(len(positions)) * plan.multisine.sample_time
            table = np.column_stack([time, positions, speeds])
            name = stage / str(row[1])
            np.savetxt(name, table, "%.12g", ",", header=_csv_line(header), comments="")
            rows.append((len(rows), *row))
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
    ``transient_periods``, ``envelope`` (N,), factors of the first period's samples, ``sample_time``
    [s], ``lines``, ``detection``, ``gear_ratios``.

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
                "sample_time": plan.multisine.sample_time,
                "lines": plan.multisine.lines,
                "detection": plan.multisine.detection,
                "gear_ratios": ratios,
            }
            savemat(stage / f"visit_{visit + 1:03d}.mat", content, do_compression=True)


def _steps(plan: ExperimentPlan, ratios: Array) -> Iterator[tuple[tuple[Any, ...], Array, Array]]:
    """Yield, per step, its row of the sequence, positions (K, n) and speeds (K, n)."""
    drop = plan.transient_periods - int(plan.ramp)
    repeats = plan.periods + drop
    for visit, q in enumerate(plan.visits):
        name, numbers = f"visit_{visit + 1:03d}", (visit + 1, int(q) + 1)
        path = plan.move_to(visit)
        if len(path):
            row: tuple[Any, ...] = ("move", f"{name}_move.csv", *numbers, "", "", 1, "")
            yield row, path.positions, ratios * path.speeds
        steady = np.tile(plan.positions[q], (plan.multisine.samples, 1))
        for block, runs in enumerate(plan.reference(visit), start=1):
            for run, speeds in enumerate(runs, start=1):
                file = f"{name}_block_{block:02d}_run_{run:02d}"
                if plan.ramp:
                    row = ("ramp", f"{file}_ramp.csv", *numbers, block, run, 1, 1)
                    yield row, steady, plan.envelope[:, None] * speeds
                row = ("excitation", f"{file}.csv", *numbers, block, run, repeats, drop)
                yield row, steady, speeds


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
