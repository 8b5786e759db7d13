"""Run all cells of fits to runs and write what they show: `make trust-runs`, within 30 minutes.

One run, two, as many as motors and twice that, with 10 and 30 % of noise on the torques, outputs
weighed together and one by one, covariances known or of few degrees of freedom; one period in a
loop with its noise from detection lines; random torques, states estimated along. Beside them the
controls that must fail: torques taken as exact, random torques without states.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "estimators"))

import numpy as np
import sampled_runs
from noisy_runs import MODEL, RESPONSE, TRUTH, noisy_runs

from estimators import RunSpectra, covariance, fit, run_spectra

RUNS = 400
DOCS = Path(__file__).parents[2] / "docs"
BEGIN, END = "<!-- figures: begin -->", "<!-- figures: end -->"
LINES = np.array([k for k in range(7, 100, 2) if k % 10 != 5])


@dataclass(frozen=True)
class Cell:
    """Studies of one kind.

    Attributes
    ----------
    kind : str
        "periodic" spectra, "detection" or "random" samples.
    runs : int
        In each position.
    noise : float
        Of torques, relative; of samples as `sampled_runs` has it.
    weights : str
        "joint" or "row_wise".
    freedom : float
        Degrees of freedom of the covariances.
    control : bool
        Torques taken as exact, or no states: this must fail.
    """

    kind: str
    runs: int
    noise: float
    weights: str
    freedom: float = np.inf
    control: bool = False


def cells() -> list[Cell]:
    """Return all cells."""
    listed = [
        Cell("periodic", runs, noise, weights)
        for runs in (1, 2, 4)
        for noise in (0.1, 0.3)
        for weights in ("joint", "row_wise")
    ]
    listed += [Cell("periodic", runs, 0.3, "joint", 10) for runs in (1, 2, 4)]
    listed += [Cell("periodic", runs, 0.3, "row_wise", 5) for runs in (1, 2, 4)]
    for weights in ("joint", "row_wise"):
        listed += [Cell("detection", runs, 0.0, weights) for runs in (1, 2)]
        listed += [Cell("random", runs, 0.05, weights) for runs in (1, 2)]
    listed += [Cell("periodic", runs, 0.3, "joint", control=True) for runs in (2, 4)]
    return [*listed, Cell("random", 1, 0.05, "joint", control=True)]


def frozen(data: RunSpectra) -> RunSpectra:
    """Return the same with Sigma of the true FRF as output noise, torques taken as exact."""
    wide = np.concatenate([np.broadcast_to(np.eye(2), RESPONSE.shape), -RESPONSE], axis=3)
    sigma = wide @ data.covariance @ np.conj(np.swapaxes(wide, -1, -2))
    exact = np.zeros_like(data.covariance)
    exact[..., :2, :2] = sigma
    return replace(data, covariance=exact)


def periodic(cell: Cell, rng: np.random.Generator) -> RunSpectra:
    """Spectra of random-phase runs."""
    data = noisy_runs(rng, cell.runs, cell.noise, freedom=cell.freedom)
    return frozen(data) if cell.control else data


def random(cell: Cell, rng: np.random.Generator) -> RunSpectra:
    """Random torques from any state."""
    records = sampled_runs.sampled_records(rng, cell.runs, 512)
    data = run_spectra(records, (sampled_runs.TORQUE, sampled_runs.ANGLE))
    return replace(data, sample_time=None) if cell.control else data


def detection(cell: Cell, rng: np.random.Generator) -> RunSpectra:
    """One block of one period in a loop that feeds noise back."""
    records = sampled_runs.sampled_records(rng, cell.runs, 512, feedback=20.0, lines=LINES)
    return run_spectra(records, "detection")


SAMPLED: dict[str, Callable[[Cell, np.random.Generator], RunSpectra]] = {
    "detection": detection,
    "random": random,
}


def run_cell(cell: Cell, count: int) -> dict[str, Any]:
    """Return the figures of a cell: coverage of each parameter, cost beside its mean, verdicts."""
    rng, draw = np.random.default_rng(17), {"periodic": periodic, **SAMPLED}[cell.kind]
    covers, quoted, costs = [], [], []
    for _ in range(count):
        fitted = fit(MODEL, draw(cell, rng), weights=cell.weights)
        likely = covariance(fitted)
        z = np.log(fitted.parameters.values / TRUTH) / likely.std
        covers.append(np.abs(z) < likely.quantile(0.95))
        costs.append(fitted.cost / fitted.expected_cost)
        ends = np.array([(one.low, one.high) for one in fitted.intervals()], dtype=float)
        if np.isfinite(ends).all():
            quoted.append((ends[:, 0] <= TRUTH) & (ends[:, 1] >= TRUTH))
    return {
        **asdict(cell),
        "studies": count,
        "freedom": None if np.isinf(cell.freedom) else cell.freedom,
        "coverage": float(np.mean(covers)),
        "worst": float(np.mean(covers, axis=0).min()),
        "cost": float(np.mean(costs)),
        "quoted": len(quoted) / count,
        "quoted_coverage": float(np.mean(quoted)) if quoted else None,
    }


def shortfall(result: dict[str, Any], count: int) -> str:
    """Return what a cell falls short of, with three standard errors of its own."""
    slack = 3 * np.sqrt(0.05 * 0.95 / (2 * count))  # parameters are correlated: two count
    sampled = result["freedom"] is not None or result["kind"] == "detection"
    upper = 0.995 if sampled else 0.97
    if result["control"]:
        most = 0.85 if result["kind"] == "periodic" and result["runs"] == 2 else 0.78
        return "" if result["coverage"] <= most else f"control covers more than {most:.0%}"
    if not 0.93 - slack < result["coverage"] < upper + slack:
        return f"coverage {result['coverage']:.3f}"
    if result["worst"] < 0.91 - slack:
        return f"worst {result['worst']:.3f}"
    if result["kind"] != "detection" and abs(result["cost"] - 1) > 0.02:
        return f"cost {result['cost']:.3f}"
    return ""


def page(document: dict[str, Any]) -> str:
    """Return the table of all cells."""
    head = (
        "| kind | studies | runs | torque noise | outputs | degrees of freedom | covariance "
        "| worst | cost | quoted | of them cover | falls short |"
    )
    lines = [head, "|---" * 12 + "|"]
    for r in document["cells"]:
        kind = f"{r['kind']}{', control' if r['control'] else ''}"
        cover = "" if r["quoted_coverage"] is None else f"{100 * r['quoted_coverage']:.1f} %"
        columns = (
            kind,
            r["studies"],
            r["runs"],
            f"{r['noise']:g}",
            r["weights"].replace("_", " "),
            r["freedom"] or (f"{6 * r['runs']}" if r["kind"] == "detection" else "known"),
            f"{100 * r['coverage']:.1f} %",
            f"{100 * r['worst']:.1f} %",
            f"{r['cost']:.3f}",
            f"{100 * r['quoted']:.0f} %",
            cover,
            r["short"],
        )
        lines.append(f"| {' | '.join(map(str, columns))} |")
    return "\n".join(lines)


def main() -> None:
    """Run everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--page", type=Path, default=DOCS / "trust-runs.md")
    parser.add_argument("--json", type=Path, default=DOCS / "trust-runs.json")
    arguments = parser.parse_args()
    begin, results = time.monotonic(), []
    with ProcessPoolExecutor(arguments.workers) as pool:
        jobs = [
            pool.submit(run_cell, cell, arguments.runs // (4 if cell.kind in SAMPLED else 1))
            for cell in cells()
        ]
        for job in jobs:
            result = job.result()
            result["short"] = shortfall(result, result["studies"])
            results.append(result)
            print(json.dumps(result), flush=True)
    minutes = (time.monotonic() - begin) / 60
    document = {"runs": arguments.runs, "minutes": round(minutes, 1), "cells": results}
    arguments.json.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    words = arguments.page.read_text(encoding="utf-8").split(BEGIN)[0]
    said = f"{minutes:.0f} minutes, processes: {arguments.workers}.\n\n"
    arguments.page.write_text(f"{words}{BEGIN}\n\n{said}{page(document)}\n\n{END}\n", "utf-8")
    failing = [r for r in results if r["short"]]
    print(f"\n{len(failing)} of {len(results)} cells fall short, {minutes:.1f} minutes")


if __name__ == "__main__":
    main()
