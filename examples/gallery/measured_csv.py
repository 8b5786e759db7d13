# %% [markdown]
# # Measured data in a CSV file
#
# FRFs of another program, one row for each position and line, are read, fitted and judged. The file is
# written here by a simulation of a robot whose springs are not those of the robot file; put your own in
# its place. Its columns are in [file formats](../files.md).

# %%
from pathlib import Path

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
# The verdict says whether the intervals may be quoted. Bands are one standard deviation: of the
# measurement, and of the model by those of the parameters.

# %% picture="measured_csv"
reports.plots.frf(frf, fit, rows=[1], columns=[1, 2, 4], spread=estimators.covariance(fit))

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
