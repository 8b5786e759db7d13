# %% [markdown]
# # A controller's log, and one run per visit
#
# A log has columns in the units of its controller, on one side of the gears. A mapping says what they mean:
# [From a controller's log to springs](../how-to/log-to-springs.md) has it step by step. A simulation writes the log
# here: degrees on the joint side of the gear, torques of the motor.

# %%
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import estimators
import robotmodels

Path("robot.yaml").write_text("""\
schema: robot/1
name: two joints
urdf: example-robot-data:ur_description/urdf/ur10_robot.urdf
lock: {shoulder_pan_joint: 0.0, wrist_1_joint: 0.4, wrist_2_joint: 0.8, wrist_3_joint: 0.0}
motors:
  - {name: m2, joint: shoulder_lift_joint, gear_ratio: 101, inertia: 3.9e-4, viscous: 2.0e-3}
  - {name: m3, joint: elbow_joint, gear_ratio: 101, inertia: 2.0e-4, viscous: 1.5e-3}
springs:
  - {name: d2, joint: shoulder_lift_joint, axis: drive, stiffness: 4.0e4, damping: 60}
  - {name: d3, joint: elbow_joint, axis: drive, stiffness: 2.5e4, damping: 37.5}
""")
Path("experiment.yaml").write_text("""\
schema: experiment/1
robot: robot.yaml
positions: [[-1.6, 1.0], [-0.8, -1.2]]
multisine: {band: [2.0, 40.0], sample_time: 0.002, period: 1.0, slope: -1.0}
blocks: 4
periods: 4
transient_periods: 2
limits: {torque: 6.0, speed: 15.0, margin: 0.1}
imperfections: {angle_noise: 1.0e-3}
seed: 1
output: controller
""")
command = [sys.executable, "-m", "reports.cli", "--quiet", "simulate", "experiment.yaml"]
subprocess.run(command, check=True, capture_output=True)
made = robotmodels.Records.load("controller/records.h5")
angle, torque = np.degrees(made.angle / 101).reshape(-1, 2), made.torque.reshape(-1, 2)
speed = np.broadcast_to(made.reference, made.torque.shape).reshape(-1, 2)
time = 0.002 * np.arange(len(angle))
head = "time;act_pos_2;act_pos_3;torque_2;torque_3;ref_vel_2;ref_vel_3"
rows = np.column_stack([time, angle, torque, speed])
np.savetxt("log.csv", rows, delimiter=";", header=head, comments="")

Path("import.yaml").write_text("""\
schema: import/1
robot: robot.yaml
signals:
  - {column: act_pos_*, role: motor_angle, unit: deg, side: joint}
  - {column: torque_*, role: motor_torque, unit: N*m, side: motor}
  - {column: ref_vel_*, role: reference_velocity, unit: rad/s, side: motor}
""")
records = robotmodels.import_records("log.csv", "import.yaml")
print(
    f"{len(records)} positions, {records.torque.shape[1]} blocks, {len(records.lines)} excited lines"
)

# %% [markdown]
# The log as it came, and the frequency response of what was imported with the fitted model:

# %% picture="log"
robot = robotmodels.load_robot("robot.yaml")
estimate = estimators.estimate_frf(records)
fit = estimators.fit(robot, estimate, residual="nls", weights="optimal")
dense = 2 * np.pi * np.linspace(2, 40, 600)
model = robotmodels.frequency_response(fit.robot(), estimate.positions, dense)[0, :, 0, 0]
figure, axes = plt.subplot_mosaic("ac;bc", figsize=(9, 3.6))
for name, signal, label in (("a", angle, "act_pos_2 [deg]"), ("b", torque, "torque_2 [N m]")):
    axes[name].plot(time[:500], signal[:500, 0], lw=0.8)
    axes[name].set(ylabel=label)
axes["b"].set(xlabel="time [s]")
hertz = estimate.omega / (2 * np.pi)
axes["c"].semilogy(hertz, np.abs(estimate.response[0, :, 0, 0]), ".", ms=4, label="imported log")
axes["c"].semilogy(dense / (2 * np.pi), np.abs(model), label="fitted model")
axes["c"].set(xlabel="frequency [Hz]", ylabel="|G|, m2 to m2 [rad/s² per N m]")
axes["c"].legend()
figure.tight_layout()
plt.show()

# %%
print(fit.verdict)
for one in fit.intervals():
    print(f"{one.name}: {one.value:.4g} +- {100 * one.std / one.value:.2g} %")

# %% [markdown]
# ## One run per visit
#
# An FRF of six motors takes six runs in each position. Maximum likelihood fits the runs themselves, so that
# [one run per visit](../how-to/one-run-per-visit.md) is enough where the positions together show all parameters. The
# same noise, six positions, with one and with six runs in each:

# %% picture="one_run"
robot = robotmodels.load_robot("manutec_r3")
rng = np.random.default_rng(5)
omega = 2 * np.pi * np.geomspace(3, 60, 40)
low, high = robot.position_limits.T / 3
positions = rng.uniform(low, high, (6, 6))
response = robotmodels.frequency_response(robot, positions, omega)


def circular(*shape):
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


def simulated(runs):
    torques = circular(6, runs, 40, 6)  # positions, runs, lines, motors [N m]
    accelerations = np.einsum("qfmn,qefn->qefm", response, torques)
    std = np.concatenate([0.05 * np.abs(accelerations).mean((0, 1, 2)), np.full(6, 0.05)])
    errors = std * circular(6, runs, 40, 12)
    covariance = np.broadcast_to(np.diag(std**2), (6, 40, 12, 12))
    inputs, outputs = torques + errors[..., 6:], accelerations + errors[..., :6]
    return estimators.RunSpectra(positions, omega, inputs, outputs, covariance)


figure, axes = plt.subplots(figsize=(9, 3.2))
truth = robot.parameters.values
for runs, shift, colour in ((1, -0.12, "C1"), (6, 0.12, "C0")):
    intervals = estimators.fit(robot, simulated(runs)).intervals()
    ends = 100 * (np.array([(one.value, one.low, one.high) for one in intervals]).T / truth - 1)
    at = np.arange(len(truth)) + shift
    label = f"{runs} run{'s' * (runs > 1)} in each position"
    axes.errorbar(
        at,
        ends[0],
        [ends[0] - ends[1], ends[2] - ends[0]],
        fmt="o",
        ms=4,
        color=colour,
        label=label,
    )
axes.axhline(0, color="gray", lw=0.8)
axes.set_xticks(np.arange(len(truth)), robot.parameters.names)
axes.set(ylabel="estimate and 95 % interval,\ndeviation from the truth [%]")
axes.legend()
figure.tight_layout()
plt.show()
