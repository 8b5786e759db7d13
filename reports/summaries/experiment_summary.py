"""What ``oed simulate`` says at the end: the plan, what limits it, what the simulation met."""

from pathlib import Path
from typing import Any

import numpy as np

from oed.experiment.experiment_plan import ExperimentPlan
from oed.experiment.prepare import Prepared
from oed.experiment.run_experiment import Outcome
from reports.summaries.columns import number, plain, plural, table
from reports.text import duration

_FILES = ("plan.yaml", "plan.h5", "records.h5", "controller")


def experiment_summary(prepared: Prepared, outcome: Outcome, folder: Path) -> str:
    """Return the summary of a simulated experiment, one screen.

    Predicted peaks include the start of each run, met ones the measured periods only.
    """
    entries = [
        *_plan_entries(prepared.plan),
        ("limit", str(prepared.scaling.binding)),
        *_saturation_entries(prepared.plan, outcome),
        ("time", f"simulated in {plain(duration(outcome.seconds))}"),
        *(("written", str(folder / name)) for name in _FILES if (folder / name).exists()),
    ]
    lines = [f"  {key:<9}{value}" for key, value in entries]
    return "\n".join([prepared.robot.name, *lines, *_peaks(prepared.plan, outcome)])


def _plan_entries(plan: ExperimentPlan) -> list[tuple[str, str]]:
    """Return how much is measured, for how long, and at which frequencies."""
    lines, period = plan.multisine.lines, plan.multisine.period
    experiments = len(plan.visits)
    repeated = (
        f" in {plural(experiments, 'experiment')}" if experiments > len(plan.positions) else ""
    )
    left_out = len(plan.multisine.detection)
    detection = f", {plural(left_out, 'detection line')}" if left_out else ""
    return [
        (
            "plan",
            f"{plural(len(plan.positions), 'position')}{repeated}, "
            f"{plural(plan.blocks, 'block')} of {plural(plan.runs, 'run')}, "
            f"{plan.transient_periods} + {plan.periods} periods of {period:g} s",
        ),
        ("", f"{plain(duration(plan.duration))} on a robot, moves included"),
        (
            "lines",
            f"{plural(len(lines), 'line')} from {lines[0] / period:g} to "
            f"{lines[-1] / period:g} Hz{detection}",
        ),
    ]


def _saturation_entries(plan: ExperimentPlan, outcome: Outcome) -> list[tuple[str, str]]:
    """Return a warning if a motor met its torque limit."""
    met = outcome.saturated > 0
    if not met.any():
        return []
    worst = int(np.argmax(outcome.saturated))
    return [
        (
            "torque",
            f"WARNING: {plural(int(met.sum()), 'motor')} met the torque limit, "
            f"{plan.motors[worst]!r} in {100 * outcome.saturated[worst]:.2g} % of the runs",
        )
    ]


def _peaks(plan: ExperimentPlan, outcome: Outcome) -> list[str]:
    """Return the table of each motor's largest torque and speed, predicted and met."""
    peaks = (
        outcome.predicted_torque,
        outcome.peak_torque,
        outcome.predicted_speed,
        outcome.peak_speed,
    )
    rows = [
        (name, *(number(float(v)) for v in values))
        for name, *values in zip(plan.motors, *peaks, strict=True)
    ]
    header = ("peaks", "torque\npredicted", "N m\nmet", "speed\npredicted", "rad/s\nmet")
    return table(header, rows, right=(1, 2, 3, 4))


def experiment_json(prepared: Prepared, outcome: Outcome, folder: Path) -> dict[str, Any]:
    """Return the summary for scripts: N m, rad/s and s; parts of the runs that saturated."""
    plan = prepared.plan
    return {
        "robot": prepared.robot.name,
        "positions": len(plan.positions),
        "experiments": len(plan.visits),
        "blocks": plan.blocks,
        "runs": plan.runs,
        "periods": plan.periods,
        "duration": float(plan.duration),
        "limit": str(prepared.scaling.binding),
        "motors": {
            motor: {
                "predicted_torque": float(outcome.predicted_torque[i]),
                "torque": float(outcome.peak_torque[i]),
                "predicted_speed": float(outcome.predicted_speed[i]),
                "speed": float(outcome.peak_speed[i]),
                "saturated": float(outcome.saturated[i]),
            }
            for i, motor in enumerate(plan.motors)
        },
        "seconds": outcome.seconds,
        "files": [str(folder / name) for name in _FILES],
    }
