"""Time optimal designs beside peers, in one run on one machine.

``python benchmarks/design.py`` writes `benchmarks/results/design.json` and prints tables: D-optimal
designs of `manutec_r3_26` (26 parameters) in 1 000, 7 920 and 20 000 random positions, every
criterion by both solvers, robust designs, an exact plan, the information itself, and a million
candidates from a store. ``python benchmarks/design.py --quick`` leaves out the million and peers
above 1 000 candidates; ``--before CHECKOUT`` times D, A and E with another checkout of this package
too, in turn with this one. This script installs the peers into ``.bench/``; none is a dependency.
"""

import json
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from design_million import million_times
from design_others import SIZES, peer_times
from design_states import state_times
from linearisation import HERE, hertz, machine

import oed
import robotmodels
from robotmodels import kernel
from robotmodels.common.arrays import Array

MIDDLE = SIZES[1]
SAMPLES = 8
FREQUENCIES = 40
WORKERS = 2


def positions(robot: robotmodels.ElasticRobot, count: int) -> Array:
    """Return random positions inside the joint limits, (Q, n) [rad]."""
    low, high = robot.position_limits.T
    return np.random.default_rng(1).uniform(low, high, (count, len(low)))


def information_times(count: int) -> tuple[oed.InformationSet, dict[str, Any]]:
    """Return the information of positions, and how long it took in this process and in a pool."""
    robot = robotmodels.load_robot("manutec_r3_26")
    where, omega, noise = positions(robot, count), hertz(FREQUENCIES), robotmodels.RelativeNoise()
    oed.information(robot, where[:64], omega, noise)  # compiles, or reads the cache
    start = time.perf_counter()
    info = oed.information(robot, where, omega, noise)
    result: dict[str, Any] = {"positions": count, "threads": time.perf_counter() - start}
    with ProcessPoolExecutor(WORKERS) as executor:
        start = time.perf_counter()
        pooled = oed.information(robot, where, omega, noise, executor=executor)
        result[f"{WORKERS} processes"] = time.perf_counter() - start
    result["difference"] = float(np.abs(pooled.matrices - info.matrices).max())
    print(f"  information: {result}", flush=True)
    return info, result


def information_at(info: oed.InformationSet, theta: Array) -> oed.InformationSet:
    """Return the same positions' information for other parameters."""
    robot = robotmodels.load_robot("manutec_r3_26")
    omega, noise = hertz(FREQUENCIES), robotmodels.RelativeNoise()
    matrices = [
        kernel.information(robot.network(part, theta), omega, noise)
        for part in np.array_split(info.positions, max(1, len(info) // 64))
    ]
    return oed.InformationSet(info.positions, np.concatenate(matrices), info.names)


def part(info: oed.InformationSet, count: int) -> oed.InformationSet:
    """Return the first candidates."""
    return oed.InformationSet(info.positions[:count], info.matrices[:count], info.names)


def clocked(run: Callable[[], Any], repeats: int) -> dict[str, float]:
    """Return the least wall and processor time of some runs [s]."""
    wall, cpu = [], []
    for _ in range(repeats):
        start = time.perf_counter(), time.process_time()
        run()
        wall.append(time.perf_counter() - start[0])
        cpu.append(time.process_time() - start[1])
    return {"seconds": min(wall), "cpu_seconds": min(cpu)}


def timed(info: Any, criterion: Any = "D", repeats: int = 3, **options: Any) -> dict[str, Any]:
    """Return the time and the certificate of a design, or why there is none."""
    try:
        design = oed.optimal_design(info, criterion, **options)
        times = clocked(lambda: oed.optimal_design(info, criterion, **options), repeats)
    except robotmodels.IdentificationError as error:
        return {"failed": str(error)}
    return times | {
        "gap": design.gap,
        "support": len(design.support),
        "rounds": design.rounds,
        "solver": design.solver,
    }


def own_times(info: oed.InformationSet) -> dict[str, Any]:
    """Return D-optimal designs by size and solver."""
    result: dict[str, Any] = {}
    for solver, repeats in (("newton", 5), ("cvxpy", 3)):
        result[solver] = {n: timed(part(info, n), "D", repeats, solver=solver) for n in SIZES}
        print(f"  D, {solver}: {result[solver]}", flush=True)
    return result


def criteria_times(info: oed.InformationSet) -> dict[str, Any]:
    """Return every criterion by both solvers."""
    names, rng = info.names, np.random.default_rng(3)
    contrast = np.zeros(len(names))
    contrast[[3, 7]] = 1.0, -1.0
    durations = rng.uniform(20.0, 60.0, len(info))
    cases: dict[str, tuple[Any, Any]] = {
        "D": ("D", None),
        "A": ("A", None),
        "E": ("E", None),
        "c": (oed.CCriterion(contrast), None),
        "D_s": (oed.DsCriterion(names[:12]), None),
        "A_s": (oed.AsCriterion(names[:12]), None),
        "D, at most 1 of 15 in a position": ("D", oed.Constraints(experiments=15, most=1)),
        "D, 900 s": ("D", oed.Constraints(time=900, durations=durations, most=2)),
    }
    result: dict[str, Any] = {}
    for label, (criterion, constraints) in cases.items():
        for solver, repeats in (("newton", 3), ("cvxpy", 1)):
            if label == "E" and solver == "newton":
                continue
            found = timed(info, criterion, repeats, constraints=constraints, solver=solver)
            result[f"{label}, {solver}"] = found
            print(f"  {label}, {solver}: {found.get('seconds', found)}", flush=True)
    return result


def robust_times(info: oed.InformationSet) -> dict[str, Any]:
    """Return designs over samples of theta, 20 % standard deviation of each parameter.

    The time is that of the robust design; `with_local_seconds` is that of `robust_design`, with
    every sample's own design.
    """
    theta = robotmodels.load_robot("manutec_r3_26").parameters.values
    steps = 0.2 * np.random.default_rng(4).standard_normal((SAMPLES - 1, len(info.names)))
    sets = [info, *(information_at(info, theta * np.exp(step)) for step in steps)]
    samples, result = oed.InformationSamples(tuple(sets)), {}
    references = [oed.optimal_design(s, solver="newton").value / len(info.names) for s in sets]
    for kind, wanted in (
        ("average", oed.AverageCriterion()),
        ("maximin", oed.MaximinCriterion("D", references)),
    ):
        start = time.perf_counter()
        robust = oed.robust_design(samples, "D", kind, solver="newton")
        result[kind] = {
            "with_local_seconds": time.perf_counter() - start,
            "efficiency": robust.efficiency.tolist(),
            "nominal_efficiency": robust.nominal_efficiency.tolist(),
        } | timed(samples, wanted, 3, solver="newton")
        print(f"  {kind}: {result[kind]['seconds']}", flush=True)
    return result


def exact_times(info: oed.InformationSet) -> dict[str, Any]:
    """Return the time of a plan of 15 from its relaxed design, and that of the proven best one."""
    design = oed.optimal_design(info, solver="newton")
    plan = oed.exact_design(info, 15, design)
    times: dict[str, Any] = clocked(lambda: oed.exact_design(info, 15, design), 5)
    start = time.perf_counter(), time.process_time()
    best = oed.best_plans(info, 15, design=design)
    return times | {
        "efficiency": plan.efficiency,
        "proof_seconds": time.perf_counter() - start[0],
        "proof_cpu_seconds": time.process_time() - start[1],
        "proven": best.proven,
        "proof_nodes": best.nodes,
    }


def report(results: dict[str, Any]) -> None:
    """Print the tables, with ratios of processor times to both own solvers."""
    print(f"\n{results['machine']['processor']}, load {results['machine']['load_average']:.1f}")
    print("\nD-optimal              candidates        s    cpu s       gap   newton    cvxpy")
    own = {
        solver: {str(n): e for n, e in found.items()} for solver, found in results["own"].items()
    }
    for solver, found in own.items():
        for n, entry in found.items():
            print(f"{solver:23s}{n:>10s}{_numbers(entry)}")
    for name, entry in results["peers"].items():
        peer, n = name.rsplit(", ", 1)
        if "cpu_seconds" not in entry:
            print(f"{peer:23s}{n:>10s}  {entry.get('failed') or 'above ' + entry['limit']}")
            continue
        times = (own[s].get(n, {}).get("cpu_seconds", np.nan) for s in ("newton", "cvxpy"))
        ratios = "".join(f"{entry['cpu_seconds'] / t:7.1f} x" for t in times)
        print(f"{peer:23s}{n:>10s}{_numbers(entry)}{ratios}")
    print(f"\nother criteria, {MIDDLE} candidates            s    cpu s       gap   support")
    for name, entry in (results["criteria"] | results["robust"]).items():
        tail = f"{entry['support']:10d}" if "support" in entry else entry["failed"]
        print(f"{name:40s}{_numbers(entry)}{tail}")
    for what in ("before", "exact", "information", "million"):
        print(f"\n{what}: {results[what] or 'left out'}")


def _numbers(entry: dict[str, Any]) -> str:
    if "gap" not in entry:
        return " "
    return f"{entry['seconds']:9.3f}{entry['cpu_seconds']:9.3f}{entry['gap']:10.1e}"


def main() -> None:
    """Run everything; what is done is written after each part."""
    quick = "--quick" in sys.argv
    before = sys.argv[sys.argv.index("--before") + 1] if "--before" in sys.argv else None
    target = HERE / "results" / "design.json"
    target.parent.mkdir(exist_ok=True)
    results: dict[str, Any] = {"machine": machine()}
    info, results["information"] = information_times(SIZES[-1])
    middle = part(info, MIDDLE)
    few = part(info, SIZES[0])
    parts: dict[str, Callable[[], Any]] = {
        "own": lambda: own_times(info),
        "before": lambda: state_times(info, Path(before)) if before else None,
        "exact": lambda: exact_times(middle),
        "criteria": lambda: criteria_times(middle),
        "robust": lambda: robust_times(few if quick else middle),
        "million": lambda: None if quick else million_times(middle, HERE.parent / ".bench"),
        "peers": lambda: peer_times(info, SIZES[:1] if quick else SIZES),
    }
    for name, run in parts.items():
        results[name] = run()
        target.write_text(json.dumps(results, indent=2))
    report(results)
    print(f"\nwritten: {target}")


if __name__ == "__main__":
    main()
