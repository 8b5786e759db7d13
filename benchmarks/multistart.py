"""600 fits of [WM] section 6: six estimators from 100 starts each, on two processes.

    python benchmarks/multistart.py [--starts 100] [--processes 2]

writes `benchmarks/results/multistart.json`. manutec_r3_26: 15 positions x 100 frequencies x 36
elements x 26 parameters, starts at 10^U(-1, 1) of the truth; the data are the model's own FRFs with
3 % + 1 % noise. The goal is one minute. What one evaluation takes, and takes by other means, is in
`fits.py`.
"""

import argparse
import json
import os
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
from linearisation import HERE, machine

import estimators
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


def case() -> tuple[robotmodels.ElasticRobot, estimators.FrfEstimate]:
    """Return the robot and its simulated FRFs in random positions."""
    robot = robotmodels.load_robot("manutec_r3_26")
    rng = np.random.default_rng(0)
    low, high = robot.position_limits.T
    positions = low + (high - low) * rng.uniform(0.2, 0.8, (POSITIONS, len(low)))
    omega = 2 * np.pi * np.geomspace(3.0, 80.0, FREQUENCIES)
    noise = robotmodels.RelativeNoise(0.03, 0.01)
    return robot, estimators.simulate_frf(robot, positions, omega, noise, rng)


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
    total = 0.0
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
            print(name, json.dumps(found[name]), flush=True)
    # Of processes that have ended. Where others use the machine this is what compares.
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = spent.ru_utime + spent.ru_stime - sum(before.values())
    return {
        "fits": starts * len(ESTIMATORS),
        "processes": processes,
        "seconds": round(total, 1),
        "cpu_seconds_per_fit": round(cpu / (starts * len(ESTIMATORS)), 3),
        "per_fit_and_process": round(total * processes / (starts * len(ESTIMATORS)), 3),
        "estimators": found,
    }


def main() -> None:
    """Time everything, print and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=100)
    parser.add_argument("--processes", type=int, default=2)
    asked = parser.parse_args()
    whole = all_fits(asked.starts, asked.processes)
    results = {"machine": machine(), "multistart": whole}
    print(
        f"{whole['fits']} fits in {whole['seconds']} s on {whole['processes']} processes, "
        f"{whole['cpu_seconds_per_fit']} CPU s each"
    )
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
