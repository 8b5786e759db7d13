"""Time what fits and samplers ask for: costs, gradients and Gauss-Newton matrices beside peers.

``python benchmarks/fits.py`` writes `benchmarks/results/fits.json` and prints tables. The problem:
the UR10 in 15 positions, 100 frequencies, 36 elements, 26 parameters. Peers live in the
environment of `linearisation.py`.
"""

import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numba
import numpy as np
from linearisation import HERE, best, hertz, machine, peer_python, positions

import robotmodels
from robotmodels import kernel
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.description.outputs import Output
from robotmodels.linear.noise import RelativeNoise
from robotmodels.linear.normal_equations import NormalEquations, normal_equations
from robotmodels.linear.residuals import residual_form
from robotmodels.linear.spring_network import SpringNetwork

POSITIONS = 15
FREQUENCIES = 100
WALKERS = 64
RESIDUALS = ("nls", "lls", "lls_magnitude")
STEP = 1e-6


class Problem:
    """Noisy FRFs of a robot, and parameters to evaluate at."""

    def __init__(self) -> None:
        self.robot = robotmodels.load_robot("ur10")
        self.positions = positions(self.robot, POSITIONS)
        self.omega = hertz(FREQUENCIES)
        self.network = self.robot.network(self.positions)
        G = kernel.frequency_response(self.network, self.omega)
        rng = np.random.default_rng(2)
        noise = rng.normal(size=G.shape) + 1j * rng.normal(size=G.shape)
        self.measured: ComplexArray = G * (1 + 0.03 * noise)
        self.weights: Array = 1 / RelativeNoise().variance(G)
        self.steps: Array = 0.05 * rng.normal(size=(WALKERS, len(self.network.parameters)))
        self.theta: Array = self.network.parameters.values * np.exp(self.steps)

    def kernel(self, residual: str) -> kernel.CostKernel:
        """Return the compiled cost."""
        return kernel.CostKernel(self.network, self.omega, self.measured, self.weights, residual)


def evaluation_times(problem: Problem) -> dict[str, Any]:
    """Return seconds of one cost with gradient and Gauss-Newton matrix, by residual and threads.

    "equilibria": `robot.network`, what a step that moves far does before; "moved": `CostKernel.at`.
    """
    result: dict[str, Any] = {}
    available, theta = numba.get_num_threads(), problem.theta[0]
    for residual in RESIDUALS:
        cost = problem.kernel(residual)
        cost.normal_equations(theta)
        for threads in sorted({1, available}):
            numba.set_num_threads(threads)
            seconds = best(lambda cost=cost: cost.normal_equations(theta))
            result.setdefault(residual, {})[threads] = seconds
    numba.set_num_threads(available)
    cost = problem.kernel("lls")
    result["prepare"] = best(lambda: problem.kernel("lls"))
    result["moved"] = best(lambda: cost.at(problem.network))
    result["equilibria"] = best(lambda: problem.robot.network(problem.positions, theta))
    return result


def log_probability_rates(problem: Problem) -> dict[str, Any]:
    """Return cost evaluations a second of 64 walkers at once, by residual and threads."""
    result: dict[str, Any] = {}
    available = numba.get_num_threads()
    for residual in RESIDUALS:
        cost = problem.kernel(residual)
        cost(problem.theta)
        for threads in sorted({1, available}):
            numba.set_num_threads(threads)
            seconds = best(lambda cost=cost: cost(problem.theta))
            result.setdefault(residual, {})[threads] = WALKERS / seconds
    numba.set_num_threads(available)
    return result


def run_rates(problem: Problem) -> dict[str, Any]:
    """Return cost evaluations a second and thread of runs, and of NLS of the same size beside them.

    The Manutec r3 with 26 parameters, by the runs in each position; correlated covariances of all
    torques and outputs. Then the same with three encoders behind the gears beside the motors'.
    """
    available = numba.get_num_threads()
    numba.set_num_threads(1)
    robot = robotmodels.load_robot("manutec_r3_26")
    where, omega = positions(robot, POSITIONS), problem.omega
    network = robot.network(where)
    theta = network.parameters.values * np.exp(problem.steps[:, :26])
    G = kernel.frequency_response(network, omega)
    nls = kernel.CostKernel(network, omega, G, 1 / np.abs(G) ** 2)
    result: dict[str, Any] = {"nls": WALKERS / best(lambda: nls(theta))}
    n = len(robot.motor_names)
    for runs in (1, 2, n, 2 * n):
        result |= rates_of_runs(network, omega, runs, theta)
    both = [{"motor": name, "quantity": "angle"} for name in robot.motor_names]
    both += [{"joint": f"joint{i}", "quantity": "angle"} for i in (1, 2, 3)]
    file = robot.file.model_copy(update={"outputs": [Output.model_validate(o) for o in both]})
    network = robotmodels.ElasticRobot(file, robot.folder).network(where)
    for runs in (1, n):
        result |= rates_of_runs(network, omega, runs, theta)
    numba.set_num_threads(available)
    return result


def rates_of_runs(
    network: SpringNetwork, omega: Array, runs: int, theta: Array
) -> dict[str, float]:
    """Return cost evaluations a second of so many runs, weighed together and row by row."""
    rng = np.random.default_rng(3)
    G = network.frequency_response(omega)
    m, n = G.shape[2:]
    root = rng.normal(size=(*G.shape[:2], m + n, m + n)) + 0j
    U = rng.normal(size=(*G.shape[:2], n, runs)) + 1j * rng.normal(size=(*G.shape[:2], n, runs))
    rates = {}
    for row_wise in (False, True):
        cost = kernel.RunKernel(network, omega, np.asarray(G @ U), U, root, row_wise)
        seconds = best(lambda cost=cost: cost(theta))
        by_row = ", row by row" if row_wise else ""
        rates[f"sml, {m} outputs, {runs} runs{by_row}"] = WALKERS / seconds
    return rates


def by_differences(
    network: SpringNetwork, omega: Array, measured: ComplexArray, weights: Array, theta: Array
) -> NormalEquations:
    """Return the LLS normal equations from 27 models, each solved directly by numpy."""
    root = np.sqrt(weights)

    def residuals(values: Array) -> ComplexArray:
        G = network.frequency_response(omega, values)
        return np.asarray(root * np.log(measured / G)).ravel()

    r = residuals(theta)
    steps = np.exp(STEP * np.eye(len(theta)))
    J = np.stack([(residuals(theta * step) - r) / STEP for step in steps], axis=-1)
    cost = float(np.linalg.norm(r) ** 2)
    return NormalEquations(cost, 2 * (J.conj().T @ r).real, 2 * (J.conj().T @ J).real)


def distance(found: NormalEquations, expected: NormalEquations) -> float:
    """Return the largest difference of an entry of the matrix, beside its diagonal entries."""
    size = np.sqrt(np.diag(expected.hessian))
    return float(np.max(np.abs(found.hessian - expected.hessian) / np.outer(size, size)))


def peer_times(problem: Problem) -> dict[str, Any]:
    """Return peers' seconds per evaluation of LLS, and their distance from the kernel's."""
    expected = problem.kernel("lls").normal_equations(problem.theta[0])
    costs = problem.kernel("lls")(problem.theta)
    result: dict[str, Any] = {}
    arguments = problem.omega, problem.measured, problem.weights
    theta = problem.theta[0]
    for name, run in (
        (
            "numpy, analytic",
            lambda: normal_equations(problem.network, *arguments, theta, residual_form("lls")),
        ),
        ("numpy, differences", lambda: by_differences(problem.network, *arguments, theta)),
    ):
        found = run()
        result[name] = {"seconds": best(run, 2), "difference": distance(found, expected)}
    found, seconds = run_peer("jax", problem)
    own = NormalEquations(float(found[0]), found[1], found[2])
    result["JAX, jacfwd"] = {"seconds": seconds, "difference": distance(own, expected)}
    for name, peer in (("JAX, vmap", "jax walkers"), ("numpy, loop", "numpy walkers")):
        found, seconds = run_peer(peer, problem)
        (own_costs,) = found
        apart = np.abs(own_costs / costs[: len(own_costs)] - 1).max()
        rate = len(own_costs) / seconds
        result[name] = {"evaluations_per_second": rate, "difference": float(apart)}
    return result


def run_peer(peer: str, problem: Problem) -> tuple[list[Array], float]:
    """Return what a peer computes in its own environment, and its time [s]."""
    net = problem.network
    free = [i for i, row in enumerate(net.exponents[0][: len(net.nodes)]) if row.any()]
    fields = ("mass", "stiffness", "damping", "selector", "spring_stiffness", "spring_damping")
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "data.npz"), Path(folder, "out.npz")
        np.savez(
            source,
            **{name: getattr(net, name) for name in fields},
            incidence=net.incidence(),
            free=free,
            omega=problem.omega,
            measured=problem.measured,
            weights=problem.weights,
            steps=problem.steps,
            residual="lls",
        )
        script = HERE / "fits_peers.py"
        subprocess.run([peer_python(), script, peer, source, target], check=True)
        with np.load(target) as out:
            arrays = [out[name] for name in out.files if name.startswith("arr_")]
            return arrays, float(out["seconds"])


# What is timed: more of it, such as whole multistarts, is one more function of the problem here.
SECTIONS = {
    "evaluation": evaluation_times,
    "log_probability": log_probability_rates,
    "runs": run_rates,
    "peers": peer_times,
}


def report(results: dict[str, Any]) -> None:
    """Print what was found."""
    print(f"\n{results['machine']['processor']}, load {results['machine']['load_average']:.1f}")
    own, peers = results["evaluation"], results["peers"]
    print("\ncost, gradient, Gauss-Newton matrix          ms   kernel is faster   difference")
    for residual in RESIDUALS:
        for threads, seconds in own[residual].items():
            print(f"kernel, {residual + f', {threads} thread(s)':30s}{1e3 * seconds:12.3f}")
    for name in ("prepare", "moved", "equilibria"):
        print(f"{name:38s}{1e3 * own[name]:12.3f}")
    one = own["lls"][1]
    for name, found in peers.items():
        if "seconds" in found:
            ratio = found["seconds"] / one
            milliseconds = 1e3 * found["seconds"]
            print(f"{name:38s}{milliseconds:12.1f}{ratio:17.0f} x{found['difference']:13.1e}")
    print("\ncosts                            evaluations/s   kernel is faster   difference")
    rates = results["log_probability"]
    for residual in RESIDUALS:
        for threads, rate in rates[residual].items():
            print(f"kernel, {residual + f', {threads} thread(s)':26s}{rate:12.0f}")
    for name, found in peers.items():
        if "evaluations_per_second" in found:
            rate = found["evaluations_per_second"]
            ratio = rates["lls"][1] / rate
            print(f"{name:34s}{rate:12.1f}{ratio:17.0f} x{found['difference']:13.1e}")
    print("\nruns, Manutec r3, 26 parameters   evaluations/s   of nls")
    for name, rate in results["runs"].items():
        print(f"{name:34s}{rate:12.0f}{rate / results['runs']['nls']:9.2f}")
    print("peers: LLS on all cores, beside the kernel's LLS on one thread")


def main() -> None:
    """Run everything."""
    problem = Problem()
    results: dict[str, Any] = {"machine": machine()}
    for name, section in SECTIONS.items():
        results[name] = section(problem)
    target = HERE / "results" / "fits.json"
    target.parent.mkdir(exist_ok=True)
    target.write_text(json.dumps(results, indent=2))
    report(results)
    print(f"\nwritten: {target}")


if __name__ == "__main__":
    main()
