"""Run all cells of fits to runs and write what they show: `make trust-runs`, within 30 minutes.

One run, two, as many as motors and twice that, with 10 and 30 % of noise on the torques, outputs
weighed together and one by one, covariances known or of few degrees of freedom; one period in a
loop with its noise from detection lines or stated; random torques, states estimated along; link
encoders, torque sensors, accelerometers and mixtures, more or fewer than motors; six motors.
Beside them the controls that must fail: torques taken as exact, runs without their states.
"""

import argparse
import json
import os
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

from trust_run_cells import cells, run_cell

RUNS = 400
DOCS = Path(__file__).parents[2] / "docs"
BEGIN, END = "<!-- figures: begin -->", "<!-- figures: end -->"
COLUMNS = (
    "kind", "outputs", "studies", "runs", "torque noise", "weights", "degrees of freedom",
    "covariance", "worst", "cost", "quoted", "of them cover", "falls short",
)  # fmt: skip


def page(document: dict[str, Any]) -> str:
    """Return the table of all cells."""
    lines = [f"| {' | '.join(COLUMNS)} |", "|---" * len(COLUMNS) + "|"]
    for r in document["cells"]:
        cover = "" if r["quoted_coverage"] is None else f"{100 * r['quoted_coverage']:.1f} %"
        columns = (
            f"{r['kind']}{', control' if r['control'] else ''}",
            r["outputs"],
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


def write(results: list[dict[str, Any]], minutes: float, arguments: argparse.Namespace) -> None:
    """Write what there is: a run that is stopped leaves the cells that it finished."""
    document = {"runs": arguments.runs, "minutes": round(minutes, 1), "cells": results}
    arguments.json.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    words = arguments.page.read_text(encoding="utf-8").split(BEGIN)[0]
    done = f"{len(results)} of {len(cells())} cells"
    said = f"{done}, {minutes:.0f} minutes, processes: {arguments.workers}.\n\n"
    arguments.page.write_text(f"{words}{BEGIN}\n\n{said}{page(document)}\n\n{END}\n", "utf-8")


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
            pool.submit(run_cell, cell, arguments.runs // (2 if cell.slow else 1))
            for cell in cells()
        ]
        for job in jobs:
            results.append(job.result())
            print(json.dumps(results[-1]), flush=True)
            write(results, (time.monotonic() - begin) / 60, arguments)
    failing = [r for r in results if r["short"]]
    print(f"\n{len(failing)} of {len(results)} cells fall short")


if __name__ == "__main__":
    main()
