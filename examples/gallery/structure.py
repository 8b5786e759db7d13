# %% [markdown]
# # Which springs does the robot have?
#
# A Manutec r3 has an elastic bearing at joint 2; its robot file has only the gears. Score tests ask,
# for every spring that the file has not, whether the residuals want it. Then refits decide.

# %%
import matplotlib.pyplot as plt
import numpy as np

import estimators
import robotmodels

robot = robotmodels.load_robot("manutec_r3")
springs = [
    s for s in robotmodels.possible_springs(robot) if s.joint in ("joint1", "joint2", "joint3")
]
bearing = next(s for s in springs if s.name == "joint2 z")
bearing = bearing.model_copy(update={"stiffness": 2e6, "damping": 2e3})
truth = robotmodels.with_springs(robot, [bearing], free=True)

omega = 2 * np.pi * np.linspace(4, 60, 15)  # [rad/s]
positions = np.array([[0.0, 0.4, -0.6, 0.0, 0.5, 0.0], [0.5, -0.2, 0.3, 0.8, -0.4, 0.0]])
noise = robotmodels.RelativeNoise(relative=0.03, floor=0.01)
data = estimators.simulate_frf(truth, positions, omega, noise, np.random.default_rng(1))

fit = estimators.fit(robot, data, residual="nls", weights="optimal")
print(fit.trust)

# %% [markdown]
# The verdict already says that something is missing. What?

# %%
table = estimators.score_tests(fit, springs)
for score in table[:4]:
    print(score)

# %%
choice = estimators.choose_structure(fit, springs)
print(choice)

# %% [markdown]
# With the spring the residuals are noise. The element of the FRFs where the model without it was worst:

# %% picture="structure"
modelled = robotmodels.frequency_response(fit.robot(), positions, omega)
misfit = np.sum(np.abs(data.response - modelled) ** 2 / data.variance, axis=1)
at, output, motor = np.unravel_index(np.argmax(misfit), misfit.shape)
element = np.s_[at, :, output, motor]
hertz, dense = omega / (2 * np.pi), 2 * np.pi * np.linspace(4, 60, 300)
figure, axes = plt.subplots(figsize=(7, 4))
axes.errorbar(
    hertz, np.abs(data.response[element]), 2 * np.sqrt(data.variance[element]), fmt="o", ms=3,
    label="measured, 2 std",
)  # fmt: skip
for one, label in ((fit, "gears only"), (choice.fit, "and the bearing of joint 2")):
    G = robotmodels.frequency_response(one.robot(), positions, dense)[element]
    axes.semilogy(dense / (2 * np.pi), np.abs(G), label=label)
axes.set(
    xlabel="frequency [Hz]",
    ylabel="|G| [rad/s² per N m]",
    title=f"motor {motor + 1} to motor {output + 1} in position {at + 1}",
)
axes.legend()
plt.show()
