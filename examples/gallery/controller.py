# %% [markdown]
# # A controller on the identified robot
#
# The identified springs and dampers say how close a controller is to instability, and what the fit leaves open says how
# sure that is: [What does this mean for my controller?](../how-to/controller-margins.md) A Manutec r3 is identified in
# two positions; its controller is asked about others.

# %%
import matplotlib.pyplot as plt
import mujoco
import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import StateSpace, lsim

import estimators
import robotmodels

robot = robotmodels.load_robot("manutec_r3")
omega = 2 * np.pi * np.geomspace(3, 60, 20)  # [rad/s]
positions = np.array([[0.0, 0.4, -0.6, 0.0, 0.5, 0.0], [0.5, -0.2, 0.3, 0.8, -0.4, 0.0]])
noise = robotmodels.RelativeNoise(relative=0.1, floor=0.03)
data = estimators.simulate_frf(robot, positions, omega, noise, np.random.default_rng(3))
fit = estimators.fit(robot, data, residual="nls", weights="optimal")
gains = robotmodels.default_controller(robot, 0.002)
feedback = robotmodels.linear_feedback(gains)

# %% picture="margins"
angles = np.linspace(-1.5, 1.5, 7)
path = np.array([[0.0, 0.3, angle, 0.0, 0.3, 0.0] for angle in angles])
band = estimators.predict_margins(fit, feedback, path, rng=np.random.default_rng(0), draws=30)
locus = robotmodels.determinant_loci(robot, path[:1], feedback)[0]
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6))
for motor in range(3):
    peak, name = band.nominal.peak_sensitivity[:, motor], robot.motor_names[motor]
    left.plot(np.degrees(angles), peak, label=name)
    ends = band.lower.peak_sensitivity[:, motor], band.upper.peak_sensitivity[:, motor]
    left.fill_between(np.degrees(angles), *ends, alpha=0.3)
left.set(xlabel="joint 3 [deg]", ylabel="largest |S| [-]")
left.margins(y=0.2)
left.legend(ncol=3, loc="upper center")
right.plot(locus.values.real, locus.values.imag)
right.plot(0, 0, "k+")
right.set(xlabel="Re det(1 + F G)", ylabel="Im det(1 + F G)", xlim=(-1, 4), ylim=(-2.5, 2.5))
figure.tight_layout()
plt.show()

# %% [markdown]
# On the left the largest sensitivity of three motors' loops with its 95 % band, on the right the curve whose turns about
# the origin decide on stability.
#
# ## The same robot in MuJoCo
#
# [Exported](../how-to/take-the-model-out.md) models hold what was identified. MuJoCo's answer to a step of the torque of
# the first motor, and that of the state-space model of the same fit:

# %% picture="model_out"
fitted = fit.robot()
robotmodels.export(fitted, "r3.xml", "mjcf", positions)
model = mujoco.MjModel.from_xml_path("r3.xml")
model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT  # no friction that holds
model.opt.timestep = 1e-4
state = mujoco.MjData(model)
mujoco.mj_resetDataKeyframe(model, state, 0)
state.ctrl[0] += 0.5  # [N m]
time, speed = 1e-4 * np.arange(5000), []
for _ in time:
    speed.append(state.sensor("m1.velocity").data[0])
    mujoco.mj_step(model, state)
linear = robotmodels.state_space(fitted, positions[:1])
step = np.zeros((len(time), len(robot.motor_names)))
step[:, 0] = 0.5
system = StateSpace(linear.A[0], linear.B[0], linear.C[0], linear.D[0])
acceleration = lsim(system, step, time)[1][:, 0]  # [rad/s^2]
figure, axes = plt.subplots(figsize=(9, 3.2))
axes.plot(time, speed, lw=4, alpha=0.4, label="MuJoCo, exported MJCF")
axes.plot(time, cumulative_trapezoid(acceleration, time, initial=0), label="state-space model")
axes.set(xlabel="time after a torque step of 0.5 N m [s]", ylabel="speed of motor m1 [rad/s]")
axes.legend()
figure.tight_layout()
plt.show()
