# %% [markdown]
# # A campaign: measure, fit, ask for the next visit
#
# A campaign asks for one visit after the other until the stated accuracies are reached. Here a simulated
# robot answers; at a real one `campaign.tell(number, records)` takes what was recorded.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import oed
import robotmodels

Path("campaign.yaml").write_text("""\
schema: campaign/1
robot: moberg_axis1
guesses_within: 2.0 # factor by which the robot file may be off
targets: {stiffness: 0.002, damping: 0.01} # relative standard deviations
minutes: 60 # robot time, moves included
candidates: {sobol: 16}
multisine: {band: [1.0, 60.0], sample_time: 0.002, period: 4.0, detection: 5} # [Hz, s]
limits: {speed: 5.0, swing: 0.05, margin: 0.1} # [rad/s, rad]
moves: {speed: 0.5, acceleration: 1.0}
settle: 2.0
imperfections: {angle_noise: 1.0e-4, nonlinear_gears: false}
output: campaign
""")
campaign = oed.Campaign.load("campaign.yaml")
guesses = campaign.robot.parameters.values
truth = robotmodels.with_values(campaign.robot, guesses * [1.2, 0.9, 1.1, 1.1, 0.9, 0.9])

while visits := campaign.ask():
    oed.simulate_visits(campaign.settings, campaign.robot, truth, visits)
status = campaign.status()
print(f"{status.state} after {status.minutes:.1f} minutes and {len(status.visits)} visits")
for name, value, exact in zip(
    status.names, status.estimate.values, truth.parameters.values, strict=True
):
    print(f"{name:14} {value:9.5g}   truth {exact:9.5g}")

# %% [markdown]
# How the standard deviations fall with robot time, and what was asked for:

# %% picture="campaign"
history = status.history
figure, axes = plt.subplots(figsize=(7, 4))
for name, std in zip(status.names, 100 * history.std.T, strict=True):
    axes.semilogy(history.minutes, std, "o-" if "stiffness" in name else "s--", ms=4, label=name)
for target in np.unique(status.targets):
    axes.axhline(100 * target, color="black", lw=0.8, ls=":")
axes.set(xlabel="robot time [min]", ylabel="standard deviation [%]")
axes.legend(ncols=2, fontsize="small")
plt.show()
