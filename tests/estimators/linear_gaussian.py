"""A problem whose posterior is known in closed form: log FRFs that are linear in ln theta.

A shaft without mass hangs on one spring, k = theta^E with a row of E per position, so that
ln G = const - E ln theta; with errors that multiply FRFs by exp(eta) the log residual is linear.
"""

from dataclasses import dataclass, field

import numpy as np

from estimators import FrfEstimate, fit
from robotmodels import Parameters, SpringNetwork, frequency_response

NAMES = ("a", "b", "c")
OMEGA = np.array([1.0, 2.0, 3.0, 4.0])
DESIGN = np.array(
    [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 1.0, 0.2], [0.3, 0.0, 0.7], [0.0, 0.4, 0.6]]
)
POSITIONS = np.arange(5.0)[:, None]
TRUTH = np.array([3.0, 5.0, 2.0])


@dataclass(frozen=True, eq=False)
class LogLinear:
    parameters: Parameters = field(default_factory=lambda: Parameters(NAMES, TRUTH, ("",) * 3))

    def network(self, positions, parameters=None):
        theta = self.parameters.check(parameters)
        rows = DESIGN[np.asarray(positions)[:, 0].astype(int)]
        exponents = np.zeros((len(rows), 2, 3))
        exponents[:, 0] = rows
        return SpringNetwork(
            mass=np.zeros((len(rows), 1, 1)),
            damping=np.zeros((1, 1)),
            stiffness=np.zeros((len(rows), 1, 1)),
            selector=np.ones((1, 1)),
            nodes=np.array([[0, -1]]),
            spring_stiffness=np.exp(rows @ np.log(theta))[:, None],
            spring_damping=np.zeros((len(rows), 1)),
            exponents=exponents,
            parameters=Parameters(NAMES, theta, ("",) * 3),
        )


MODEL = LogLinear()


def simulated(rng, sigma=0.1):
    """Return FRFs with errors exp(eta), eta circular of variance sigma^2."""
    G = frequency_response(MODEL, POSITIONS, OMEGA)
    eta = sigma / np.sqrt(2) * (rng.standard_normal(G.shape) + 1j * rng.standard_normal(G.shape))
    return FrfEstimate(
        POSITIONS, OMEGA, G * np.exp(eta), sigma**2 * np.abs(G) ** 2, np.ones(5, dtype=int)
    )


def fitted(estimate, sigma=0.1, weights=None, **arguments):
    shape = estimate.response.shape
    weights = np.full(shape, sigma**-2) if weights is None else weights
    return fit(MODEL, estimate, "lls", weights, **arguments)


def closed_form(estimate, sigma=0.1, prior=None):
    """Return mean and covariance of the posterior of ln theta."""
    y = np.log(np.abs(estimate.response[..., 0, 0]) / OMEGA**2)
    information = 2 * len(OMEGA) / sigma**2 * DESIGN.T @ DESIGN
    right = -2 / sigma**2 * DESIGN.T @ y.sum(axis=1)
    if prior is not None:
        mean, std = prior
        information = information + np.diag(std**-2.0)
        right = right + mean / std**2
    covariance = np.linalg.inv(information)
    return covariance @ right, covariance
