"""Time optimal designs beside peers, in one run on one machine.

``python benchmarks/design.py`` writes `benchmarks/results/design.json` and prints tables: D-optimal
designs of `manutec_r3_26` (26 parameters) in 1 000, 7 920 and 20 000 random positions, every
criterion by both solvers, robust designs, an exact plan, and a million candidates from a store.
``python benchmarks/design.py --quick`` leaves out the million and peers above 1 000 candidates.
Peers are installed into ``.bench/`` by this script; no peer is a dependency.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from linearisation import HERE, best, hertz, machine, peer_python

import oed
import robotmodels
from oed.design.coordinates import whiten
from robotmodels.arrays import Array

SIZES = (1_000, 7_920, 20_000)
MIDDLE = SIZES[1]
MILLION = 1_000_000
SAMPLES = 8
FREQUENCIES = 40
TIMEOUT = 900
PACKAGES = ("figaroh==1.0.2", "pydex==0.0.9", "cvxpy", "clarabel", "scs")
# figaroh needs memory with the square of the candidates: 5.4 GB for 1 000.
PEERS = {
    "cvxpy primal, Clarabel": SIZES[:2],
    "cvxpy dual, Clarabel": SIZES[:2],
    "cvxpy dual, SCS": SIZES[:2],
    "pydex": SIZES[:1],
    "figaroh": (300,),
}
STORED = """
import json, resource, sys, time, oed
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
store = oed.InformationSet.open(sys.argv[1])
start = time.perf_counter()
design = oed.optimal_design(store, solver="newton")
seconds = time.perf_counter() - start
after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(json.dumps({"seconds": seconds, "gap": design.gap, "rounds": design.rounds,
                  "support": len(design.support), "resident_mb": after / 1e3,
                  "before_mb": before / 1e3}))
"""


def positions(robot: robotmodels.ElasticRobot, count: int) -> Array:
    """Return random positions inside the joint limits, (Q, n) [rad]."""
    low, high = robot.position_limits.T
    return np.random.default_rng(1).uniform(low, high, (count, len(low)))


def information(count: int, theta: Array | None = None) -> oed.InformationSet:
    """Return the information of positions, for other parameters if given."""
    robot = robotmodels.load_robot("manutec_r3_26")
    where, omega, noise = positions(robot, count), hertz(FREQUENCIES), robotmodels.RelativeNoise()
    if theta is None:
        return oed.information(robot, where, omega, noise)
    from robotmodels import kernel

    matrices = [
        kernel.information(robot.network(part, theta), omega, noise)
        for part in np.array_split(where, max(1, count // 64))
    ]
    return oed.InformationSet(where, np.concatenate(matrices), robot.parameters.names)


def part(info: oed.InformationSet, count: int) -> oed.InformationSet:
    """Return the first candidates."""
    return oed.InformationSet(info.positions[:count], info.matrices[:count], info.names)


def timed(info: Any, criterion: Any = "D", repeats: int = 3, **options: Any) -> dict[str, Any]:
    """Return the time and the certificate of a design, or why there is none."""
    try:
        design = oed.optimal_design(info, criterion, **options)
        seconds = best(lambda: oed.optimal_design(info, criterion, **options), repeats)
    except robotmodels.IdentificationError as error:
        return {"failed": str(error)}
    return {
        "seconds": seconds,
        "gap": design.gap,
        "support": len(design.support),
        "rounds": design.rounds,
        "solver": design.solver,
    }


def own_times(info: oed.InformationSet) -> dict[str, Any]:
    """Return D-optimal designs by size and solver."""
    result: dict[str, Any] = {}
    for solver, repeats in (("newton", 5), ("cvxpy", 1)):
        result[solver] = {n: timed(part(info, n), "D", repeats, solver=solver) for n in SIZES}
        print(f"  D, {solver}: {result[solver]}", flush=True)
    return result


def criteria_times(info: oed.InformationSet) -> dict[str, Any]:
    """Return every criterion at the middle size by both solvers."""
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
    """Return designs over samples of theta, 20 % standard deviation of each parameter."""
    robot = robotmodels.load_robot("manutec_r3_26")
    steps = 0.2 * np.random.default_rng(4).standard_normal((SAMPLES - 1, len(info.names)))
    sets = [info]
    for step in steps:
        sets.append(information(len(info), robot.parameters.values * np.exp(step)))
        print(f"  information of sample {len(sets)} of {SAMPLES}", flush=True)
    samples, result = oed.InformationSamples(tuple(sets)), {}
    for kind in ("average", "maximin"):
        robust = oed.robust_design(samples, "D", kind, solver="newton")
        local = [oed.optimal_design(one, solver="newton") for one in sets]
        references = [design.value / len(info.names) for design in local]
        wanted = (
            oed.AverageCriterion() if kind == "average" else oed.MaximinCriterion("D", references)
        )
        result[kind] = timed(samples, wanted, 2, solver="newton") | {
            "efficiency": robust.efficiency.tolist(),
            "nominal_efficiency": robust.nominal_efficiency.tolist(),
        }
    return result


def exact_times(info: oed.InformationSet) -> dict[str, Any]:
    """Return the time of a plan of 15 from its relaxed design."""
    design = oed.optimal_design(info, solver="newton")
    plan = oed.exact_design(info, 15, design)
    seconds = best(lambda: oed.exact_design(info, 15, design), 3)
    return {"seconds": seconds, "efficiency": plan.efficiency}


def million_times(info: oed.InformationSet, folder: Path) -> dict[str, Any]:
    """Return a design over a million candidates in a store, read by a process of its own.

    They are random mixtures of two of the robot's positions, of random strength.
    """
    rng = np.random.default_rng(5)

    def chunks() -> Iterator[Array]:
        for start in range(0, MILLION, 5000):
            i, j = rng.integers(0, len(info), (2, 5000))
            share = rng.uniform(size=(5000, 1, 1))
            mixed = share * info.matrices[i] + (1 - share) * info.matrices[j]
            yield mixed * np.exp(0.1 * rng.standard_normal((5000, 1, 1)))
            if start % 100_000 == 0:
                print(f"  {start} candidates stored", flush=True)

    path = folder / "million.oed"
    from oed.store import write_store

    start = time.perf_counter()
    write_store(path, np.zeros((MILLION, 1)), info.names, chunks())
    written = time.perf_counter() - start
    run = subprocess.run(
        [sys.executable, "-c", STORED, path], check=True, capture_output=True, text=True
    )
    size = path.stat().st_size
    return json.loads(run.stdout) | {"written_seconds": written, "gigabytes": size / 1e9}


def peer_times(info: oed.InformationSet, sizes: tuple[int, ...]) -> dict[str, Any]:
    """Return each peer's time and the gap of its weights, certified like our own."""
    python, result = peer_python("design", PACKAGES), {}
    white = whiten(info.matrices, info.total / len(info))
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "matrices.npy"), Path(folder, "out.npz")
        for peer, counts in PEERS.items():
            for n in (n for n in counts if n <= max(sizes)):
                np.save(source, white[:n])
                result[f"{peer}, {n}"] = one_peer(python, peer, source, target, white[:n])
                print(f"  {peer}, {n}: {result[f'{peer}, {n}']}", flush=True)
    return result


def one_peer(python: Path, peer: str, source: Path, target: Path, white: Array) -> dict[str, Any]:
    """Run one peer in its own process."""
    command = [python, HERE / "design_peers.py", peer, source, target]
    try:
        subprocess.run(command, check=True, capture_output=True, timeout=TIMEOUT)
    except subprocess.TimeoutExpired:
        return {"failed": f"more than {TIMEOUT} s"}
    except subprocess.CalledProcessError as error:
        return {"failed": error.stderr.decode(errors="replace").strip().splitlines()[-1][:200]}
    with np.load(target) as out:
        weights, seconds = np.maximum(out["weights"], 0.0), float(out["seconds"])
    return {"seconds": seconds, "gap": oed.optimality_gap(weights, white)}


def report(results: dict[str, Any]) -> None:
    """Print the tables, with ratios to the best peer at the same number of candidates."""
    peers = results["peers"]
    print(f"\n{results['machine']['processor']}, load {results['machine']['load_average']:.1f}")
    print("\nD-optimal                  candidates        s       gap   slower than newton")
    for solver, found in results["own"].items():
        for n, entry in found.items():
            print(f"{solver:27s}{n:10d}{entry['seconds']:9.3f}{entry['gap']:10.1e}")
    for name, entry in peers.items():
        peer, n = name.rsplit(", ", 1)
        if "failed" in entry:
            print(f"{peer:27s}{n:>10s}  failed: {entry['failed']}")
            continue
        newton = results["own"]["newton"].get(int(n), {}).get("seconds", np.nan)
        ratio = entry["seconds"] / newton
        print(f"{peer:27s}{n:>10s}{entry['seconds']:9.2f}{entry['gap']:10.1e}{ratio:12.0f} x")
    print(f"\nother criteria, {MIDDLE} candidates          s       gap   support")
    for name, entry in (results["criteria"] | results["robust"]).items():
        if "failed" in entry:
            print(f"{name:40s} failed: {entry['failed']}")
        else:
            numbers = f"{entry['seconds']:9.3f}{entry['gap']:10.1e}{entry['support']:9d}"
            print(f"{name:40s}{numbers}")
    print(f"\nexact plan of 15: {results['exact']}")
    if "million" in results:
        print(f"million: {results['million']}")


def main() -> None:
    """Run everything."""
    quick = "--quick" in sys.argv
    info = information(SIZES[-1])
    middle = part(info, MIDDLE)
    results: dict[str, Any] = {"machine": machine(), "own": own_times(info)}
    results["peers"] = peer_times(middle, SIZES[:1] if quick else SIZES[:2])
    results["criteria"] = criteria_times(middle)
    results["robust"] = robust_times(part(info, 1_000) if quick else middle)
    results["exact"] = exact_times(middle)
    if not quick:
        with tempfile.TemporaryDirectory(dir=HERE.parent / ".bench") as folder:
            results["million"] = million_times(middle, Path(folder))
    target = HERE / "results" / "design.json"
    target.parent.mkdir(exist_ok=True)
    target.write_text(json.dumps(results, indent=2))
    report(results)
    print(f"\nwritten: {target}")


if __name__ == "__main__":
    main()
