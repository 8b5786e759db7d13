"""Run all cells of simulated studies and write what they show: `make trust`."""

import argparse
import json
import os
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from trust_cells import GROUPS, Cell, Outcome, known_noise_std, linearisation_of, runs
from trust_page import write_page
from trust_results import failures, summary

RUNS = 400
REPEATED = 3
"""A cell that falls short at first is repeated; all its runs together are judged.

Widths are medians, which more runs leave as they are.
"""

UNWRITTEN = ("all_coverage", "scatter_over_std", "bias", "reasons")
"""Figures that help to find a cause, and that the page has no use for."""

DOCS = Path(__file__).parents[2] / "docs"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--only",
        default="",
        help="cells whose group and name contain this; others stay as they were",
    )
    parser.add_argument("--no-repeat", action="store_true")
    parser.add_argument("--json", type=Path, default=DOCS / "trust.json")
    parser.add_argument("--page", type=Path, default=DOCS / "trust.md")
    arguments = parser.parse_args()
    begin = time.monotonic()
    cells = [
        (group, cell)
        for group, listed in GROUPS.items()
        for cell in listed()
        if arguments.only in f"{group}: {cell.name}"
    ]
    repeated = 1 if arguments.no_repeat else REPEATED
    with ProcessPoolExecutor(arguments.workers) as pool:
        jobs = [pool.submit(run_cell, cell, arguments.runs, repeated) for _, cell in cells]
        results = []
        for (group, _), job in zip(cells, jobs, strict=True):
            result = {"group": group, **job.result()}
            results.append(result)
            _print(result)
    minutes = (time.monotonic() - begin) / 60
    document = {"runs": arguments.runs, "minutes": round(minutes, 1), "cells": results}
    if arguments.only:
        document = _merged(json.loads(arguments.json.read_text()), results)
    arguments.json.write_text(_json(document))
    write_page(arguments.page, document)
    failing = [r for r in results if r["failures"]]
    print(f"\n{len(failing)} of {len(results)} cells fall short, {minutes:.1f} minutes")
    for result in failing:
        print(f"  {result['group']}: {result['cell']}: {'; '.join(result['failures'])}")


def run_cell(cell: Cell, count: int, repeated: int) -> dict[str, Any]:
    """Return the figures of a cell and what it falls short of; repeated if that is anything."""
    known = known_noise_std(cell, linearisation_of(cell))
    begin = time.process_time()
    outcomes: list[Outcome] = runs(cell, 0, count)
    result = summary(cell, outcomes, known)
    short = failures(cell, result)
    if repeated > 1 and any(not line.startswith("width") for line in short):
        outcomes += runs(cell, count, (repeated - 1) * count)
        result = summary(cell, outcomes, known)
        short = failures(cell, result)
    each = 1e3 * (time.process_time() - begin) / len(outcomes)
    return _plain({**result, "milliseconds": each, "failures": short})


def _merged(document: dict[str, Any], results: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the document of an earlier run with the cells in it that were run again."""
    again = {(r["group"], r["cell"]): r for r in results}
    cells = [again.get((r["group"], r["cell"]), r) for r in document["cells"]]
    return {**document, "cells": cells}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items() if k not in UNWRITTEN}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(v) for v in value]
    if isinstance(value, (float, np.floating)):
        return float(f"{value:.3g}") if np.isfinite(value) else None
    return value


def _json(document: dict[str, Any]) -> str:
    """Return the document with one cell a line."""
    head = {k: v for k, v in document.items() if k != "cells"}
    cells = ",\n".join(json.dumps(cell) for cell in document["cells"])
    return f'{json.dumps(head)[:-1]}, "cells": [\n{cells}\n]}}\n'


def _print(result: dict[str, Any]) -> None:
    coverage = 100 * np.array(result["coverage"])
    verdicts = ", ".join(f"{k} {100 * v:.1f}" for k, v in result["verdicts"].items())
    print(
        f"{result['group']}: {result['cell']}: {coverage.mean():.1f} [{coverage.min():.1f}, "
        f"{coverage.max():.1f}] width {np.median(result['width']):.2f}; {verdicts}; "
        f"{result['milliseconds']:.1f} ms{'  FALLS SHORT: ' if result['failures'] else ''}"
        f"{'; '.join(result['failures'])}",
        flush=True,
    )


if __name__ == "__main__":
    main()
