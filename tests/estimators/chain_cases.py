"""The case study of [HBH] and FRFs of it in noise."""

import numpy as np

from estimators.chains.parameter_maps import ChainLayout
from robotmodels.linear.coupled_chains import CoupledChains

MASSES = np.array([[0.7, 2, 3], [4, 5, 6], [7, 8, 9]])
SPRINGS = np.array([[1000.0, 2000], [3000, 4000], [5000, 6000]])
COUPLINGS = np.array([[0.0, 1, 2], [1, 0, 3], [2, 3, 0]])
CHAINS = CoupledChains(MASSES, SPRINGS, COUPLINGS)
TRUTH = ChainLayout(3, 3).join(MASSES, SPRINGS, COUPLINGS)
OMEGA = 2 * np.pi * np.arange(0.5, 10.0, 0.1)


def noisy(model, rng, relative=0.01, omega=OMEGA):
    """FRFs with circular noise, relative to each element and to the largest of its line."""
    G = model.frequency_response(omega)
    largest = np.abs(G).max(axis=(1, 2), keepdims=True)
    variance = relative**2 * (np.abs(G) ** 2 + (0.3 * largest) ** 2)
    noise = rng.standard_normal((2, *G.shape)) * np.sqrt(variance / 2)
    return G + noise[0] + 1j * noise[1], variance
