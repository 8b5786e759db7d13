"""Time the design side on a local cluster of Dask, and count what moves through it.

``python benchmarks/cluster.py`` writes `benchmarks/results/cluster.json`: for 1, 2, 4 and 8 worker
processes beside a scheduler in a process of its own, each stage's seconds, processor seconds of
scheduler and workers, and the bytes of all tasks and results, pickled. *through the client* is the
information with matrices as results, as it is without a store. ``--quick`` takes a tenth of the
positions.
"""

import json
import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from candidates import LIMITS, SIZES
from distributed import Client
from linearisation import HERE, hertz, machine

import oed
import robotmodels
from oed.candidates.sources import Workcell, gathered_candidates

WORKERS = (1, 2, 4, 8)
FREQUENCIES = 80
STAGES = ("screening", "information", "through the client", "pricing", "design")


class Counting(Executor):
    """Counts the tasks given to another executor, and their bytes and those of their results."""

    def __init__(self, inner: Executor) -> None:
        self.inner, self.tasks, self.sent, self.received = inner, 0, 0, 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        """Give a task on."""
        self.tasks += 1
        self.sent += len(pickle.dumps((fn, args, kwargs)))
        return self.inner.submit(fn, *args, **kwargs)

    def map(self, fn: Callable[..., Any], *iterables: Any, **_: Any) -> Iterator[Any]:
        """Give tasks on and yield their results in order."""
        for future in [self.submit(fn, *args) for args in zip(*iterables, strict=False)]:
            result = future.result()
            self.received += len(pickle.dumps(result))
            yield result


def processor_seconds(pids: list[int]) -> float:
    """Return the processor time of processes and of their children [s]."""
    ticks, waiting = 0, list(pids)
    while waiting:
        pid = waiting.pop()
        stat = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        ticks += int(stat[11]) + int(stat[12])
        for children in Path(f"/proc/{pid}/task").glob("*/children"):
            waiting += map(int, children.read_text().split())
    return ticks / os.sysconf("SC_CLK_TCK")


@contextmanager
def cluster(workers: int, folder: Path) -> Iterator[tuple[Client, int, int]]:
    """Give a client and the process ids of the scheduler and of the workers' nanny."""
    address = ["--scheduler-file", str(folder / f"{workers}.json")]
    dask = [sys.executable, "-m", "dask"]
    silent: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    # Scheduler and workers load this script, too.
    paths = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    silent["env"] = os.environ | {"PYTHONPATH": paths}
    scheduler = subprocess.Popen(
        [*dask, "scheduler", *address, "--port", "0", "--no-dashboard"], **silent
    )
    threads = ["--nworkers", str(workers), "--nthreads", "1", "--no-dashboard"]
    nanny = subprocess.Popen(
        [*dask, "worker", *address, *threads, "--local-directory", folder], **silent
    )
    try:
        client = Client(scheduler_file=address[1], timeout=60)
        client.wait_for_workers(workers, timeout=120)
        client.run(loaded)
        yield client, scheduler.pid, nanny.pid
        client.close()
    finally:
        for process in (nanny, scheduler):
            process.terminate()
            process.wait()


def loaded() -> float:
    """Load and compile in a worker what the stages need."""
    robot = robotmodels.load_robot("ur10")
    positions = oed.candidate_positions(robot)[:8]
    info = oed.information(robot, positions, hertz(FREQUENCIES), robotmodels.RelativeNoise())
    return float(info.total[0, 0])


def stages(workers: int, size: int, folder: Path) -> dict[str, Any]:
    """Return what each stage takes with so many workers."""
    robot, noise = robotmodels.load_robot("ur10"), robotmodels.RelativeNoise(0.03, 0.01)
    omega, result = hertz(FREQUENCIES), {}
    with cluster(workers, folder) as (client, scheduler, nanny):

        def timed(name: str, run: Callable[[Executor], Any]) -> Any:
            pool = Counting(client.get_executor(retries=3))
            before = time.perf_counter(), *(processor_seconds([p]) for p in (scheduler, nanny))
            value = run(pool)
            seconds = time.perf_counter() - before[0]
            result[name] = {
                "seconds": seconds,
                "scheduler_cpu": processor_seconds([scheduler]) - before[1],
                "workers_cpu": processor_seconds([nanny]) - before[2],
                "tasks": pool.tasks,
                "sent_bytes": pool.sent,
                "received_bytes": pool.received,
            }
            return value

        screened = timed(
            "screening",
            lambda pool: gathered_candidates(
                robot,
                per_joint=SIZES[size],
                limits=LIMITS,
                workcell=Workcell(floor=0.0),
                executor=pool,
            ),
        )
        where, store = screened.positions, folder / "information.oed"
        info = timed(
            "information",
            lambda pool: oed.information(robot, where, omega, noise, executor=pool, store=store),
        )
        timed(
            "through the client",
            lambda pool: len(oed.information(robot, where, omega, noise, executor=pool)),
        )
        timed(
            "pricing", lambda pool: replace(info, executor=pool).directional_derivatives(info.total)
        )
        design = timed("design", lambda pool: oed.optimal_design(replace(info, executor=pool)))
    return result | {"candidates": len(where), "gap": design.gap, "value": design.value}


def main() -> None:
    """Run all numbers of workers."""
    size = 10_000 if "--quick" in sys.argv else 100_000
    results: dict[str, Any] = {"machine": machine()}
    home = HERE.parent / ".bench"
    home.mkdir(exist_ok=True)
    for workers in WORKERS:
        with tempfile.TemporaryDirectory(dir=home) as folder:
            results[str(workers)] = measured = stages(workers, size, Path(folder))
        for stage in STAGES:
            print(f"{workers} workers, {stage}: {measured[stage]}", flush=True)
    target = HERE / "results" / "cluster.json"
    target.parent.mkdir(exist_ok=True)
    target.write_text(json.dumps(results, indent=2))
    print(f"\nwritten: {target}")


if __name__ == "__main__":
    main()
