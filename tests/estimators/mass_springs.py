"""A small elastic system for the estimators' tests: two motors, two arm masses, three springs.

A "position" (1,) loads the second arm mass; the arm masses are coupled, so all FRF elements exist.
"""

from dataclasses import dataclass, field

import numpy as np

from robotmodels import NoEquilibrium, Parameters, SpringNetwork

NAMES = ("k1", "k2", "k12", "c1", "c2", "c12")
UNITS = ("N m/rad",) * 3 + ("N m s/rad",) * 3
OMEGA = 2 * np.pi * np.linspace(1.0, 12.0, 23)
POSITIONS = np.array([[0.0], [0.7], [1.5]])


def default_parameters():
    return Parameters(NAMES, np.array([900.0, 1500.0, 400.0, 2.0, 3.0, 1.0]), UNITS)


@dataclass(frozen=True, eq=False)
class MassSprings:
    parameters: Parameters = field(default_factory=default_parameters)
    weakest: float = 0.0  # below this k1 has no equilibrium

    def network(self, positions, parameters=None):
        theta = self.parameters.check(parameters)
        if theta[0] < self.weakest:
            raise NoEquilibrium(f"k1 = {theta[0]:g} is below {self.weakest:g}")
        q = len(positions)
        mass = np.zeros((q, 4, 4))
        mass[:, [0, 1], [0, 1]] = [0.5, 0.4]
        mass[:, 2, 2] = 1.0
        mass[:, 3, 3] = 0.8 + np.asarray(positions)[:, 0]
        mass[:, 2, 3] = mass[:, 3, 2] = 0.3
        damping = np.zeros((q, 4, 4))
        damping[:, [0, 1], [0, 1]] = [0.3, 0.2]
        return SpringNetwork(
            mass=mass,
            damping=damping,
            stiffness=np.zeros((q, 4, 4)),
            selector=np.eye(4)[:, :2],
            nodes=np.array([[2, 0], [3, 1], [2, 3]]),
            spring_stiffness=np.tile(theta[:3], (q, 1)),
            spring_damping=np.tile(theta[3:], (q, 1)),
            exponents=np.tile(np.eye(6), (q, 1, 1)),
            parameters=Parameters(NAMES, theta, UNITS),
        )
