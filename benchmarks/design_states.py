"""The designs a person waits for, by two states of this package in turn, for `design.py`.

``python design_states.py INFORMATION.h5`` times them with the package that Python finds and prints
JSON. `state_times` does so with this package and with another checkout of it, one after the other,
so that what else the machine does meets both.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from linearisation import HERE

import oed

CASES = {
    "D, cvxpy, 1000": (1_000, "D", "cvxpy"),
    "D, cvxpy, 7920": (7_920, "D", "cvxpy"),
    "D, cvxpy, 20000": (20_000, "D", "cvxpy"),
    "A, 20000": (20_000, "A", "auto"),
    "E, 20000": (20_000, "E", "auto"),
}
TURNS, REPEATS = 1, 3


def state_times(info: oed.InformationSet, before: Path) -> dict[str, Any]:
    """Return processor times of both states [s], the least of all turns, and their ratios."""
    least: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "information.h5")
        info.save(path)
        for _ in range(TURNS):
            for state, checkout in (("before", before), ("now", HERE.parent)):
                run = in_state(checkout, [HERE / "design_states.py", path])
                for case, entry in json.loads(run).items():
                    old = least.setdefault(case, {}).get(state)
                    if old is None or entry["cpu_seconds"] < old["cpu_seconds"]:
                        least[case][state] = entry
    for case, entry in least.items():
        entry["ratio"] = entry["before"]["cpu_seconds"] / entry["now"]["cpu_seconds"]
        print(f"  {case}: {entry}", flush=True)
    return least


def in_state(checkout: Path, arguments: list[Any]) -> str:
    """Return what a script prints that runs with the package of a checkout."""
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    command = [sys.executable, *arguments]
    run = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    return run.stdout


def main() -> None:
    """Time every case; what it imports is loaded before, by a small one."""
    info, times = oed.InformationSet.load(sys.argv[1]), {}
    for case, (count, criterion, solver) in CASES.items():
        some = oed.InformationSet(info.positions[:count], info.matrices[:count], info.names)
        few = oed.InformationSet(info.positions[:200], info.matrices[:200], info.names)
        # States before "auto" have the barrier method or cvxpy by default.
        options = {} if solver == "auto" else {"solver": solver}
        oed.optimal_design(few, criterion, **options)
        wall, cpu = [], []
        for _ in range(REPEATS):
            start = time.perf_counter(), time.process_time()
            design = oed.optimal_design(some, criterion, **options)
            wall.append(time.perf_counter() - start[0])
            cpu.append(time.process_time() - start[1])
        times[case] = {
            "seconds": min(wall),
            "cpu_seconds": min(cpu),
            "gap": design.gap,
            "value": design.value,
        }
    print(json.dumps(times))


if __name__ == "__main__":
    main()
