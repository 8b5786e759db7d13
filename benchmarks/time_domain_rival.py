"""Springs and dampers by rollouts in time, mujoco.sysid, beside fits of FRFs: the same records.

    python benchmarks/time_domain_rival.py [--starts 5]

writes `benchmarks/results/time_domain_rival.json`. The case is small enough for the rival: a
Manutec r3 without gravity (its static sag would be a second unknown of every rollout), three gear
springs and dampers, one position, six experiments of 1.5 s at 1 kHz in closed loop with encoder
noise. Both ways start from the same parameters, near the truth and far from it, 10^U(-0.1, 0.1) and
10^U(-1, 1) times, and search ln theta within 10^+-1.5 of the truth. mujoco.sysid gets its own
environment in ``.bench/``.
"""

import argparse
import json
import os
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from linearisation import HERE, machine, peer_python

import estimators
import robotmodels
from robotmodels.arrays import Array
from robotmodels.description.urdf import locate
from robotmodels.plant.controller import default_controller
from robotmodels.plant.mujoco_model import PlantBuilder
from robotmodels.plant.simulation import Imperfections, simulate
from robotmodels.plant.urdf import read_tree
from robotmodels.records import Records

RESULTS = HERE / "results" / "time_domain_rival.json"
SAMPLE_TIME, SAMPLES, PERIODS, REACH = 1e-3, 500, 3, 1.5
LINES = np.arange(1, 32, 2)
DECADES = (0.1, 1.0)
POSITION = np.array([[0.3, 0.4, 0.5, 0.2, 0.6, 0.1]])
FLAWS = Imperfections(friction=0.0, nonlinear_gears=False, angle_noise=1e-5)


def case() -> tuple[robotmodels.ElasticRobot, Records]:
    """Return the robot and the records of its experiments, from rest on."""
    loaded = robotmodels.load_robot("manutec_r3")
    file = loaded.file.model_copy(update={"gravity": (0.0, 0.0, 0.0)})
    robot = robotmodels.ElasticRobot(file, loaded.folder)
    rng = np.random.default_rng(0)
    n = len(robot.motor_names)
    order = np.arange(n)
    turned = np.exp(2j * np.pi / n * np.outer(order, order))[:, :, None]
    phases = np.exp(2j * np.pi * rng.random((n, 1, len(LINES))))
    spectrum = np.zeros((1, n, n, SAMPLES // 2 + 1), dtype=complex)
    spectrum[0, :, :, LINES] = np.moveaxis(turned * phases.swapaxes(0, 1), -1, 0) * SAMPLES / 2
    signals = 0.5 * np.swapaxes(np.fft.irfft(spectrum, n=SAMPLES), 2, 3)
    controller = default_controller(robot, SAMPLE_TIME)
    (records,) = simulate(
        robot,
        POSITION,
        signals,
        controller,
        lines=LINES,
        imperfections=FLAWS,
        rng=rng,
        periods=PERIODS,
        transient=0,
    )
    return robot, records


def ours(robot: robotmodels.ElasticRobot, records: Records, starts: Array) -> dict[str, Any]:
    """Fit FRFs from every start."""
    begun = time.perf_counter()
    estimate = estimators.estimate_frf(records, covariance="noise", transient=1)
    bounds = np.outer([10**-REACH, 10**REACH], robot.parameters.values)
    fits = estimators.multistart(robot, estimate, starts, "lls", "user", bounds)
    found = {tuple(one.start): one for one in fits}
    values = np.array([found[tuple(start)].parameters.values for start in starts])
    return judged(robot, values, time.perf_counter() - begun, len(starts))


def theirs(robot: robotmodels.ElasticRobot, records: Records, starts: Array) -> dict[str, Any]:
    """Fit rollouts from every start, in the rival's own environment."""
    builder = PlantBuilder(robot.file, read_tree(locate(robot.file.urdf, robot.folder)))
    builder.compile()
    shape = (-1, PERIODS * SAMPLES, len(robot.motor_names))
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "case.json"), Path(folder, "out.json")
        motors = [
            {"joint": m.name if m.joint in builder.drives else m.joint, "ratio": m.gear_ratio}
            for m in robot.file.motors
        ]
        springs = [
            {"name": s.name, "tendon": s.joint} for s in robot.file.springs if s.axis == "drive"
        ]
        content = {
            "xml": builder.spec.to_xml(),
            "sample_time": SAMPLE_TIME,
            "motors": motors,
            "springs": springs,
            "drives": list(robot.motor_joints),
            "position": POSITION[0].tolist(),
            "names": list(robot.parameters.names),
            "truth": robot.parameters.values.tolist(),
            "starts": starts.tolist(),
            "reach": REACH,
            "angle_noise": float(FLAWS.angle_noise),
            "torque": records.torque[0, 0].reshape(shape).tolist(),
            "angle": records.angle[0, 0].reshape(shape).tolist(),
        }
        source.write_text(json.dumps(content))
        script = HERE / "time_domain_peer.py"
        python = peer_python("time_domain", ["mujoco[sysid]>=4.0"])
        subprocess.run([python, script, source, target], check=True)
        found = json.loads(target.read_text())
    result = judged(robot, np.array(found["values"]), found["seconds"], len(starts))
    return result | {
        "residual_at_the_truth": found["residual_at_the_truth"],
        "version": found["version"],
    }


def judged(
    robot: robotmodels.ElasticRobot, values: Array, seconds: float, starts: int
) -> dict[str, Any]:
    """Return how often all springs came within 5 %, how near those came, and the time."""
    error = np.abs(np.log(values / robot.parameters.values))
    springs = np.array([name.endswith("stiffness") for name in robot.parameters.names])
    good = error[:, springs].max(axis=1) < 0.05
    best = error[good] if good.any() else error
    return {
        "starts": starts,
        "success": float(good.mean()),
        "stiffness_error_median": float(np.median(best[:, springs])),
        "damping_error_median": float(np.median(best[:, ~springs])),
        "seconds_per_start": seconds / starts,
    }


def main() -> None:
    """Run both, print and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=5)
    asked = parser.parse_args()
    robot, records = case()
    rng, results = np.random.default_rng(1), {}
    for decades in DECADES:
        starts = estimators.perturbed_starts(robot.parameters, asked.starts, decades, rng)
        found = {"frequency domain": ours(robot, records, starts)}
        found["mujoco.sysid"] = theirs(robot, records, starts)
        results[f"starts within {decades:g} decades"] = found
        print(json.dumps(found), flush=True)
    results["machine"] = machine() | {"load_average": os.getloadavg()[0]}
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
