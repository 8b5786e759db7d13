# %% [markdown]
# # Candidates in a file
#
# More candidates than memory holds lie in a file, which processes or the [workers of a cluster](../how-to/many-machines.md)
# write and read; designs, certificates and plans are those of candidates in memory.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import oed
import robotmodels

robot = robotmodels.load_robot("manutec_r3")
omega = 2 * np.pi * np.geomspace(3, 80, 20)  # [rad/s]
noise = robotmodels.RelativeNoise(relative=0.03, floor=0.01)
positions = oed.candidate_positions(robot, per_joint=[1, 10, 10, 5, 5, 1])
store = oed.information(robot, positions, omega, noise, store=Path("candidates.oed"))
print(f"{len(positions)} candidates in {Path('candidates.oed').stat().st_size / 1e6:.1f} MB")

# %% [markdown]
# A round of the design solves over a few candidates and then prices all of them, chunk by chunk: the largest price
# bounds what any design could gain, the certified gap. It needs few passes over the file.

# %% picture="candidates_in_files"
design = oed.optimal_design(store)
print(design)
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.2))
left.semilogy(np.arange(1, len(design.gaps) + 1), design.gaps, "o-")
left.set_xticks(np.arange(1, len(design.gaps) + 1))
left.set(xlabel="pass over the file", ylabel="certified gap [-]")
right.hist(design.sensitivity / design.sensitivity.max(), bins=60)
right.set(xlabel="sensitivity function over its maximum [-]", ylabel="candidates", yscale="log")
figure.tight_layout()
plt.show()
