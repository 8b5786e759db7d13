"""Panels of FRFs on a page: seconds and bytes, as SVG written here and drawn by matplotlib.

    python benchmarks/pages.py [--positions 15]

writes `benchmarks/results/pages.json`. Responses of a UR10 in random positions at 80 frequencies,
6 x 6 elements with a model between the lines, best of three. The goal is 0.5 s and, for the study
`studies/ur10.yaml` with all else on its page, 1.5 MB. Until version 0.2 one pair of matplotlib axes
held all panels of a position.
"""

import argparse
import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from linearisation import HERE, machine

import estimators
import robotmodels
from reports.figures.bode import bode
from reports.figures.response_data import ResponseData, between
from reports.figures.response_panels import response_panels
from reports.figures.svg import inline

BEFORE = {"seconds": 0.225, "bytes": 175_000}
"""Of a position, as version 0.1 drew it."""

RESULTS = HERE / "results" / "pages.json"


def best(work: Callable[[], int]) -> tuple[float, int]:
    """Return the shortest processor time [s] of three and the bytes."""
    seconds = []
    for _ in range(3):
        start = time.process_time()
        size = work()
        seconds.append(time.process_time() - start)
    return min(seconds), size


def measured(positions: int) -> dict[str, Any]:
    """Return seconds and bytes of each way."""
    robot, rng = robotmodels.load_robot("ur10"), np.random.default_rng(0)
    omega = 2 * np.pi * np.geomspace(2.0, 80.0, 80)
    angles = rng.uniform(-1.0, 1.0, (positions, 6)) + robot.position_limits.mean(axis=1)
    noise = robotmodels.RelativeNoise(0.03, 0.01)
    estimate = estimators.simulate_frf(robot, angles, omega, noise, rng)
    fine, names = between(omega), robot.motor_names
    model, std = robotmodels.frequency_response(robot, angles, fine), np.sqrt(estimate.variance)

    def written() -> int:
        return sum(
            len(
                response_panels(
                    omega, estimate.response[q], std[q], model[q], names, fitted_omega=fine
                ).svg(f"in-{q}", "panels")
            )
            for q in range(positions)
        )

    def embedded() -> int:
        data = ResponseData(omega, estimate.response, std, estimate.repetitions, fine, model)
        return len(data.embedded([f"{q}" for q in range(positions)], names, names, names))

    def drawn() -> int:  # one position, as it takes long; pictures of points where SVG is large
        curves = bode(omega, estimate.response[0], std[0], names, names, (fine, model[0], None))
        return len(inline(curves, "in-0", "panels"))

    ways = {"panels as SVG": written, "data of the script": embedded, "matplotlib, one": drawn}
    return {
        name: dict(zip(("seconds", "bytes"), best(work), strict=True))
        for name, work in ways.items()
    }


def main() -> None:
    """Print the table and write the results."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--positions", type=int, default=15)
    positions = parser.parse_args().positions
    results = measured(positions)
    for name, one in results.items():
        print(f"{name:20} {one['seconds']:7.3f} s {one['bytes']:10,} bytes")
    panels = results["panels as SVG"]
    ratio = {name: positions * value / panels[name] for name, value in BEFORE.items()}
    print(f"before: {ratio['seconds']:.1f} times the seconds, {ratio['bytes']:.1f} times the bytes")
    RESULTS.parent.mkdir(exist_ok=True)
    content = {"machine": machine(), "positions": positions, "ratio": ratio, "ways": results}
    RESULTS.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
