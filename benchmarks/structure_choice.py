"""Hidden springs: how often the choice of structure has them at their places, and says so before.

``python benchmarks/structure_choice.py --runs 300 --out structure.json`` adds runs to the file and
prints the calibration of the predicted probabilities. A run hides one to three springs in a robot
of the library: anywhere that `possible_springs` names, one to ``--stiffest`` times as stiff as its
own springs, with damping times of 0.2 to 8 ms. FRFs have 3 % noise, weights are those of the
measured FRF, and the fit without the hidden springs starts within a factor of two of the truth.
"""

import argparse
import json
import math
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from estimators import choose_structure, fit, simulate_frf, structure_power
from robotmodels import (
    IdentificationError,
    RelativeNoise,
    frequency_response,
    load_robot,
    possible_springs,
    with_springs,
)

ROBOTS = ("ur10", "panda", "manutec_r3_26", "ur5", "kr240_class")
NOISE = RelativeNoise(0.03, 0.01)
POSITIONS, LINES, LEVEL = 8, 40, 0.01


def run(seed: int, stiffest: float, fresh: bool = False) -> dict[str, object]:
    """Return one run: what was hidden, predicted and chosen."""
    rng = np.random.default_rng([2026, seed])
    robot = load_robot(ROBOTS[seed % len(ROBOTS)])
    elements = possible_springs(robot)
    low, high = np.clip(robot.position_limits, -2.0, 2.0).T
    positions = rng.uniform(low, high, (POSITIONS, len(low)))
    omega = 2 * np.pi * np.linspace(2.0, 80.0, LINES)
    mean = np.exp(np.mean([math.log(float(s.stiffness)) for s in robot.file.springs]))
    hidden = []
    for i in rng.choice(len(elements), rng.integers(1, 4), replace=False):
        stiffness = mean * stiffest ** rng.uniform()
        damping = stiffness * 2e-4 * 40.0 ** rng.uniform()
        values = {"stiffness": stiffness, "damping": damping}
        hidden.append(elements[i].model_copy(update=values))
    truth = with_springs(robot, hidden, free=True)
    noise = np.random.default_rng([5000 + seed, 77]) if fresh else rng
    estimate = simulate_frf(truth, positions, omega, NOISE, noise)
    estimate = replace(estimate, covariance=NOISE.variance(estimate.response))
    start = robot.parameters.values * 2.0 ** rng.uniform(-1, 1, len(robot.parameters))
    base = fit(robot, estimate, "nls", "optimal", start)
    without = frequency_response(robot, positions, omega)
    plan = fit(robot, replace(estimate, response=without), "nls", "optimal", max_evaluations=1)
    powers = structure_power(plan, hidden, elements, level=LEVEL)
    choice = choose_structure(base, elements, level=LEVEL, most=5)
    names = {spring.name for spring in hidden}
    twins = {p.name: set(p.twins) | set(choice.twins.get(p.name, ())) for p in powers}
    chosen = {spring.name for spring in choice.springs}
    false = [
        name
        for name in chosen - names
        if not any(name in group for group in twins.values())
        and not names & set(choice.twins[name])
    ]
    return {
        "seed": seed,
        "robot": robot.name,
        "hidden": sorted(names),
        "chosen": sorted(chosen),
        "predicted": math.prod(p.right_place for p in powers),
        "powers": [
            [p.name, p.misfit, min(p.alternative_misfit, 1e9), p.right_place] for p in powers
        ],
        "twins": {name: sorted(group) for name, group in twins.items()},
        "exact": chosen == names,
        "false": false,
        "cost": choice.fit.cost,
        "expected_cost": estimate.response.size,
        "steps": [str(step) for step in choice.steps],
        "stopped": choice.stopped,
    }


def wilson(hits: int, count: int) -> float:
    """Return the lower end of the 95 % interval of a share."""
    if not count:
        return 0.0
    z, p = 1.96, hits / count
    centre, half = p + z**2 / (2 * count), z * math.sqrt(p * (1 - p) / count + (z / count) ** 2 / 4)
    return max((centre - half) / (1 + z**2 / count), 0.0)


def report(runs: list[dict[str, object]]) -> str:
    """Return the calibration of runs as a Markdown table."""
    edges = (0.0, 0.05, 0.5, 0.8, 0.95, 0.99, 1.0000001)
    lines = ["| predicted | runs | mean | exactly right | lower 95 % limit | false place |"]
    lines.append("|---|---|---|---|---|---|")
    groups = [(f"{a:g} to {min(b, 1):g}", a, b) for a, b in pairwise(edges)]
    for name, low, high in [*groups, ("0.95 or more", 0.95, 2.0), ("all", 0.0, 2.0)]:
        group = [r for r in runs if low <= float(str(r["predicted"])) < high]
        if not group:
            continue
        hits = sum(bool(r["exact"]) for r in group)
        mean = np.mean([float(str(r["predicted"])) for r in group])
        false = np.mean([bool(r["false"]) for r in group])
        lines.append(
            f"| {name} | {len(group)} | {mean:.2f} | {hits / len(group):.2f} | "
            f"{wilson(hits, len(group)):.2f} | {false:.3f} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Add runs to the file and print their calibration."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--stiffest", type=float, default=50.0, help="in units of the robot's own")
    parser.add_argument("--fresh", action="store_true", help="the same runs with other noise")
    parser.add_argument("--out", type=Path, default=Path("structure_choice.json"))
    arguments = parser.parse_args()
    runs = json.loads(arguments.out.read_text()) if arguments.out.exists() else []
    done = {one["seed"] for one in runs}
    for seed in range(arguments.first, arguments.first + arguments.runs):
        if seed in done:
            continue
        try:
            one = run(seed, arguments.stiffest, arguments.fresh)
        except IdentificationError as error:
            one = {"seed": seed, "error": str(error)}
        runs.append(one)
        arguments.out.write_text(json.dumps(runs, indent=1))
        print(seed, {k: one.get(k) for k in ("predicted", "exact", "false", "error")}, flush=True)
    print(report([one for one in runs if "error" not in one]))
    print(f"{sum('error' in one for one in runs)} of {len(runs)} runs without a result")


if __name__ == "__main__":
    sys.exit(main())
