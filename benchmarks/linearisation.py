"""Time the information of one position: the kernel beside peers, in one run on one machine.

``python benchmarks/linearisation.py`` writes `benchmarks/results/linearisation.json` and prints
tables. Peers are installed into ``.bench/`` by this script; no peer is a dependency.
"""

import json
import os
import platform
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numba
import numpy as np

import oed
import robotmodels
from robotmodels import kernel
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.kernel.elimination_order import layout
from robotmodels.linear.noise import RelativeNoise
from robotmodels.linear.spring_network import SpringNetwork

HERE = Path(__file__).resolve().parent
PEERS = ("numpy", "jax", "control")
PACKAGES = ("numpy", "scipy", "jax", "control")
FREQUENCIES = 100
POSITIONS = 200
WHOLE_POSITIONS = 2000
REPEATS = 7
DGEMM = """
import numpy, time
a = numpy.random.default_rng(0).normal(size=(1500, 1500))
def once():
    start = time.perf_counter(); a @ a; return time.perf_counter() - start
print(2 * 1500**3 / min(once() for _ in range(5)))
"""


def hertz(n: int) -> Array:
    """Return angular frequencies of `n` lines from 2 to 80 Hz [rad/s]."""
    return 2 * np.pi * np.linspace(2.0, 80.0, n)


def positions(robot: robotmodels.ElasticRobot, n_positions: int) -> Array:
    """Return random positions, (Q, n) [rad]."""
    low, high = np.clip(robot.position_limits, -2.0, 2.0).T
    return np.random.default_rng(1).uniform(low, high, (n_positions, len(low)))


def network(n_positions: int) -> SpringNetwork:
    """Return the UR10's network at random positions."""
    robot = robotmodels.load_robot("ur10")
    return robot.network(positions(robot, n_positions))


class Kronecker:
    """A separable noise law: one full matrix over inputs, one diagonal over outputs, everywhere."""

    def factors(self, network: SpringNetwork, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        """Return U and V, (Q, F, n, n) each."""
        n = network.selector.shape[1]
        near = np.diag(np.full(n - 1, 0.2j), 1)
        shape = len(network.mass), len(omega), n, n
        power, output = np.eye(n) + near + near.conj().T, np.eye(n, dtype=complex)
        return np.broadcast_to(power, shape), np.broadcast_to(output, shape)


def best(
    run: Callable[[], object],
    repeats: int = REPEATS,
    clock: Callable[[], float] = time.perf_counter,
) -> float:
    """Return the least of some times [s]; what else the machine does only adds."""
    times = []
    for _ in range(repeats):
        start = clock()
        run()
        times.append(clock() - start)
    return min(times)


def flops(net: SpringNetwork, frequencies: int) -> int:
    """Return the floating-point operations one position needs; a complex product-and-add has 8."""
    plan = layout(net)
    assert plan is not None
    rows, n, m = len(plan.order) - plan.pad, len(plan.motors), len(plan.needed)
    elements, springs = n * (n + 1) // 2, rows - (plan.first - plan.pad) - n
    factor = sum((rows - k - 1) * (rows - k) // 2 * 8 + (rows - k - 1) * 6 for k in range(rows))
    driven = sum((n - r) * (n - 1 - r) * 8 for r in range(n))
    needed = sum(n * (rows - 1 - i) * 8 for i in range(rows - n - springs, rows - n))
    products = (
        m * (12 * n + 6 * elements) + 2 * m * elements + m * (m + 1) // 2 * (8 * elements + 6)
    )
    assembly = 3 * rows * (rows + 1) // 2 + 40 * n + 20 * elements
    return frequencies * (factor + driven + needed + products + assembly)


def part(net: SpringNetwork, n_positions: int) -> SpringNetwork:
    """Return the first positions of a network."""
    fields = ("mass", "stiffness", "spring_stiffness", "spring_damping", "exponents")
    arrays = {name: getattr(net, name)[:n_positions] for name in fields}
    return SpringNetwork(
        **arrays,
        damping=net.damping,
        selector=net.selector,
        nodes=net.nodes,
        parameters=net.parameters,
    )


def kernel_times(net: SpringNetwork, noise: RelativeNoise) -> dict[str, Any]:
    """Return seconds per position by threads, and seconds by positions and by frequencies."""
    w = hertz(FREQUENCIES)
    start = time.perf_counter()
    kernel.information(part(net, 1), w, noise)
    result: dict[str, Any] = {"first_call": time.perf_counter() - start, "per_position": {}}
    available = numba.get_num_threads()
    for threads in sorted({1, available}):
        numba.set_num_threads(threads)
        seconds = best(lambda: kernel.information(net, w, noise)) / POSITIONS
        result["per_position"][threads] = seconds
    numba.set_num_threads(1)
    separable = best(lambda: kernel.information(net, w, Kronecker())) / POSITIONS
    result["separable_per_position"] = separable
    result["by_positions"] = {
        q: best(lambda q=q: kernel.information(part(net, q), w, noise)) for q in (25, 50, 100, 200)
    }
    result["by_frequencies"] = {
        f: best(lambda f=f: kernel.information(net, hertz(f), noise))
        for f in (24, 48, 96, 192, 384)
    }
    numba.set_num_threads(available)
    result["cost_evaluations_per_second"] = cost_rate(part(net, 15), w, noise)
    return result


def whole_times(noise: RelativeNoise) -> dict[str, float]:
    """Return seconds per position, on all threads, from joint angles on.

    "oed.information": all of it, as users call it; "its processor time": of all threads together.
    Parts: "network", equilibria under gravity, mass matrices and gravity's stiffness, by Pinocchio,
    while the kernel is at the positions before; "check" of the same matrices, were they the user's.
    """
    robot = robotmodels.load_robot("ur10")
    q, w = positions(robot, WHOLE_POSITIONS), hertz(FREQUENCIES)
    found = oed.information(robot, q, w, noise)
    seconds = {
        "oed.information": best(lambda: oed.information(robot, q, w, noise)),
        "its processor time": best(
            lambda: oed.information(robot, q, w, noise), clock=time.process_time
        ),
        "network": best(lambda: robot.network(q)),
        "check": best(lambda: oed.InformationSet(q, found.matrices, found.names)),
    }
    return {name: x / len(q) for name, x in seconds.items()}


def cost_rate(net: SpringNetwork, omega: Array, noise: RelativeNoise) -> dict[str, float]:
    """Return evaluations a second, one thread, of costs at 64 sets of parameters."""
    G = kernel.frequency_response(net, omega)
    rng = np.random.default_rng(2)
    measured = G * (1 + 0.03 * rng.normal(size=G.shape) + 0.03j * rng.normal(size=G.shape))
    p = len(net.parameters)
    theta = net.parameters.values * np.exp(0.05 * rng.normal(size=(64, p)))
    available, rates = numba.get_num_threads(), {}
    numba.set_num_threads(1)
    for residual in ("nls", "lls"):
        cost = kernel.CostKernel(net, omega, measured, 1 / noise.variance(G), residual)
        cost(theta)
        rates[residual] = 64 / best(lambda cost=cost: cost(theta))
    numba.set_num_threads(available)
    return rates


def peer_python(name: str = "linearisation", packages: Sequence[str] = PACKAGES) -> Path:
    """Return the interpreter of the peers' own environment, made on the first run."""
    home = HERE.parent / ".bench" / name
    python = home / "bin" / "python"
    if not (home / "installed").exists():
        venv.create(home, with_pip=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *packages], check=True)
        (home / "installed").touch()
    return python


def peer_times(net: SpringNetwork, expected: Array) -> dict[str, Any]:
    """Return each peer's times per position [s] and its distance from the kernel's matrices."""
    python = peer_python()
    free = [i for i, row in enumerate(net.exponents[0][: len(net.nodes)]) if row.any()]
    result = {}
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "network.npz"), Path(folder, "out.npz")
        fields = ("mass", "stiffness", "damping", "selector", "spring_stiffness", "spring_damping")
        arrays = {name: getattr(net, name) for name in fields}
        omega = hertz(FREQUENCIES)
        np.savez(source, **arrays, incidence=net.incidence(), free=free, omega=omega)
        for peer in PEERS:
            script = HERE / "linearisation_peers.py"
            subprocess.run([python, script, peer, source, target], check=True)
            with np.load(target) as out:
                found, seconds = out["matrices"], float(out["seconds"])
                processor = float(out["processor"])
            own = expected[: len(found)]
            size = np.sqrt(np.einsum("qii->qi", own))
            error = np.abs(found - own) / size[:, :, None] / size[:, None, :]
            result[peer] = {
                "per_position": seconds,
                "processor_time": processor,
                "difference": float(error.max()),
            }
    return result


def machine() -> dict[str, Any]:
    """Return what the figures depend on, with the rate of a large matrix product per thread."""
    info = Path("/proc/cpuinfo")
    models = (
        [x for x in info.read_text().splitlines() if "model name" in x] if info.exists() else []
    )
    one = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    rate = subprocess.run(
        [sys.executable, "-c", DGEMM], env=one, check=True, capture_output=True, text=True
    ).stdout
    return {
        "processor": models[0].split(":")[1].strip() if models else platform.processor(),
        "cores": os.cpu_count(),
        "load_average": os.getloadavg()[0],
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
        "matrix_product_flops_per_thread": float(rate),
    }


def growth(times: dict[int, float]) -> float:
    """Return the exponent of a power law through the times; 1 is linear."""
    x, y = np.log(list(times)), np.log(list(times.values()))
    return float(np.polyfit(x, y, 1)[0])


def report(results: dict[str, Any]) -> None:
    """Print what was found."""
    own, rate = results["kernel"], results["machine"]["matrix_product_flops_per_thread"]
    fastest = min(own["per_position"].values())
    print(f"\n{results['machine']['processor']}, load {results['machine']['load_average']:.1f}")
    whole = results["whole"]
    print("\nway                     ms/position  kernel: faster  oed: faster  by processor time")
    for threads, seconds in own["per_position"].items():
        print(f"kernel, {threads} thread(s)      {1e3 * seconds:12.4f}")
    print(f"the same, separable noise{1e3 * own['separable_per_position']:12.4f}  (one thread)")
    for name, seconds in results["whole"].items():
        print(f"{name:25s}{1e3 * seconds:12.4f}")
    for peer, found in results["peers"].items():
        seconds = found["per_position"]
        used = found["processor_time"] / whole["its processor time"]
        ratios = f"{seconds / fastest:14.0f} x{seconds / whole['oed.information']:11.0f} x"
        print(f"{peer:25s}{1e3 * seconds:12.4f}{ratios}{used:17.0f} x")
    worst = max(found["difference"] for found in results["peers"].values())
    print(f"largest difference of a peer's matrices: {worst:.1e}")
    print("oed.information starts from joint angles; the kernel and peers are given the network")
    print(f"\nkernel {own['flops_per_second'] / 1e9:.1f} Gflop/s per thread", end=", ")
    print(f"matrix product {rate / 1e9:.1f} Gflop/s: {own['flops_per_second'] / rate:.2f} of it")
    print(f"first call {own['first_call']:.2f} s (compiling, or reading the cache)")
    print(f"growth: positions^{own['growth_positions']:.2f}", end=", ")
    print(f"frequencies^{own['growth_frequencies']:.2f}")
    for residual, number in own["cost_evaluations_per_second"].items():
        print(f"{residual} costs, one thread: {number:.0f} evaluations/s")


def main() -> None:
    """Run everything."""
    noise, net = RelativeNoise(), network(POSITIONS)
    results: dict[str, Any] = {"machine": machine(), "kernel": kernel_times(net, noise)}
    own = results["kernel"]
    own["flops_per_second"] = flops(net, FREQUENCIES) / own["per_position"][1]
    own["growth_positions"] = growth(own["by_positions"])
    own["growth_frequencies"] = growth(own["by_frequencies"])
    results["whole"] = whole_times(noise)
    results["peers"] = peer_times(net, kernel.information(net, hertz(FREQUENCIES), noise))
    target = HERE / "results" / "linearisation.json"
    target.parent.mkdir(exist_ok=True)
    target.write_text(json.dumps(results, indent=2))
    report(results)
    print(f"\nwritten: {target}")


if __name__ == "__main__":
    main()
