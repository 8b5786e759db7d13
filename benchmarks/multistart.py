"""600 fits from far starts and 1 050 fits from the truth, beside another checkout in the same run.

    python benchmarks/multistart.py [--starts 100] [--processes 2] [--peer CHECKOUT] [--repeats 3]

writes `benchmarks/results/multistart.json`: the least of the repeats, which take turns.

- multistart, [WM] section 6: six estimators from 100 starts each at 10^U(-1, 1) of the truth.
  manutec_r3_26: 15 positions x 100 frequencies x 36 elements x 26 parameters; the data are the
  model's own FRFs with 3 % + 1 % noise.
- comparison: seven plans of 15 experiments with the UR10, 60 frequencies, 150 simulated each.

What one evaluation takes, and takes by other means, is in `fits.py`.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from linearisation import HERE, machine

import estimators
import oed
import robotmodels

RESULTS = HERE / "results" / "multistart.json"
ESTIMATORS = (
    ("LLSM15U", "lls_magnitude", "user"),
    ("LLS15U", "lls", "user"),
    ("LLS15O", "lls", "optimal"),
    ("LLS15C", "lls", "combined"),
    ("NLS15U", "nls", "user"),
    ("NLS15O", "nls", "optimal"),
)
POSITIONS, FREQUENCIES = 15, 100
PLANS, RUNS = 7, 150


def case() -> tuple[robotmodels.ElasticRobot, estimators.FrfEstimate]:
    """Return the robot and its simulated FRFs in random positions."""
    robot = robotmodels.load_robot("manutec_r3_26")
    rng = np.random.default_rng(0)
    low, high = robot.position_limits.T
    positions = low + (high - low) * rng.uniform(0.2, 0.8, (POSITIONS, len(low)))
    omega = 2 * np.pi * np.geomspace(3.0, 80.0, FREQUENCIES)
    noise = robotmodels.RelativeNoise(0.03, 0.01)
    return robot, estimators.simulate_frf(robot, positions, omega, noise, rng)


def children() -> float:
    """Return the processor time of child processes that have ended [s]."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


def ready(_: int) -> tuple[int, float]:
    """Load compiled code in a process, which is not what is measured; return its id and CPU [s]."""
    robot, estimate = case()
    for residual in ("nls", "lls", "lls_magnitude"):
        estimators.fit(robot, estimate, residual, max_evaluations=3)
    return os.getpid(), time.process_time()


def all_fits(starts: int, processes: int) -> dict[str, Any]:
    """Run every estimator from the same starts; return what came of it and how long it took."""
    robot, estimate = case()
    truth = robot.parameters
    points = estimators.perturbed_starts(truth, starts, 1.0, np.random.default_rng(1))
    found: dict[str, Any] = {}
    total, earlier = 0.0, children()
    with ProcessPoolExecutor(processes) as executor:
        before = dict(executor.map(ready, range(processes)))
        for name, residual, weights in ESTIMATORS:
            begun = time.perf_counter()
            fits = estimators.multistart(
                robot, estimate, points, residual, weights, executor=executor
            )
            seconds = time.perf_counter() - begun
            total += seconds
            best_cost = fits[0].cost
            found[name] = {
                "seconds": round(seconds, 2),
                "converged": sum(one.converged for one in fits),
                "at_the_best_cost": sum(one.cost <= best_cost * (1 + 1e-6) for one in fits),
                "no_equilibrium_at_the_start": sum(one.status == -1 for one in fits),
                "evaluations_median": float(np.median([one.evaluations for one in fits])),
                "largest_error_of_ln": float(
                    np.abs(np.log(fits[0].parameters.values / truth.values)).max()
                ),
            }
    cpu = children() - earlier - sum(before.values())
    return {
        "fits": starts * len(ESTIMATORS),
        "processes": processes,
        "seconds": round(total, 1),
        "cpu_seconds_per_fit": round(cpu / (starts * len(ESTIMATORS)), 3),
        "per_fit_and_process": round(total * processes / (starts * len(ESTIMATORS)), 3),
        "estimators": found,
    }


def comparison(processes: int) -> dict[str, float]:
    """Return what `oed.compare_plans` takes, by the clock and in processor time."""
    robot, rng = robotmodels.load_robot("ur10"), np.random.default_rng(0)
    low, high = robot.position_limits.T
    positions = low + (high - low) * rng.uniform(0.2, 0.8, (200, len(low)))
    omega = 2 * np.pi * np.linspace(3.0, 60.0, 60)
    noise = robotmodels.RelativeNoise(0.03, 0.01)
    info = oed.information(robot, positions, omega, noise)
    counts = [np.zeros(len(positions), dtype=int) for _ in range(PLANS)]
    for count in counts:
        np.add.at(count, rng.integers(len(positions), size=POSITIONS), 1)
    plans = {f"plan {k}": count for k, count in enumerate(counts)}
    with ProcessPoolExecutor(processes) as executor:
        before = dict(executor.map(ready, range(processes)))
        begun = time.perf_counter()
        oed.compare_plans(
            robot, info, positions, plans, omega, noise, rng=rng, runs=RUNS, executor=executor
        )
        seconds = time.perf_counter() - begun
    cpu = children() - sum(before.values())
    return {"fits": PLANS * RUNS, "seconds": round(seconds, 2), "cpu_seconds": round(cpu, 2)}


def measured(starts: int, processes: int) -> dict[str, Any]:
    """Return both cases in this process and its pools, with the package that it imports."""
    compared = comparison(processes)
    return {"multistart": all_fits(starts, processes), "comparison": compared}


def of_checkout(checkout: Path, starts: int, processes: int) -> dict[str, Any]:
    """Return both cases by the package of a checkout, in a process of its own."""
    command = [sys.executable, __file__, "--starts", str(starts), "--processes", str(processes)]
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    output = subprocess.run(
        [*command, "--child"], check=True, env=environment, capture_output=True, text=True
    ).stdout
    return dict(json.loads(output.splitlines()[-1]))


def main() -> None:
    """Time everything, print and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=100)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--peer", type=Path, help="another checkout, such as the state before")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.child:
        print(json.dumps(measured(asked.starts, asked.processes)))
        return
    checkouts = {"here": HERE.parent} | ({"peer": asked.peer.resolve()} if asked.peer else {})
    results: dict[str, Any] = {"machine": machine()}
    for _ in range(asked.repeats):
        for key, checkout in checkouts.items():
            found = of_checkout(checkout, asked.starts, asked.processes)
            before = results.setdefault(key, found)
            for case in ("multistart", "comparison"):
                if found[case]["seconds"] < before[case]["seconds"]:
                    before[case] = found[case]
            figures = {k: v for k, v in found["multistart"].items() if k != "estimators"}
            print(key, json.dumps([figures, found["comparison"]]), flush=True)
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
