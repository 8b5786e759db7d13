# %% [markdown]
# # Measured data in a CSV file
#
# FRFs of another program, one row for each position and line, are read, fitted and judged. The file is
# written here by a simulation of a robot whose springs are not those of the robot file; put your own in
# its place. Its columns are in [file formats](../files.md).

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import estimators
import reports
import robotmodels

truth = robotmodels.load_robot("manutec_r3")
positions = np.array([[0.0, 0.4, -0.6, 0.0, 0.5, 0.0], [0.5, -0.2, 0.3, 0.8, -0.4, 0.0]])  # [rad]
omega = 2 * np.pi * np.geomspace(3, 80, 40)  # [rad/s]
noise = robotmodels.RelativeNoise(relative=0.05, floor=0.002)
estimators.write_frf(
    "frf.csv",
    estimators.simulate_frf(truth, positions, omega, noise, np.random.default_rng(1)),
)

# %%
print(Path("frf.csv").read_text()[:300], "...")
frf = estimators.read_frf("frf.csv")
guess = robotmodels.with_values(truth, 1.5 * truth.parameters.values)  # what a data sheet says
fit = estimators.fit(guess, frf, residual="nls", weights="optimal")
print(fit.trust)

# %% [markdown]
# The verdict says whether the intervals may be quoted. The band of the model is that of the parameters;
# the bars are two standard deviations of the measurement.

# %% picture="measured_csv"
dense = 2 * np.pi * np.geomspace(3, 80, 300)
band = estimators.predict_frf(
    guess, fit.parameters.values, positions[:1], dense, estimators.covariance(fit)
)
figure, panels = plt.subplots(1, 3, figsize=(10, 3.4), sharex=True)
for axis, axes in enumerate(panels):
    element = np.s_[0, :, axis, axis]
    std = np.sqrt(frf.variance[element])
    hertz = omega / (2 * np.pi)
    axes.errorbar(hertz, np.abs(frf.response[element]), 2 * std, fmt=".", ms=4, label="measured")
    axes.loglog(dense / (2 * np.pi), np.abs(band.response[element]), label="fitted")
    axes.fill_between(dense / (2 * np.pi), band.lower[element], band.upper[element], alpha=0.4)
    axes.set_xticks([5, 10, 20, 50], [5, 10, 20, 50])
    axes.xaxis.set_minor_formatter("")
    axes.set(xlabel="frequency [Hz]", title=f"motor {axis + 1}")
panels[0].set(ylabel="|G| [rad/s² per N m]")
panels[0].legend()
figure.tight_layout()
plt.show()

# %% [markdown]
# Residuals over their standard deviations are about one everywhere, if the model is right. The figures of
# the report are functions, too:

# %% picture="residuals"
reports.plots.residuals(fit)

# %% [markdown]
# Positions that were not fitted are the hardest judge: here a fit of the first position alone predicts
# the second.

# %%
alone = estimators.fit(guess, frf.subset([0]), residual="nls", weights="optimal")
print(
    estimators.validate(
        guess, alone.parameters.values, frf.subset([1]), estimators.covariance(alone)
    )
)
