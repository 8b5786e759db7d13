"""A Student t shaped like a posterior at its mode: a proposal, never the answer."""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln

from estimators.fitting.fitted_model import FittedModel
from estimators.sampling.log_posterior import LogPosterior
from estimators.sampling.log_posterior_gradient import slope
from robotmodels.common.arrays import Array
from robotmodels.common.symmetric_matrices import scaled_eigh

# Heavy enough to cover tails beyond the normal's, light enough for 26 dimensions.
DOF = 20.0
# Standard deviation of ln theta where the data say nothing.
BROAD = 2.0
# Of the search for the mode, which begins at the fit.
STEPS = 10


@dataclass(frozen=True, eq=False)
class StudentT:
    """Multivariate Student t distribution of ln theta.

    Attributes
    ----------
    center : ndarray, (p,)
        Center.
    root : ndarray, (p, p)
        Root root^T is the scale matrix, the covariance times (dof - 2)/dof.
    dof : float
        Degrees of freedom, positive.
    """

    center: Array
    root: Array
    dof: float = DOF

    def draw(self, n: int, rng: np.random.Generator | np.random.RandomState) -> Array:
        """Return n draws, (n, p)."""
        z = rng.standard_normal((n, len(self.center)))
        stretch = np.sqrt(self.dof / rng.chisquare(self.dof, n))
        return np.asarray(self.center + stretch[:, None] * (z @ self.root.T))

    def log_density(self, x: Array) -> Array:
        """Return the logarithm of the density (n,) at `x` (n, p)."""
        p, nu = len(self.center), self.dof
        white = np.linalg.solve(self.root, (x - self.center).T)
        _, log_det = np.linalg.slogdet(self.root)
        constant = gammaln((nu + p) / 2) - gammaln(nu / 2) - p / 2 * np.log(nu * np.pi) - log_det
        return np.asarray(constant - (nu + p) / 2 * np.log1p(np.sum(white**2, axis=0) / nu))


def student_t(center: Array, information: Array, dof: float = DOF) -> StudentT:
    """Return the t whose scale matrix is the inverse of `information`, (p, p).

    Directions without information get the width BROAD.
    """
    regular = information + np.eye(len(center)) / BROAD**2
    s, values, vectors = scaled_eigh(regular)
    root = s[:, None] * vectors / np.sqrt(np.maximum(values, 1e-15))
    return StudentT(center, root, dof)


def laplace(fit: FittedModel, target: LogPosterior, dof: float = DOF) -> StudentT:
    """Return the t about the mode of `target`, which Gauss-Newton steps reach from the fit."""
    bread, _ = fit.sandwich_parts()
    information = target.noise.curvature(fit.data_cost, target.data) * bread
    if target.prior is not None:
        information = information + target.prior.information(target.names)
    return student_t(_mode(fit, target), information, dof)


def _mode(fit: FittedModel, target: LogPosterior) -> Array:
    """Return ln theta (p,) where the density is largest: the fit's, unless they differ.

    A prior that the fit did not have, or weighed otherwise, moves it.
    """
    center = np.clip(np.log(fit.parameters.values), *target.bounds)
    alike = fit.prior is target.prior and (target.prior is None or target.noise.scale == 1)
    if alike:
        return center
    for _ in range(STEPS):
        here = slope(target, center)
        root = student_t(center, here.hessian).root
        step = -root @ (root.T @ here.gradient)
        center = np.clip(center + step, *target.bounds)
        if step @ here.hessian @ step < 1e-4:
            break
    return center
