"""How to shake the robot: multisines inside limits, a simulated experiment, and the FRFs it gives.

Two positions of a Manutec r3 under its controller, with friction and a noisy encoder. Replace the
simulation with records of your own (`robotmodels.Records.load`) and the rest stays the same.
"""

import numpy as np

import estimators
import oed
import robotmodels

rng = np.random.default_rng(1)
robot = robotmodels.load_robot("manutec_r3")
positions = np.array([[0.0, 0.5, -0.8, 0.0, 0.6, 0.0], [0.6, 0.2, 0.4, 0.5, -0.6, 0.0]])
sample_time = 1e-3  # [s]
controller = robotmodels.default_controller(robot, sample_time)

band = (2 * np.pi * 1.0, 2 * np.pi * 50.0)  # [rad/s]
multisine = oed.band_multisine(1000, sample_time, band, inputs=6, count=25, spacing="quasi_log")
plan = oed.experiment_plan(
    robot, positions, multisine, blocks=4, periods=2, speed=1.0, acceleration=2.0, rng=rng
)
limits = oed.Limits(torque=np.array([8, 8, 8, 2, 2, 1.0]), speed=np.full(6, 300.0))
scaling = oed.scale(plan, robot, controller, limits, balance=True, margin=0.2)
print(f"{scaling.binding}; {scaling.plan.duration / 60:.1f} minutes of measurement")

parts = robotmodels.simulate(
    robot, plan.visited, scaling.plan.signals, controller, lines=multisine.lines, rng=rng,
    imperfections=robotmodels.Imperfections(friction=1.0, angle_noise=1e-6),
)  # fmt: skip
frf = estimators.estimate_frf(robotmodels.Records.join(list(parts)), method="ari")
uncertain = np.median(np.sqrt(frf.variance) / np.abs(frf.response))
print(f"FRFs {frf.response.shape}, median relative standard deviation {uncertain:.0%}")
