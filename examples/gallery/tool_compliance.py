# %% [markdown]
# # How stiff is the tool?
#
# An identified robot predicts how far its tool deflects under a force, anywhere in the workspace, and how
# certain that is. A Manutec r3 is identified in two positions and asked elsewhere.

# %%
import matplotlib.pyplot as plt
import numpy as np

import estimators
import robotmodels
from robotmodels import Frame

robot = robotmodels.load_robot("manutec_r3")
omega = 2 * np.pi * np.geomspace(3, 60, 20)  # [rad/s]
positions = np.array([[0.0, 0.4, -0.6, 0.0, 0.5, 0.0], [0.5, -0.2, 0.3, 0.8, -0.4, 0.0]])
noise = robotmodels.RelativeNoise(relative=0.1, floor=0.03)
data = estimators.simulate_frf(robot, positions, omega, noise, np.random.default_rng(3))
fit = estimators.fit(robot, data, residual="nls", weights="optimal")
print(fit.trust.verdict)

# %% [markdown]
# The half axes of the compliance ellipsoid with clamped motors, softest first, while joint 3 bends the arm:

# %% picture="tool_compliance"
tip = Frame(robotmodels.tool_frame(robot).link, at=(0.0, 0.0, 0.1))
angles = np.linspace(-2.0, 2.0, 25)
path = np.array([[0.0, -0.3, angle, 0.0, 0.3, 0.0] for angle in angles])
compliance = estimators.predict(fit, estimators.ToolCompliance(tip), path)
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6))
for k, name in enumerate(("softest", "middle", "stiffest")):
    left.semilogy(np.degrees(angles), 1e6 * compliance.values[:, k], label=name)
    left.fill_between(
        np.degrees(angles), 1e6 * compliance.lower[:, k], 1e6 * compliance.upper[:, k], alpha=0.3
    )
left.set(xlabel="joint 3 [deg]", ylabel="compliance [µm/N]")
left.legend()
lines = 2 * np.pi * np.linspace(4, 60, 150)
hammer = estimators.predict(
    fit, estimators.ToolResponse(lines, tip, motion="acceleration"), path[12:13]
)
vertical = np.s_[0, :, 2, 2]
right.semilogy(lines / (2 * np.pi), np.abs(hammer.values[vertical]))
right.set(xlabel="frequency [Hz]", ylabel="accelerance along z [m/s² per N]")
figure.tight_layout()
plt.show()

# %%
resonances = estimators.predict(fit, "resonances", path[12:13])
for value, low, high in zip(
    resonances.values[0, :3], resonances.lower[0, :3], resonances.upper[0, :3], strict=True
):
    hertz = np.array([value, low, high]) / (2 * np.pi)
    print("{:.3f} Hz, 95 % within {:.3f} and {:.3f}".format(*hertz))
