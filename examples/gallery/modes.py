# %% [markdown]
# # What the robot does at its resonances
#
# Springs at the gears and bearings let the arm swing in modes of its own. Which spring bends in which mode
# decides where it can be measured: a position in which a mode does not bend a spring says nothing of it.
# `oed view ur10` shows the same in the browser, moving.

# %%
import matplotlib.pyplot as plt
import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import robotmodels
from robotmodels.collision.surfaces import link_surfaces
from robotmodels.elastic.elastic_pose import joint_placements

robot = robotmodels.load_robot("ur10")
position = np.radians([0, -60, 80, -20, 60, 0])
(rest,) = robot.equilibrium(position[None]).coordinates
modes = robotmodels.resonances(robotmodels.linearize(robot, position))
print("resonances [Hz]:", (modes.frequencies / (2 * np.pi)).round(2))

# %% picture="modes"
surfaces = link_surfaces(robot)
figure = plt.figure(figsize=(10, 3.2))
for mode in range(3):
    axes = figure.add_subplot(1, 3, mode + 1, projection="3d")
    shape = modes.shapes[: len(rest), mode]
    for swing, colour, alpha in ((0.0, "lightgray", 0.3), (0.25, "tab:blue", 0.9)):
        (placed,) = joint_placements(robot, (rest + swing * shape / np.abs(shape).max())[None])
        for one in surfaces:
            at = placed[one.joint]
            corners = (one.vertices @ at[:3, :3].T + at[:3, 3])[one.faces]
            axes.add_collection3d(
                Poly3DCollection(corners, facecolors=colour, alpha=alpha, shade=True)
            )
    axes.set(xlim=(-0.1, 1.1), ylim=(-0.5, 0.7), zlim=(-0.1, 1.1))
    axes.set_box_aspect((1, 1, 1), zoom=1.6)
    axes.view_init(18, -60)
    axes.set_axis_off()
    axes.set_title(f"{modes.frequencies[mode] / (2 * np.pi):.1f} Hz", y=0.95)
figure.tight_layout()
plt.show()

# %% [markdown]
# Which springs hold the energy of each mode, in per cent:

# %%
network = robot.network(position[None])
stiffness, nodes = network.spring_stiffness[0], network.nodes
padded = np.vstack([modes.shapes, np.zeros(modes.shapes.shape[1])])  # -1 is the ground
energy = stiffness[:, None] * (padded[nodes[:, 0]] - padded[nodes[:, 1]]) ** 2
share = 100 * energy / energy.sum(axis=0)
for mode in range(3):
    most = np.argsort(-share[:, mode])[:3]
    names = ", ".join(f"{robot.file.springs[i].name} {share[i, mode]:.0f} %" for i in most)
    print(f"{modes.frequencies[mode] / (2 * np.pi):5.2f} Hz: {names}")
