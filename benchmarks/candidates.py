"""Time grids of candidates of the UR10, screened and designed over, from ten thousand on.

``python benchmarks/candidates.py`` writes `benchmarks/results/candidates.json`; each size runs in a
process of its own, ``python benchmarks/candidates.py SIZE``, with two workers: candidates screened
among floor and links, their information written to a store, a certified D-optimal design over it.
Screening stands beside every pair compared in every one of some positions. ``--large`` adds three
and ten millions (25 GB on disk), ``--quick`` ends at a hundred thousand, and ``--before CHECKOUT``
runs each size with another checkout of this package as well.
"""

import json
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
from design_million import largest_resident
from design_states import in_state
from linearisation import HERE, hertz, machine

import oed
import robotmodels
from oed.candidates.sources import Workcell, gathered_candidates
from robotmodels.elastic.rigid_pose import configurations

LIMITS = {
    "shoulder_pan_joint": (0.0, 1.5708),
    "shoulder_lift_joint": (-2.6, -0.5),
    "elbow_joint": (-2.5, 2.5),
    "wrist_1_joint": (-2.4, 2.4),
    "wrist_2_joint": (-2.4, 2.4),
    "wrist_3_joint": (-2.0, 2.0),
}
SIZES = {
    10_000: (3, 5, 5, 5, 5, 5),
    100_000: (4, 8, 8, 8, 7, 7),
    1_000_000: (4, 12, 12, 12, 12, 12),
    3_000_000: (4, 15, 15, 15, 15, 15),
    10_000_000: (4, 19, 19, 19, 19, 19),
}
COMPARED = 20_000  # positions in which every pair is compared for the time it takes
FREQUENCIES = 80
WORKERS = 2


def processor_seconds() -> float:
    """Return the processor time of this process and of the workers that have ended [s]."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def clocked(run: Callable[[robotmodels.ProcessPool], Any]) -> tuple[Any, dict[str, float]]:
    """Return what a run with a pool of its own returns, and its time by clock and processors [s].

    Workers begin, and load what they need, before; the processor time is with that.
    """
    with robotmodels.ProcessPool(WORKERS) as pool:
        list(pool.map(small, range(WORKERS)))
        start, before = time.perf_counter(), processor_seconds()
        result = run(pool)
        seconds = time.perf_counter() - start
    return result, {"seconds": seconds, "cpu_seconds": processor_seconds() - before}


def lent(pool: robotmodels.ProcessPool | None) -> dict[str, Any]:
    """Return a pool for screening, which in older states of the package has no use for one."""
    takes_one = "executor" in signature(gathered_candidates).parameters
    return {"executor": pool} if takes_one else {}


def small(_: int) -> float:
    """Compute the information of a few positions."""
    time.sleep(0.5)  # so that no worker takes two
    robot = robotmodels.load_robot("ur10")
    positions = oed.candidate_positions(robot)[:8]
    info = oed.information(robot, positions, hertz(FREQUENCIES), robotmodels.RelativeNoise())
    return float(info.total[0, 0])


def compared_everywhere(robot: robotmodels.ElasticRobot, positions: np.ndarray) -> float:
    """Return the processor time of every pair of shapes in every position, by position [s]."""
    checker = robotmodels.surroundings(robot, floor=0.0)._checker
    start = time.process_time()
    checker(configurations(robot, positions))
    return (time.process_time() - start) / len(positions)


def measured(size: int, folder: Path) -> dict[str, Any]:
    """Return the times of one size."""
    robot, noise = robotmodels.load_robot("ur10"), robotmodels.RelativeNoise(0.03, 0.01)
    cell = Workcell(floor=0.0)
    screened, screening = clocked(
        lambda pool: gathered_candidates(
            robot, per_joint=SIZES[size], limits=LIMITS, workcell=cell, **lent(pool)
        )
    )
    positions, store = screened.positions, folder / "information.oed"
    info, informing = clocked(
        lambda pool: oed.information(
            robot, positions, hertz(FREQUENCIES), noise, executor=pool, store=store
        )
    )
    shared = hasattr(info, "executor")
    design, designing = clocked(
        lambda pool: oed.optimal_design(replace(info, executor=pool) if shared else info)
    )
    beginning = clocked(lambda _: None)[1]["cpu_seconds"]
    for times in (screening, informing, designing):
        times["cpu_seconds"] -= beginning
    resident = largest_resident()
    grid = oed.candidate_positions(robot, SIZES[size], LIMITS)
    some = grid[np.random.default_rng(0).permutation(len(grid))[:COMPARED]]
    everywhere = compared_everywhere(robot, some) * len(grid) if lent(None) else None
    return {
        "grid": len(grid),
        "candidates": len(positions),
        "screening": screening,
        "screening_cpu_every_pair": everywhere,
        "information": informing,
        "gigabytes": store.stat().st_size / 1e9,
        "design": designing | {"gap": design.gap, "rounds": design.rounds},
        "resident_mb": resident,
    }


def main() -> None:
    """Run the sizes, each in a process of its own."""
    home = HERE.parent / ".bench"
    home.mkdir(exist_ok=True)
    sizes = [size for size in SIZES if str(size) in sys.argv]
    if sizes:
        with tempfile.TemporaryDirectory(dir=home) as folder:
            print(json.dumps(measured(sizes[0], Path(folder))))
        return
    last = 100_000 if "--quick" in sys.argv else 10_000_000 if "--large" in sys.argv else 1_000_000
    states = {"": HERE.parent}
    if "--before" in sys.argv:
        states[", before"] = Path(sys.argv[sys.argv.index("--before") + 1])
    results: dict[str, Any] = {"machine": machine()}
    for size in (size for size in SIZES if size <= last):
        for state, checkout in states.items():
            run = json.loads(in_state(checkout, [__file__, str(size)]))
            results[f"{size}{state}"] = run
            print(f"{size}{state}: {run}", flush=True)
    target = HERE / "results" / "candidates.json"
    target.parent.mkdir(exist_ok=True)
    target.write_text(json.dumps(results, indent=2))
    print(f"\nwritten: {target}")


if __name__ == "__main__":
    main()
