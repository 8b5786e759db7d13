"""Where to put the robot: the best 15 of 450 positions, and what they are worth.

Prints the positions in degrees with their repetitions, and how much less certain the same number
of random positions would be.
"""

import numpy as np

import oed
import robotmodels

robot = robotmodels.load_robot("ur10")
omega = 2 * np.pi * np.geomspace(2, 80, 40)  # [rad/s]
noise = robotmodels.RelativeNoise(relative=0.03, floor=0.01)
limits = np.radians([[0, 90], [-150, -30], [-140, 140], [-135, 135], [-135, 135], [0, 90]])

positions = oed.candidate_positions(robot, per_joint=[2, 5, 5, 3, 3, 1], limits=limits)
info = oed.information(robot, positions, omega, noise)
design = oed.optimal_design(info, criterion="D")
plan = oed.exact_design(info, n_experiments=15, design=design)

print(f"certified within {design.gap:.1e} of the optimum over {len(positions)} candidates")
for i in plan.support:
    print(f"{plan.repetitions[i]} x", np.degrees(positions[i]).round().astype(int))

# What the plan is worth: expected relative standard deviations against 15 positions at random.
rng = np.random.default_rng(1)
drawn = info.matrices[rng.choice(len(positions), 15, replace=False)].sum(axis=0)
std = np.sqrt(np.diagonal(np.linalg.inv(plan.information)))
std_random = np.sqrt(np.diagonal(np.linalg.inv(drawn)))
worst = int(np.argmax(std))
print(f"least certain: {robot.parameters.names[worst]}, {std[worst]:.1%}")
print(f"random positions: {np.exp(np.mean(np.log(std_random / std))):.2f} times the deviation")
