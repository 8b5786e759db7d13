"""How long the simulated plant takes for a whole plan of experiments.

15 positions × 10 blocks × 6 experiments × (1 transient + 2 measured) periods of 2 s at 2 kHz, on
two threads; the goal is five minutes. Friction, quantisation and noise are on.

    python benchmarks/plant.py [ROBOT ...] [--blocks 10]
"""

import argparse
import json
import os
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

import robotmodels
from robotmodels.simulation.controller import default_controller
from robotmodels.simulation.imperfections import Imperfections
from robotmodels.simulation.simulate import simulate

RESULTS = Path(__file__).parent / "results" / "plant.json"
POSITIONS, PERIODS, TRANSIENT, SAMPLES, SAMPLE_TIME = 15, 2, 1, 4000, 5e-4
FLAWS = Imperfections(quantisation=2 * np.pi / 2**16, angle_noise=1e-5, torque_disturbance=1e-4)


def references(n: int, blocks: int, lines: Any, rng: np.random.Generator) -> Any:
    """Return orthogonal multisines, (blocks, n, SAMPLES, n) [rad/s]."""
    order = np.arange(n)
    phases = np.exp(2j * np.pi * rng.random((blocks, 1, n, len(lines))))
    turned = np.exp(2j * np.pi / n * np.outer(order, order))[None, :, :, None] * phases
    spectrum = np.zeros((blocks, n, n, SAMPLES // 2 + 1), dtype=complex)
    spectrum[..., lines] = turned * SAMPLES / 2
    return np.swapaxes(np.fft.irfft(spectrum, n=SAMPLES), 2, 3)


def timed(name: str, blocks: int, threads: int) -> dict[str, Any]:
    """Simulate the plan for one robot; return what it took."""
    robot = robotmodels.load_robot(name)
    n = len(robot.motor_names)
    rng = np.random.default_rng(1)
    lines = np.arange(5, 120, 2)
    centre, half = robot.position_limits.mean(axis=1), np.ptp(robot.position_limits, axis=1) / 2
    positions = centre + 0.4 * np.minimum(half, 2.0) * rng.uniform(-1, 1, (POSITIONS, n))
    signals = 0.3 * references(n, blocks, lines, rng)
    controller = default_controller(robot, SAMPLE_TIME)
    options: dict[str, Any] = {"lines": lines, "imperfections": FLAWS, "rng": rng}
    # Compilation, once per machine, is not what is measured.
    list(simulate(robot, positions[:1], signals[:1, :1], controller, **options))
    wall, cpu = time.perf_counter(), time.process_time()
    with ThreadPoolExecutor(threads) as pool:
        for _ in simulate(
            robot,
            positions,
            signals,
            controller,
            periods=PERIODS,
            transient=TRANSIENT,
            executor=pool,
            **options,
        ):
            pass
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    steps = POSITIONS * blocks * n * (PERIODS + TRANSIENT) * SAMPLES
    return {
        "robot": name,
        "blocks": blocks,
        "threads": threads,
        "wall_s": round(wall, 1),
        "cpu_s": round(cpu, 1),
        "cpu_us_per_sample": round(1e6 * cpu / steps, 2),
        "load_average": round(os.getloadavg()[0], 2),
    }


def main() -> None:
    """Time the plan for each robot asked for, print and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=["ur10", "manutec_r3"])
    parser.add_argument("--blocks", type=int, default=10)
    parser.add_argument("--threads", type=int, default=2)
    asked = parser.parse_args()
    results = []
    for name in asked.robots or ["ur10", "manutec_r3"]:
        results.append(timed(name, asked.blocks, asked.threads))
        print(json.dumps(results[-1]), flush=True)
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
