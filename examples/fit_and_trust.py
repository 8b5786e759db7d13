"""What are the springs and dampers, and how far to trust them: a fit from FRFs, cross-checked.

The FRFs are simulated here; put `estimators.read_frf("frf.h5")` in their place for measured ones.
"""

import numpy as np

import estimators
import robotmodels

rng = np.random.default_rng(1)
robot = robotmodels.load_robot("manutec_r3")
positions = np.array([[0.0, 0.4, -0.6, 0.0, 0.5, 0.0], [0.5, -0.2, 0.3, 0.8, -0.4, 0.0]])
omega = 2 * np.pi * np.geomspace(3, 80, 30)  # [rad/s]
noise = robotmodels.RelativeNoise(relative=0.03, floor=0.01)
data = estimators.simulate_frf(robot, positions, omega, noise, rng)

# Rough user weights find the right minimum from far away; optimal ones are sharper once there.
starts = estimators.perturbed_starts(robot.parameters, 5, 0.5, rng)
rough = estimators.multistart(robot, data, starts, "lls", "user")
best = rough[0]
reached = sum(fit.cost < 1.01 * best.cost for fit in rough)
print(f"{reached} of {len(rough)} starts end at the best cost")
fit = estimators.fit(robot, data, residual="nls", weights="optimal", start=best.parameters.values)

print(fit.trust)  # the interval to quote for each parameter, and the verdict
print(estimators.cross_check(fit, importance=estimators.importance_sample(fit, rng=rng)))
print(estimators.residual_analysis(fit))
print(estimators.identifiability(estimators.fit_information(fit), fit.parameters.names))
