"""600 fits of [WM] section 6: six estimators from 100 starts each, on two processes.

    python benchmarks/multistart.py [--starts 100] [--processes 2] [--no-peers]

writes `benchmarks/results/multistart.json`. manutec_r3_26: 15 positions x 100 frequencies x 36
elements x 26 parameters, starts at 10^U(-1, 1) of the truth; the data are the model's own FRFs with
3 % + 1 % noise. The goal is one minute. One evaluation of cost, gradient and Gauss-Newton matrix is
timed beside the same by plain numpy, by finite differences and by JAX, in the same run.
"""

import argparse
import json
import subprocess
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from linearisation import HERE, best, machine, peer_python

import estimators
import robotmodels
from estimators.cost import stated
from estimators.frozen_search import CorrectedModel
from robotmodels.arrays import Array
from robotmodels.kernel import CostKernel, frequency_response

RESULTS = HERE / "results" / "multistart.json"
ESTIMATORS = (
    ("LLSM15U", "lls_magnitude", "user"),
    ("LLS15U", "lls", "user"),
    ("LLS15O", "lls", "optimal"),
    ("LLS15C", "lls", "combined"),
    ("NLS15U", "nls", "user"),
    ("NLS15O", "nls", "optimal"),
)
POSITIONS, FREQUENCIES, STEP = 15, 100, 1e-6


def case() -> tuple[robotmodels.ElasticRobot, estimators.FrfEstimate]:
    """Return the robot and its simulated FRFs in random positions."""
    robot = robotmodels.load_robot("manutec_r3_26")
    rng = np.random.default_rng(0)
    low, high = robot.position_limits.T
    positions = low + (high - low) * rng.uniform(0.2, 0.8, (POSITIONS, len(low)))
    omega = 2 * np.pi * np.geomspace(3.0, 80.0, FREQUENCIES)
    noise = robotmodels.RelativeNoise(0.03, 0.01)
    return robot, estimators.simulate_frf(robot, positions, omega, noise, rng)


def ready(_: int) -> None:
    """Load compiled code in a process, which is not what is measured."""
    robot, estimate = case()
    for residual in ("nls", "lls", "lls_magnitude"):
        estimators.fit(robot, estimate, residual, max_evaluations=3)


def all_fits(starts: int, processes: int) -> dict[str, Any]:
    """Run every estimator from the same starts; return what came of it and how long it took."""
    robot, estimate = case()
    truth = robot.parameters
    points = estimators.perturbed_starts(truth, starts, 1.0, np.random.default_rng(1))
    found: dict[str, Any] = {}
    total = 0.0
    with ProcessPoolExecutor(processes) as executor:
        list(executor.map(ready, range(processes)))
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
    return {
        "fits": starts * len(ESTIMATORS),
        "processes": processes,
        "seconds": round(total, 1),
        "per_fit_and_process": round(total * processes / (starts * len(ESTIMATORS)), 3),
        "estimators": found,
    }


def evaluations(peers: bool) -> dict[str, float]:
    """Return seconds of one cost, gradient and Gauss-Newton matrix, LLS with user weights."""
    robot, estimate = case()
    problem = stated(robot, estimate, "lls", "user", (1e-3, 1e3))
    theta = robot.parameters.values * 1.1
    network = robot.network(estimate.positions, theta)
    data = network, estimate.omega, estimate.response, np.asarray(problem.weights)
    kernel = CostKernel(*data, "lls")

    def anew() -> object:
        fresh = robot.network(estimate.positions, theta)
        return CorrectedModel(problem, fresh, corrected=True)(theta)

    measured, used, root = estimate.response, problem.used, np.asarray(problem.root)

    def finite_differences(response: Callable[[Array], Any]) -> Any:
        def residual(values: Array) -> Any:
            return root * problem.kind.error(measured, response(values), used)

        columns = [residual(theta * np.exp(STEP * row)) for row in np.eye(len(theta))]
        base = residual(theta)
        slope = ((np.stack(columns, axis=-1) - base[..., None]) / STEP).reshape(-1, len(theta))
        return slope.conj().T @ base.ravel(), slope.conj().T @ slope

    ways: dict[str, Callable[[], object]] = {
        "kernel, frozen equilibria": lambda: kernel.normal_equations(theta),
        "kernel, new equilibria and their shift": anew,
        "numpy, analytic": lambda: problem.evaluate(theta),
        "numpy, finite differences": lambda: finite_differences(
            lambda v: network.frequency_response(estimate.omega, v)
        ),
        "kernel's FRFs, finite differences": lambda: finite_differences(
            lambda v: frequency_response(robot.network(estimate.positions, v), estimate.omega)
        ),
    }
    seconds = {name: best(run) for name, run in ways.items()}
    if peers:
        seconds["JAX, jacfwd"] = by_jax(kernel, theta)
    return seconds


def by_jax(kernel: CostKernel, theta: Array) -> float:
    """Return JAX's seconds for the same numbers, after a check that they are the same."""
    network, expected = kernel.network, kernel.normal_equations(theta)
    own = network.inertances
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "network.npz"), Path(folder, "out.npz")
        first, second = network.coefficients
        np.savez(
            source,
            mass=network.mass,
            damping=network.damping,
            stiffness=network.stiffness,
            selector=network.selector,
            incidence=network.incidence(),
            coordinates=own.coordinates if own is not None else np.zeros(0, dtype=int),
            first=first,
            second=second,
            exponents=network.coefficient_exponents[0],
            omega=kernel._omega,
            measured=kernel._measured,
            weights=kernel._weights,
        )
        script = HERE / "multistart_peer.py"
        subprocess.run([peer_python(), script, source, target], check=True)
        with np.load(target) as out:
            for name in ("cost", "gradient", "hessian"):
                own_value = np.asarray(getattr(expected, name))
                apart = np.abs(out[name] - own_value).max() / np.abs(own_value).max()
                if apart > 1e-6:
                    raise SystemExit(f"JAX differs in {name} by {apart:.2g}")
            return float(out["seconds"])


def main() -> None:
    """Time everything, print and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=100)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--no-peers", action="store_true")
    asked = parser.parse_args()
    one = evaluations(not asked.no_peers)
    for name, seconds in one.items():
        print(f"{name:<42} {1e3 * seconds:9.2f} ms")
    results = {
        "machine": machine(),
        "one_evaluation_seconds": one,
        "multistart": all_fits(asked.starts, asked.processes),
    }
    whole = results["multistart"]
    print(f"{whole['fits']} fits in {whole['seconds']} s on {whole['processes']} processes")
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
