"""What ``oed frf`` says at the end: one screen of text, or JSON."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimators.frf.frf_from_records import MeasuredFrf
from estimators.frf.method_comparison import MethodComparison
from estimators.frf.torque_loop import TorqueLoop
from reports import text
from reports.summaries.columns import number, plain, plural, table
from robotmodels.common.arrays import Array

_OTHER_LOOP = 3.0  # of the misfit


def frf_summary(measurement: MeasuredFrf, files: list[Path]) -> str:
    """Return the summary of estimated FRFs, one screen."""
    e, r = measurement.estimate, measurement.first
    blocks, runs, periods = r.torque.shape[1:4]
    medians = relative_std(measurement)
    lines = [
        (
            "records",
            f"{plural(len(e.positions), 'position')}, {plural(blocks, 'block')} of "
            f"{plural(runs, 'run')}, {plural(periods, 'period')}",
        ),
        (
            "FRFs",
            f"{measurement.method}, {e.response.shape[2]} x {e.response.shape[3]} at "
            f"{plural(len(e.omega), 'line')} from {plain(text.hertz(e.omega[0]))} to "
            f"{plain(text.hertz(e.omega[-1]))}",
        ),
        ("std", f"{plain(text.percent(float(np.median(medians))))} of the element (median)"),
    ]
    lines.append(("torques", _torques(measurement)))
    if measurement.torque_loop is not None:
        lines += [("loop", one) for one in loop_words(measurement.torque_loop, measurement.motors)]
    if measurement.distortion is not None:
        ratio = excess(measurement)
        if np.isfinite(ratio):
            lines.append(("", f"variance between blocks is {number(ratio)} times that of noise"))
    lines += [("written", str(path)) for path in files]
    shown = [f"  {key:<9}{value}" for key, value in lines]
    if measurement.comparison is not None:
        shown += _ranking(measurement.comparison)
    return "\n".join(
        [measurement.robot.name if measurement.robot else "frequency responses", *shown]
    )


def _torques(measurement: MeasuredFrf) -> str:
    """Return the rank and conditioning of the torques, and how many lines are left out."""
    e, out = measurement.excitation, len(measurement.left_out)
    words = (
        f"{e.rank.min()} to {e.rank.max()}" if e.rank.min() < e.rank.max() else str(e.rank.min())
    )
    words += (
        f" of {len(measurement.motors)} independent at a line; condition number "
        f"{number(float(np.median(e.condition)))} (median), {number(float(e.condition.max()))} "
        "(worst)"
    )
    return words + (f"; {plural(out, 'line')} left out" if out else "")


def loop_words(loop: TorqueLoop, motors: Sequence[str]) -> list[str]:
    """Return measured over commanded torques in words, motor by motor, with standard errors."""
    words = []
    for i, motor in enumerate(motors):
        gain, delay, lag = loop.std[i]
        parts = f"{motor}: measured over commanded torque {loop.gain[i]:.4g} ({gain:.1g})"
        parts += f", delay {1e3 * loop.delay[i]:.3g} ({1e3 * delay:.1g}) ms"
        parts += f", lag {1e3 * loop.lag[i]:.3g} ({1e3 * lag:.1g}) ms"
        parts += f", bandwidth {loop.bandwidth[i] / (2 * np.pi):.3g} Hz"
        other = loop.misfit[i] > _OTHER_LOOP
        words.append(parts + ("; MISFIT, the loop is another" if other else ""))
    return words


def loop_json(loop: TorqueLoop | None, motors: Sequence[str]) -> list[dict[str, Any]] | None:
    """Return the loop of each motor for scripts, in SI units; an infinite bandwidth is null."""
    if loop is None:
        return None
    return [
        {
            "motor": motor,
            "gain": float(loop.gain[i]),
            "delay": float(loop.delay[i]),
            "lag": float(loop.lag[i]),
            "std": loop.std[i].tolist(),
            "bandwidth": float(loop.bandwidth[i]) if np.isfinite(loop.bandwidth[i]) else None,
            "misfit": float(loop.misfit[i]),
        }
        for i, motor in enumerate(motors)
    ]


def frf_json(measurement: MeasuredFrf, files: list[Path]) -> dict[str, Any]:
    """Return the summary for scripts; frequencies in rad/s."""
    e, ratio = measurement.estimate, excess(measurement)
    ranking = {}
    if measurement.comparison is not None:
        ranking = dict(
            zip(
                measurement.comparison.methods,
                map(float, measurement.comparison.scores),
                strict=True,
            )
        )
    return {
        "robot": measurement.robot.name if measurement.robot else None,
        "method": measurement.method,
        "positions": len(e.positions),
        "missing_runs": measurement.missing,
        "outputs": e.response.shape[2],
        "inputs": e.response.shape[3],
        "lines": len(e.omega),
        "omega": e.omega.tolist(),
        "rank": measurement.excitation.rank.tolist(),
        "condition": measurement.excitation.condition.tolist(),
        "left_out": measurement.left_out.tolist(),
        "torque_loop": loop_json(measurement.torque_loop, measurement.motors),
        "band": [float(e.omega[0]), float(e.omega[-1])],
        "relative_std": float(np.median(relative_std(measurement))),
        "variance_over_noise": ratio if np.isfinite(ratio) else None,
        "relative_error": ranking,
        "warnings": list(measurement.warnings),
        "files": [str(path) for path in files],
    }


def _ranking(comparison: MethodComparison) -> list[str]:
    """Return the table of methods."""
    rows = [
        (name, *(plain(text.percent(value)) for value in values))
        for name, *values in ranked(comparison)
    ]
    header = ("methods on this loop, best first", "relative\nerror", "\nbias")
    return table(header, rows, right=(1, 2))


def relative_std(measurement: MeasuredFrf) -> Array:
    """Return standard deviations of the FRFs over their magnitudes, (Q, F, m, n)."""
    e = measurement.estimate
    return np.asarray(np.sqrt(e.variance) / np.maximum(np.abs(e.response), 1e-300))


def excess(measurement: MeasuredFrf) -> float:
    """Return the median ratio of total to noise variances; 1 without distortion."""
    d = measurement.distortion
    if d is None or np.isnan(d.total).all():
        return float("nan")
    return float(np.nanmedian(d.total / d.noise))


def ranked(comparison: MethodComparison) -> list[tuple[str, float, float]]:
    """Return name, relative error and bias of the methods, best first."""
    bias = np.sqrt(np.mean((comparison.bias / comparison.response) ** 2, axis=1))
    order = np.argsort(comparison.scores, kind="stable")
    return [(comparison.methods[i], float(comparison.scores[i]), float(bias[i])) for i in order]
