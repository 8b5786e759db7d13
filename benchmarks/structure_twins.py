"""Twins of a robot before measuring: springs that data of a plan cannot tell apart.

``python benchmarks/structure_twins.py ur10`` assumes every spring that the robot could have, one at
a time, as stiff as its own springs on average and with a damping time of 1 ms, and lists those
that another one imitates to within noise (8 positions, 40 lines, 3 % noise).
"""

import argparse
import math

import numpy as np

from estimators import FrfEstimate, StructurePower, fit, structure_power
from robotmodels import RelativeNoise, frequency_response, load_robot, possible_springs

NOISE, POSITIONS, LINES = RelativeNoise(0.03, 0.01), 8, 40


def powers(name: str, seed: int) -> list[StructurePower]:
    """Return what data tell of each possible spring."""
    robot = load_robot(name)
    low, high = np.clip(robot.position_limits, -2.0, 2.0).T
    positions = np.random.default_rng(seed).uniform(low, high, (POSITIONS, len(low)))
    omega = 2 * np.pi * np.linspace(2.0, 80.0, LINES)
    response = frequency_response(robot, positions, omega)
    ones = np.ones(POSITIONS, dtype=int)
    exact = FrfEstimate(positions, omega, response, NOISE.variance(response), ones)
    plan = fit(robot, exact, "nls", "optimal", max_evaluations=1)
    elements = possible_springs(robot)
    mean = np.exp(np.mean([math.log(float(s.stiffness)) for s in robot.file.springs]))
    values = {"stiffness": mean, "damping": 1e-3 * mean}
    assumed = [element.model_copy(update=values) for element in elements]
    return [structure_power(plan, [spring], elements)[0] for spring in assumed]


def main() -> None:
    """Print the springs with twins, and how many have none or do not show."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robot", nargs="?", default="ur10")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    every = powers(arguments.robot, arguments.seed)
    for power in every:
        if power.twins:
            print(
                f"{power}; misfit {power.misfit:.3g}, of the best alternative "
                f"{power.alternative_misfit:.3g}"
            )
    alone = sum(not p.twins and p.detection > 0.95 for p in every)
    unseen = sum(p.detection < 0.05 for p in every)
    print(f"{len(every)} springs: {alone} show and have no twin, {unseen} do not show")


if __name__ == "__main__":
    main()
