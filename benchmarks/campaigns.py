"""Campaigns against the fixed plan: minutes of simulated robot time from guesses to targets.

``python benchmarks/campaigns.py ROBOT SEED`` runs one campaign in MuJoCo, with friction of the
motors, disturbances of torques and noise of encoders, from guesses within a factor two; the fixed
plan measures n orthogonal runs in positions that are D-optimal at the same guesses. Results go to
`benchmarks/results/campaigns.json`, one entry for each robot and seed; without arguments all of
them are run, some hours.

The fixed plan's minutes are those that standard deviations of half an hour of it take to reach the
targets, measured and fitted in the same way; beside them those of a relaxed design, without whole
visits, by the information at the true values under the true noise, with friction known. The
campaign's are those of its visits as they were run, checks and the repetition included.
"""

import json
import sys
import tempfile
import time
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from linearisation import HERE

import estimators
import oed
import robotmodels
from estimators.fitting.settled_runs import settled_runs
from oed.campaign.planning import Planner
from oed.campaign.visit_plan import line_grid
from oed.campaign.visit_planner import visits_of
from oed.design.constraints import Constraints
from oed.exact.visit_plan import visit_plan as plan_within
from oed.experiment.prepare import controller_of, imperfections_of
from oed.experiment.run_experiment import SimulatedPlant
from oed.information_sets.excitations import Orthogonal
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array
from robotmodels.exports.robot_files import with_values

RESULTS = HERE / "results" / "campaigns.json"
TORQUES = {
    "ur10": [3.3, 3.3, 1.5, 0.55, 0.55, 0.55],
    "manutec_r3_26": [9.0, 9.0, 9.0, 2.1, 2.1, 1.1],
    "kr240_class": [25.0, 25.0, 20.0, 8.0, 8.0, 8.0],
}
"""Largest torques of the motors [N m]."""
DISTURBANCES = {"ur10": 0.018, "manutec_r3_26": 0.034, "kr240_class": 0.25}
"""Standard deviation of a sample over the largest torque; the fixed plan takes half an hour."""
FRICTION = 0.05
"""Level over the largest torque, of robots whose files have none."""
ENCODERS = 2e-5
"""Standard deviation of a sample [rad]."""
ROUNDS = 16
HALF_HOUR = 1800.0
"""Robot time of the fixed plan that is measured [s]."""

CAMPAIGN = """
schema: campaign/1
robot: guess.yaml
targets: {{stiffness: 0.001, damping: 0.005}}
minutes: 240
candidates: {{sobol: 128}}
multisine: {{band: [1.0, 60.0], sample_time: 0.001, period: 4.0, detection: 5}}
limits: {{torque: {torque}, speed: 60.0, margin: 0.1}}
imperfections:
  friction: 1.0
  angle_noise: {encoders}
  torque_limit: {torque}
  torque_disturbance: {disturbance}
output: out
"""


def true_robot(name: str) -> ElasticRobot:
    """Return the robot that is measured."""
    robot = robotmodels.load_robot(name)
    motors = robot.file.motors
    if any(motor.coulomb for motor in motors):
        return robot
    levels = [FRICTION * torque for torque in TORQUES[name]]
    rubbing = [
        motor.model_copy(update={"coulomb": level})
        for motor, level in zip(motors, levels, strict=True)
    ]
    return replace(robot, file=robot.file.model_copy(update={"motors": rubbing}))


def begun(name: str, seed: int, folder: Path) -> tuple[oed.Campaign, ElasticRobot]:
    """Return the campaign of guesses, and the robot that is measured."""
    truth, rng = true_robot(name), np.random.default_rng(seed)
    wrong = truth.parameters.values * 2 ** rng.uniform(-1, 1, len(truth.parameters))
    robotmodels.save_robot(with_values(truth, wrong, None), folder / "guess.yaml")
    disturbance = [round(DISTURBANCES[name] * torque, 5) for torque in TORQUES[name]]
    text = CAMPAIGN.format(torque=TORQUES[name], encoders=ENCODERS, disturbance=disturbance)
    (folder / "campaign.yaml").write_text(text)
    return oed.Campaign.load(folder / "campaign.yaml"), truth


def fixed_minutes(
    campaign: oed.Campaign, truth: ElasticRobot, name: str, targets: Array
) -> tuple[float, float]:
    """Return the minutes of n orthogonal runs a position, D-optimal at the guesses.

    Those of the relaxed design, by the information at the true values with friction known; and
    those by the standard deviations of half an hour of whole visits, measured in MuJoCo and fitted
    about the true values with levels of friction.
    """
    grid = line_grid(campaign.settings, len(truth.motor_names))
    disturbance = DISTURBANCES[name] * np.array(TORQUES[name])
    variances = np.empty((len(grid.omega), 2 * len(disturbance)))
    variances[:, : len(disturbance)] = (grid.omega[:, None] ** 2 * ENCODERS) ** 2
    variances[:, len(disturbance) :] = disturbance**2
    noise = robotmodels.ErrorCovariance(
        2 * variances[:, :, None] / grid.samples * np.eye(variances.shape[1])
    )
    with campaign._evaluation() as now:
        planner: Planner = now.planner
        guessed = replace(planner, robot=campaign.robot, at=None, stage=0)
        candidates = guessed.candidates(noise, [2], planner.positions, [Orthogonal()])
        right = replace(guessed, robot=with_values(campaign.robot, truth.parameters.values, None))
        right.__dict__["levels"] = guessed.levels
        true = right.candidates(noise, [2], planner.positions, [Orthogonal()])
    limit = Constraints(time=float(candidates.duration.max()), durations=candidates.duration)
    weights = oed.optimal_design(candidates.information, "D", limit).weights
    rate = true.information.combined(weights) / float(weights @ candidates.duration)
    relaxed = float((np.diag(np.linalg.inv(rate)) / targets**2).max()) / 60
    visits = visits_of(plan_within(candidates, HALF_HOUR, "D"))
    records = measured(campaign, truth, guessed.plans(visits))
    at = with_values(campaign.robot, truth.parameters.values, None)
    data = settled_runs(at, records, "detection", weak=True)
    std = estimators.covariance(estimators.fit(at, data)).std
    time = sum(float(candidates.duration[0]) for _ in visits)
    return relaxed, time / 60 * float(((std / targets) ** 2).max())


def measured(
    campaign: oed.Campaign, truth: ElasticRobot, plans: list[oed.ExperimentPlan]
) -> list[robotmodels.Records]:
    """Return records of plans on the simulated robot."""
    settings = campaign.settings
    return [
        SimulatedPlant(
            truth,
            controller_of(settings, campaign.robot),
            imperfections_of(settings, truth),
            np.random.default_rng([settings.seed, number]),
        ).measure(plan, 0)
        for number, plan in enumerate(plans)
    ]


def run(name: str, seed: int) -> dict[str, Any]:
    """Return how a campaign went, with the fixed plan's minutes."""
    folder = Path(tempfile.mkdtemp(dir=HERE.parent / ".bench"))
    campaign, truth = begun(name, seed, folder)
    stiff = np.array(["stiffness" in parameter for parameter in truth.parameters.names])
    start = time.perf_counter()
    for _ in range(ROUNDS):
        visits = campaign.ask()
        if not visits:
            break
        oed.simulate_visits(campaign.settings, campaign.robot, truth, visits)
    status = campaign.status()
    estimate = status.estimate
    result: dict[str, Any] = {"robot": name, "seed": seed, "state": status.state}
    result |= {"minutes": status.minutes, "seconds": time.perf_counter() - start}
    if estimate is not None:
        error = np.log(estimate.values / truth.parameters.values)
        away = error / estimate.std
        result |= {
            "largest_std_over_target": float((estimate.std / status.targets).max()),
            "largest_error_over_target": float(np.abs(error / status.targets).max()),
            "rms_error_over_std": [
                float(np.sqrt((away[part] ** 2).mean())) for part in (stiff, ~stiff)
            ],
            "cost": estimate.cost,
            "verdict": str(estimate.trust.verdict),
        }
        relaxed, fixed = fixed_minutes(campaign, truth, name, status.targets)
        result |= {"relaxed_minutes": relaxed, "fixed_minutes": fixed}
        result |= {"ratio": status.minutes / fixed}
    return result


def main() -> None:
    """Run what is asked for, and keep each result as soon as it is there."""
    (HERE.parent / ".bench").mkdir(exist_ok=True)
    chosen = [(sys.argv[1], int(sys.argv[2]))] if len(sys.argv) > 2 else []
    for name, seed in chosen or [(name, seed) for seed in range(5) for name in TORQUES]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", robotmodels.IdentificationWarning)
            result = run(name, seed)
        print(json.dumps(result), flush=True)
        kept = json.loads(RESULTS.read_text()) if RESULTS.exists() else []
        others = [one for one in kept if (one["robot"], one["seed"]) != (name, seed)]
        RESULTS.parent.mkdir(exist_ok=True)
        RESULTS.write_text(json.dumps([*others, result], indent=1) + "\n")


if __name__ == "__main__":
    main()
