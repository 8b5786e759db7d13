"""Time plans of visits: a million flat experiments, and free spectra in thousands of positions.

``python benchmarks/experiments.py`` writes `benchmarks/results/experiments.json`; each part runs in
a process of its own, ``python benchmarks/experiments.py PART``, and tells its time, its largest
resident memory and its certificate. ``--quick`` takes a tenth of the positions.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from design_million import largest_resident
from linearisation import HERE, machine
from scipy.stats import qmc

import oed
import robotmodels
from robotmodels.common.arrays import Array

LINES = 2 * np.pi * np.linspace(2.0, 80.0, 98)
TORQUE = np.array([3.3, 3.3, 1.5, 0.55, 0.55, 0.55])
EXCITATIONS: list[Any] = [
    "orthogonal",
    "random_phase",
    *(oed.Zippered(motor, f"zippered {motor + 1}") for motor in range(6)),
]
HOUR = 3600.0


def setting(count: int) -> tuple[robotmodels.ElasticRobot, Array, robotmodels.InputOutputNoise]:
    """Return the UR10, positions that fill its ranges, and the noise of a period."""
    robot = robotmodels.load_robot("ur10")
    low, high = robot.position_limits.T
    points = qmc.Halton(len(low), rng=np.random.default_rng(1)).random(count)
    noise = robotmodels.InputOutputNoise.of_levels(TORQUE, len(LINES), speed=0.02)
    return robot, low + points * (high - low), noise


def million(count: int) -> dict[str, Any]:
    """Return the times of the information of eight excitations a position, and of a plan."""
    robot, positions, noise = setting(count)
    with tempfile.TemporaryDirectory(dir=HERE.parent / ".bench") as folder:
        start = time.perf_counter()
        table = oed.experiment_candidates(
            robot,
            positions,
            EXCITATIONS,
            LINES,
            noise,
            torque=TORQUE,
            periods=(4,),
            store=Path(folder) / "visits.oed",
        )
        informed = time.perf_counter() - start
        plan = oed.visit_plan(table, HOUR)
    return {
        "candidates": len(table),
        "information_seconds": informed,
        "plan_efficiency": plan.efficiency,
    }


def spectra(count: int) -> dict[str, Any]:
    """Return the certificate of free spectra of each motor."""
    robot, positions, noise = setting(count)
    design = oed.optimal_spectra(robot, positions, LINES, noise, TORQUE)
    return {"positions": count, "gap": design.gap, "rounds": design.rounds}


def replan(count: int) -> dict[str, Any]:
    """Return the plan after a first stage of flat spectra, as campaigns make it."""
    robot, positions, noise = setting(count)

    def table(where: Array, excitations: list[Any]) -> oed.ExperimentCandidates:
        return oed.experiment_candidates(
            robot, where, excitations, LINES, noise, torque=TORQUE, periods=(1, 2, 4, 8, 16)
        )

    flat = table(positions, ["zippered"])
    first = oed.visit_plan(flat, 0.25 * HOUR)
    prior, targets = (
        first.information,
        dict(zip(robot.parameters.names, first.std / 4, strict=True)),
    )
    relaxed = oed.fastest_design(flat.information, flat.duration, targets, prior, 1e-3)
    used = positions[np.unique(relaxed.support % count)]
    criterion, share = oed.TargetCriterion(targets), 4 * flat.timing.period / relaxed.time
    design = oed.optimal_spectra(
        robot, used, LINES, noise, TORQUE, criterion=criterion, prior=share * prior, tolerance=1e-2
    )
    coloured = table(design.positions, ["zippered", *design.excitations])
    plan = oed.fastest_visit_plan(coloured, targets, prior)
    return {"positions": count, "minutes": plan.duration / 60, "efficiency": plan.efficiency}


def shared(count: int) -> dict[str, Any]:
    """Return the processor time of eight excitations together, and of each by itself."""
    robot, positions, noise = setting(count)

    def seconds(sets: list[list[Any]]) -> float:
        start = time.process_time()
        for excitations in sets:
            oed.experiment_candidates(robot, positions, excitations, LINES, noise, torque=TORQUE)
        return time.process_time() - start

    together, alone = seconds([EXCITATIONS]), seconds([[one] for one in EXCITATIONS])
    return {"together_cpu_seconds": together, "ratio_of_each_alone": alone / together}


PARTS: dict[str, tuple[Callable[[int], dict[str, Any]], int]] = {
    "million": (million, 125_000),
    "spectra": (spectra, 20_000),
    "replan": (replan, 512),
    "shared": (shared, 2_000),
}


def measured(name: str, share: float) -> dict[str, Any]:
    """Return what a part takes in this process, after a small one that loads and compiles."""
    run, count = PARTS[name]
    run(64)
    start = time.perf_counter(), time.process_time()
    result = run(int(count * share))
    return result | {
        "seconds": time.perf_counter() - start[0],
        "cpu_seconds": time.process_time() - start[1],
        "resident_mb": largest_resident(),
    }


def main() -> None:
    """Run the parts, each in a process of its own."""
    share = 0.1 if "--quick" in sys.argv else 1.0
    (HERE.parent / ".bench").mkdir(exist_ok=True)
    names = [name for name in PARTS if name in sys.argv]
    if names:
        print(json.dumps(measured(names[0], share)))
        return
    results: dict[str, Any] = {"machine": machine()}
    for name in PARTS:
        command = [sys.executable, __file__, name, *sys.argv[1:]]
        run = subprocess.run(command, check=True, capture_output=True, text=True)
        results[name] = json.loads(run.stdout)
        print(f"{name}: {results[name]}", flush=True)
    target = HERE / "results" / "experiments.json"
    target.parent.mkdir(exist_ok=True)
    target.write_text(json.dumps(results, indent=2))
    print(f"\nwritten: {target}")


if __name__ == "__main__":
    main()
