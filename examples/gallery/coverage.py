# %% [markdown]
# # Do the intervals cover the truth?
#
# A 95 % interval must hold the truth in 95 of 100 experiments. Here an experiment is repeated 100 times in
# simulation, fitted each time, and counted. [How the numbers are checked](../checked.md) says how the
# project does so on a large scale.

# %%
import matplotlib.pyplot as plt
import numpy as np

import estimators
import robotmodels

robot = robotmodels.load_robot("manutec_r3")
positions = np.array([[0.0, 0.4, -0.6, 0.0, 0.5, 0.0], [0.5, -0.2, 0.3, 0.8, -0.4, 0.0]])  # [rad]
omega = 2 * np.pi * np.geomspace(3, 80, 30)  # [rad/s]
noise = robotmodels.RelativeNoise(relative=0.03, floor=0.01)
names, truth = robot.parameters.names, robot.parameters.values

lows, highs = [], []
for rng in np.random.default_rng(1).spawn(100):
    data = estimators.simulate_frf(robot, positions, omega, noise, rng)
    intervals = estimators.fit(robot, data, residual="nls", weights="optimal").intervals()
    lows.append([np.nan if one.low is None else one.low for one in intervals])
    highs.append([np.nan if one.high is None else one.high for one in intervals])
lows, highs = np.array(lows), np.array(highs)
covered, quoted = (lows <= truth) & (truth <= highs), np.isfinite(lows)
print(f"{quoted.mean():.1%} are quoted, of which {covered[quoted].mean():.1%} cover the truth")

# %% [markdown]
# A control that must fail: intervals of a quarter of the width.

# %%
middle, half = (lows + highs) / 2, (highs - lows) / 2
narrow = np.abs(middle - truth) <= half / 4
print(f"{narrow[quoted].mean():.1%} of intervals of a quarter of the width cover it")

# %% picture="coverage"
figure, axes = plt.subplots(figsize=(9, 3.2))
parameter = 1
for i in range(100):
    colour = "tab:blue" if covered[i, parameter] else "tab:red"
    axes.plot([i, i], [lows[i, parameter], highs[i, parameter]], color=colour, lw=2)
axes.axhline(truth[parameter], color="black", lw=1)
axes.set(xlabel="experiment", ylabel=f"{names[parameter]} [N m/rad]", xlim=(-1, 100))
axes.set_title(f"{covered[:, parameter].sum()} of 100 cover the truth")
plt.show()
