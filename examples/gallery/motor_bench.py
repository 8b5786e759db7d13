# %% [markdown]
# # A real motor bench
#
# Two inertias with a shaft between them, shaken through the motor's current; only the motor's encoder is
# used. The records are those of the Hori-Fujimoto Lab (MIT License, see `examples/data`). Currents stand for
# torques, so that everything is in units of the unknown torque constant.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.io import loadmat

import estimators
import robotmodels

folder = next(p for p in (Path.cwd(), *Path.cwd().parents) if (p / "examples/data").is_dir())
data = loadmat(folder / "examples/data/motor_bench.mat", squeeze_me=True)


def shaped(signal):  # positions, blocks, runs, periods, samples, motors
    return np.asarray(signal, dtype=float).reshape(1, 1, 1, -1, 2500, 1)


records = robotmodels.Records(
    positions=np.zeros((1, 1)),
    sample_time=1 / 2500,  # [s]
    reference=shaped(data["ref"]),
    torque=shaped(data["iq_adx"]),
    angle=shaped(data["theta_mx"]),
    lines=np.arange(13, 250, 4),  # DFT lines that are excited
    detection=np.arange(15, 249, 4),  # and left out, to show distortion
    saturated=np.zeros((1, 1, 1, 20, 1), dtype=bool),
)

# %% [markdown]
# ## The frequency response
#
# The current was measured, not commanded, so nothing is held over a sample. The first period is not
# settled. Lines that were left out of the multisine tell how far the bench is from linear.

# %%
frf = estimators.estimate_frf(records, covariance="noise", hold=False, transient=1)
bent = estimators.distortion(records, hold=False, transient=1)
level = np.sqrt(np.mean(bent.odd_raw**2) / np.mean(bent.output**2))
print(f"odd lines that were not excited lie {-20 * np.log10(level):.0f} dB below those that were")

# %% [markdown]
# ## Masses and springs
#
# As a chain of two masses: poles and zeros give start values (an inverse eigenvalue problem), which
# maximum likelihood polishes; then dampers, friction and a delay are fitted with them. Chains speak of
# masses in kg and springs in N/m; here they are inertias and a torsion over the torque constant. Published
# fits of these records have 4.80e-3 for both inertias and 552.5 for the spring.

# %%
chain = estimators.chains_from_frf(frf, n_masses=2)
dampers = estimators.fit_dampers(chain)
print(dampers)

# %% [markdown]
# The verdict is honest: a real bench is not as linear as its noise is small, and the intervals that noise
# alone would give are not to be quoted.

# %% picture="motor_bench"
hertz = frf.omega / (2 * np.pi)
G = frf.response[0, :, 0, 0]
dense = 2 * np.pi * np.linspace(13, 249, 800)
model = robotmodels.frequency_response(dampers.model, np.zeros((1, 1)), dense)[0, :, 0, 0]
figure, (above, below) = plt.subplots(2, sharex=True, figsize=(7, 5), height_ratios=[2, 1])
above.semilogy(hertz, np.abs(G), "o", ms=4, label="measured")
above.semilogy(dense / (2 * np.pi), np.abs(model), label="two masses, spring and damper")
above.set(ylabel="|G| [rad/s² per A]")
above.legend()
below.semilogy(hertz, np.sqrt(frf.variance[0, :, 0, 0]) / np.abs(G), ".", label="noise")
below.set(xlabel="frequency [Hz]", ylabel="relative std [-]")
plt.show()
