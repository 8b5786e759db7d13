# %% [markdown]
# # Design only: where to put the robot
#
# Which 15 of 450 positions are most informative about the springs and dampers of a UR10, and how
# accurate would the estimates be?
# Nothing is measured or simulated here: a design needs a model, frequencies and a noise law.

# %%
import matplotlib.pyplot as plt
import numpy as np

import oed
import reports
import robotmodels

robot = robotmodels.load_robot("ur10")
omega = 2 * np.pi * np.geomspace(2, 80, 40)  # [rad/s]
noise = robotmodels.RelativeNoise(relative=0.03, floor=0.01)
limits = np.radians([[0, 90], [-150, -30], [-140, 140], [-135, 135], [-135, 135], [0, 90]])

positions = oed.candidate_positions(robot, per_joint=[2, 5, 5, 3, 3, 1], limits=limits)
info = oed.information(robot, positions, omega, noise)
design = oed.optimal_design(info, criterion="D")
plan = oed.exact_design(info, n_experiments=15, design=design)
print(design)
print(plan)

# %% [markdown]
# The sensitivity function says what a unit of weight in each candidate would add. The theorem of Kiefer
# and Wolfowitz: at the optimum it is nowhere larger than in the support. The gap that is printed above
# bounds by how much that is missed, over all candidates.

# %% picture="design_map"
reports.plots.design_map(positions, design, (1, 2), plan=plan, names=robot.motor_joints)

# %% [markdown]
# ## How many experiments?
#
# Standard deviations fall with the square root of their number, once all parameters are seen. Positions
# at random need more of them for the same accuracy.

# %% picture="experiment_curve"
numbers = [8, 10, 12, 15, 20, 30, 45, 60]
curve = oed.experiment_curve(info, numbers)
rng = np.random.default_rng(1)


def geometric_mean(information):
    return np.exp(np.mean(np.log(np.sqrt(np.diagonal(np.linalg.inv(information))))))


planned = np.exp(np.mean(np.log(curve.std), axis=1))
drawn = [
    [geometric_mean(info.matrices[rng.choice(len(positions), n)].sum(axis=0)) for _ in range(20)]
    for n in numbers
]
figure, axes = plt.subplots(figsize=(7, 4))
axes.loglog(curve.counts, 100 * planned, "o-", label="optimal plans")
axes.fill_between(
    numbers, *(100 * np.quantile(drawn, q, axis=1) for q in (0.0, 1.0)), alpha=0.3,
    label="20 plans at random",
)  # fmt: skip
axes.set(xlabel="experiments", ylabel="standard deviation, geometric mean [%]")
axes.set_xticks(numbers, numbers)
axes.set_yticks([0.3, 0.5, 0.7, 1.0, 1.4], ["0.3", "0.5", "0.7", "1.0", "1.4"])
axes.minorticks_off()
axes.legend()
plt.show()

# %%
std = np.sqrt(np.diagonal(np.linalg.inv(plan.information)))
worst = int(np.argmax(std))
print(f"15 experiments: least certain {robot.parameters.names[worst]}, {std[worst]:.1%}")
