"""What a person waits for at `oed run studies/ur10.yaml`, beside another checkout in the same run.

    python benchmarks/waiting.py [--peer CHECKOUT] [--repeats 3] [--first]

writes `benchmarks/results/waiting.json`. Each case is run in turns here and there, and the least of
the repeats counts, by the clock and in processor time of all processes:

- scratch: no stage is there, machine code is;
- unchanged: the same command again;
- report: all stages are there, the page is not;
- posterior: other settings of the posterior, so that its draws are others;
- first: scratch, and the folder of machine code is empty (only with `--first`, half a minute each).
"""

import argparse
import contextlib
import ctypes
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).parents[1]
RESULTS = HERE / "benchmarks" / "results" / "waiting.json"
_SET_CHILD_SUBREAPER = 36
"""Of prctl(2)."""

CASES = ("scratch", "unchanged", "report", "posterior", "first")


def timed(checkout: Path, study: Path, cache: Path | None = None) -> dict[str, float]:
    """Return what `oed run` of a checkout takes, by the clock and in processor time [s]."""
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    command = [sys.executable, "-m", "reports.cli", "run", str(study)]
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, env=environment, cwd=checkout, capture_output=True)
    wall = time.perf_counter() - begun
    wait_for_orphans()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"wall_s": round(wall, 2), "cpu_s": round(cpu, 2)}


def adopt_orphans() -> None:
    """Become the parent of processes that outlive the command, so that their time counts too."""
    ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def wait_for_orphans() -> None:
    """Wait for the ends of all child processes."""
    with contextlib.suppress(ChildProcessError):
        while True:
            os.wait()


def prepared(case: str, folder: Path, repeat: int) -> Path:
    """Return the study of a case, its output as the case has it."""
    study, output = folder / "studies" / "ur10.yaml", folder / "out" / "ur10"
    text = (HERE / "studies" / "ur10.yaml").read_text(encoding="utf-8")
    study.parent.mkdir(exist_ok=True)
    if case in ("scratch", "first"):
        shutil.rmtree(output, ignore_errors=True)
    if case == "report":
        (output / "report.html").unlink()
    if case == "posterior":
        text = text.replace("walkers: 64", f"walkers: {66 + 2 * repeat}")
    study.write_text(text, encoding="utf-8")
    return study


def least(entries: list[dict[str, float]]) -> dict[str, float]:
    """Return the least of the repeats, and how busy the machine was."""
    best = {key: min(entry[key] for entry in entries) for key in entries[0]}
    return best | {"load_average": round(os.getloadavg()[0], 1)}


def main() -> None:
    """Time every case in each checkout, print and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peer", type=Path, help="another checkout, such as the state before")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--first", action="store_true")
    asked = parser.parse_args()
    adopt_orphans()
    checkouts = {"here": HERE} | ({"peer": asked.peer.resolve()} if asked.peer else {})
    results: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as name:
        for case in CASES if asked.first else CASES[:-1]:
            entries: dict[str, list[dict[str, float]]] = {key: [] for key in checkouts}
            for repeat in range(asked.repeats):
                for key, checkout in checkouts.items():
                    folder = Path(name) / key
                    folder.mkdir(exist_ok=True)
                    cache = Path(name) / f"{key} {repeat}" if case == "first" else None
                    entries[key].append(timed(checkout, prepared(case, folder, repeat), cache))
            results[case] = {key: least(entry) for key, entry in entries.items()}
            print(json.dumps({case: results[case]}), flush=True)
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
