"""A design over a million candidates in a store, for `design.py`.

``python design_million.py STORE`` opens a store in a process of its own and prints, as JSON, what a
design over it takes.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import oed
from oed.information_sets.stored_information import write_store
from robotmodels.common.arrays import Array

MILLION = 1_000_000
_CHUNK = 5_000


def million_times(info: oed.InformationSet, home: Path) -> dict[str, Any]:
    """Return how long a design takes over random mixtures of two positions, of random strength."""
    with tempfile.TemporaryDirectory(dir=home) as folder:
        return in_folder(info, Path(folder))


def in_folder(info: oed.InformationSet, folder: Path) -> dict[str, Any]:
    """Write the store and time a design over it."""
    path = folder / "million.oed"
    start = time.perf_counter()
    write_store(path, np.zeros((MILLION, 1)), info.names, mixtures(info))
    written = time.perf_counter() - start
    command = [sys.executable, __file__, path]
    run = subprocess.run(command, check=True, capture_output=True, text=True)
    size = path.stat().st_size
    return json.loads(run.stdout) | {"written_seconds": written, "gigabytes": size / 1e9}


def mixtures(info: oed.InformationSet) -> Iterator[Array]:
    """Yield the matrices, some thousands at a time."""
    rng = np.random.default_rng(5)
    for start in range(0, MILLION, _CHUNK):
        i, j = rng.integers(0, len(info), (2, _CHUNK))
        share = rng.uniform(size=(_CHUNK, 1, 1))
        strength = np.exp(0.1 * rng.standard_normal((_CHUNK, 1, 1)))
        yield strength * (share * info.matrices[i] + (1 - share) * info.matrices[j])
        if start % 100_000 == 0:
            print(f"  {start} candidates stored", flush=True)


def largest_resident() -> float:
    """Return the most memory this process ever held [MB]."""
    status = Path("/proc/self/status")
    if status.exists():  # getrusage counts the process that this one was started from
        line = next(x for x in status.read_text().splitlines() if x.startswith("VmHWM"))
        return float(line.split()[1]) / 1e3
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def main() -> None:
    """Time one design; what it imports is loaded before, by a tiny one."""
    store = oed.InformationSet.open(sys.argv[1])
    few = oed.InformationSet(np.zeros((100, 1)), store.take(np.arange(100)), store.names)
    oed.optimal_design(few, solver="newton")
    before = largest_resident()
    start = time.perf_counter(), time.process_time()
    design = oed.optimal_design(store, solver="newton")
    found = {
        "seconds": time.perf_counter() - start[0],
        "cpu_seconds": time.process_time() - start[1],
        "gap": design.gap,
        "rounds": design.rounds,
        "support": len(design.support),
        "resident_mb": largest_resident(),
        "before_mb": before,
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main()
