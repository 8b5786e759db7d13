"""Plans that tell springs apart: what they gain, and what the parameters pay.

``python benchmarks/structure_designs.py`` plans 8 experiments with the UR10 (240 candidates, 60
lines, 3 % noise) by several criteria. Torsions of the joints and the foundation are each so stiff
that the D plan of the parameters alone detects them with 50 %, each alone beside the parameters;
the table has the detection by the other plans, Phi(sqrt(lambda) - c), and their standard deviations
of the parameters against that plan's.
"""

import argparse
from dataclasses import replace

import numpy as np
from scipy.special import ndtr, ndtri

import oed
from oed.criteria.criteria import LargestVarianceCriterion
from robotmodels import ElasticRobot, RelativeNoise, load_robot, possible_springs, with_springs

NOISE, LIMIT = RelativeNoise(0.03, 0.01), float(-ndtri(0.01 / 27))
CANDIDATES, EXPERIMENTS, LINES = 240, 8, 60
RIGID = 1e9


def information(robot: ElasticRobot, seed: int) -> tuple[oed.InformationSet, list[str]]:
    """Return information of ln theta and of compliances that are zero [1e-9 rad/(N m)]."""
    springs = [
        s for s in possible_springs(robot) if s.axis != "drive" and (s.joint or s.link == "world")
    ]
    stiff = [s.model_copy(update={"stiffness": RIGID, "damping": 1e-3 * RIGID}) for s in springs]
    loose = with_springs(robot, stiff, free=True)
    fixed = [f"{spring.name}.damping" for spring in springs]
    choice = loose.file.parameters.model_copy(
        update={"fixed": [*loose.file.parameters.fixed, *fixed]}
    )
    loose = ElasticRobot(loose.file.model_copy(update={"parameters": choice}), loose.folder)
    low, high = np.clip(robot.position_limits, -2.0, 2.0).T
    positions = np.random.default_rng(seed).uniform(low, high, (CANDIDATES, len(low)))
    omega = 2 * np.pi * np.linspace(2.0, 80.0, LINES)
    return oed.information(loose, positions, omega, NOISE), [f"{s.name}.stiffness" for s in springs]


def scaled(info: oed.InformationSet, factors: np.ndarray) -> oed.InformationSet:
    """Return information of parameters that are `factors` times as large."""
    return replace(info, matrices=info.matrices * np.outer(factors, factors))


def plan(info: oed.InformationSet, criterion: object) -> np.ndarray:
    """Return the counts of a plan of whole experiments."""
    relaxed = oed.optimal_design(info, criterion, solver="newton", tolerance=1e-4)
    return oed.exact_design(info, EXPERIMENTS, relaxed, criterion=criterion).repetitions


def deviations(total: np.ndarray) -> np.ndarray:
    """Return standard deviations of all parameters by their information."""
    scale = 1 / np.sqrt(np.diag(total))
    return scale * np.sqrt(np.diag(np.linalg.inv(total * np.outer(scale, scale))))


def alone_beside(
    info: oed.InformationSet, p: list[int], s: list[int], counts: np.ndarray
) -> np.ndarray:
    """Return the standard deviation of each of the springs s alone beside the parameters p."""
    sets = [[*p, each] for each in s]
    total = np.tensordot(counts, info.matrices, axes=1)
    return np.array([deviations(total[np.ix_(i, i)])[-1] for i in sets])


def one(seed: int) -> dict[str, tuple[float, float, float]]:
    """Return mean and least detection, and relative standard deviation, by plan."""
    robot = load_robot("ur10")
    info, springs = information(robot, seed)
    names = list(info.names)
    p = [names.index(name) for name in robot.parameters.names]
    s = [names.index(name) for name in springs]
    alone = oed.InformationSet(info.positions, info.matrices[:, p][:, :, p], robot.parameters.names)
    counts = {"D": plan(alone, "D")}
    by_d = alone_beside(info, p, s, counts["D"])
    factors = np.ones(len(names))
    factors[s] = LIMIT * by_d  # compliances of 50 % detection
    info = scaled(info, factors)
    counts["D with springs"] = plan(info, "D")
    counts["Ds of springs"] = plan(info, oed.DsCriterion(tuple(springs)))
    counts["maximin of springs"] = plan(info, LargestVarianceCriterion(tuple(springs)))
    results, reference = {}, deviations(np.tensordot(counts["D"], alone.matrices, axes=1))
    for name, each in counts.items():
        detection = ndtr(1 / alone_beside(info, p, s, each) - LIMIT)
        worse = float(
            np.exp(
                np.log(deviations(np.tensordot(each, alone.matrices, axes=1)) / reference).mean()
            )
        )
        results[name] = float(detection.mean()), float(detection.min()), worse
    return results


def main() -> None:
    """Print the table over some sets of candidates."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    runs = [one(seed) for seed in range(parser.parse_args().seeds)]
    print(
        "| plan | mean detection | least | standard deviations of parameters |\n|---|---|---|---|"
    )
    for name in runs[0]:
        mean, least, worse = np.mean([run[name] for run in runs], axis=0)
        print(f"| {name} | {mean:.2f} | {least:.2f} | {worse:.2f} |")


if __name__ == "__main__":
    main()
