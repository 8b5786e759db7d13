# %% [markdown]
# # A real KR300: springs from one ordinary movement
#
# A KUKA KR300 with encoders on both sides of its gears moves all axes for ten seconds. What the gears
# wind up under their torque tells their stiffness; no excitation is needed. The record is Jonas Weigand's
# (MIT License, see `examples/data`).

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.io import loadmat

import estimators
import robotmodels

folder = next(p for p in (Path.cwd(), *Path.cwd().parents) if (p / "examples/data").is_dir())
record = loadmat(folder / "examples/data/kr300.mat")
robot = robotmodels.load_robot("kr300")
start = np.radians([0, -90, 90, 0, 0, 0])  # recorded angles are relative to it
link = np.radians(record["act_pos_se_deg"].T) + start
link[:, 3:] = np.nan  # the wrist's axes are coupled: left out
motor = np.radians(record["act_pos_mot_deg"].T) + start
torque = record["act_torque_abs_nm"].T * [one.gear_ratio for one in robot.file.motors]
signals = {"motor_angle": motor, "link_angle": link, "motor_torque": torque}
movement = robotmodels.Movement(robot.motor_names, 0.004, signals)

# %% [markdown]
# Stiffnesses, the payload, delays of the encoders and friction are fitted together. Intervals include
# systematic terms, such as the scale of the torques and eccentric encoders.

# %%
fit = estimators.fit_deflection(robot, movement)
for one in fit.intervals():
    if one.name.endswith((".stiffness", "mass")):
        span = "no interval" if one.low is None else f"{one.low:.3g} to {one.high:.3g}"
        print(f"{one.name:14} {one.value:10.4g}   {span:22} {one.verdict}")

# %% [markdown]
# What axes 2 and 3 wind up, and their stiffnesses beside those of the catalogue. Axis 1 turns about the
# vertical: gravity does not load its gear, and the record does not tell its stiffness. The fit says so.

# %% picture="kr300"
catalogue = {"g2.stiffness": 7.5189e6, "g3.stiffness": 4.0999e6}  # [N m/rad]
names = list(catalogue)
intervals = {one.name: one for one in fit.intervals()}
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6))
time = 0.004 * np.arange(len(motor))
for axis, colour in ((1, "tab:blue"), (2, "tab:orange")):
    wound = link[:, axis] - motor[:, axis]
    left.plot(time, 1e3 * (wound - wound.mean()), color=colour, lw=0.8, label=f"axis {axis + 1}")
left.set(xlabel="time [s]", ylabel="link less motor angle [mrad]")
left.legend()
for i, name in enumerate(names):
    one = intervals[name]
    right.errorbar(
        i, one.value / 1e6, [[(one.value - one.low) / 1e6], [(one.high - one.value) / 1e6]],
        fmt="o", capsize=4, color="tab:blue", label="this fit, 95 %" if i == 0 else None,
    )  # fmt: skip
right.plot(range(2), [catalogue[name] / 1e6 for name in names], "k_", ms=16, label="catalogue")
right.set_xticks(range(2), names)
right.set(ylabel="stiffness [MN m/rad]", xlim=(-0.5, 1.5))
right.legend()
figure.tight_layout()
plt.show()
