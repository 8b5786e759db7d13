"""Candidate sets for the tests of designs."""

import numpy as np

from oed import InformationSet


def information_set(matrices):
    matrices = np.asarray(matrices, dtype=float)
    names = tuple(f"k{i}" for i in range(matrices.shape[-1]))
    return InformationSet(np.arange(len(matrices), dtype=float)[:, None], matrices, names)


def random_set(seed, n_candidates, p, rank):
    """Information J J' of `rank` random regressors of very different lengths."""
    rng = np.random.default_rng(seed)
    lengths = np.exp(0.5 * rng.standard_normal((n_candidates, 1, rank)))
    jacobian = rng.standard_normal((n_candidates, p, rank)) * lengths
    return information_set(jacobian @ np.swapaxes(jacobian, 1, 2))


def quadratic_regression(points):
    """Candidates x of the regression y = a + b x + c x^2."""
    regressors = np.stack([np.ones_like(points), points, points**2], axis=1)
    return information_set(regressors[:, :, None] * regressors[:, None, :])
