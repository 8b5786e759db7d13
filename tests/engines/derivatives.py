"""Derivatives by central differences, information by its definition, and complex noise."""

from collections.abc import Callable

import numpy as np

from robotmodels import frequency_response


def circular(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Return circular complex normal numbers of variance one."""
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


def by_logarithms(
    function: Callable[[np.ndarray], np.ndarray], values: np.ndarray, step: float = 1e-5
) -> np.ndarray:
    """Return the derivatives of a function by ln of its values, (..., p)."""
    factors = np.exp(step * np.eye(len(values)))
    ends = [(function(values * factor), function(values / factor)) for factor in factors]
    return np.stack([(up - down) / (2 * step) for up, down in ends], axis=-1)


def frf_derivatives(
    model: object, positions: np.ndarray, omega: np.ndarray, step: float = 1e-5
) -> np.ndarray:
    """Return the derivatives of FRFs by ln theta, (Q, F, m, n, p)."""
    return by_logarithms(
        lambda theta: frequency_response(model, positions, omega, theta),
        model.parameters.values,
        step,
    )


def check_gradient(problem: object, values: np.ndarray) -> None:
    """Compare the gradient of a sum of squares with differences of that sum."""
    residuals, jacobian = problem.evaluate(values)
    gradient = 2 * jacobian.T @ residuals
    steps = by_logarithms(lambda at: np.sum(problem.evaluate(at)[0] ** 2), values)
    np.testing.assert_allclose(gradient, steps, atol=1e-7 * np.abs(gradient).max())


def information_of(jacobian: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Return the information of FRFs (Q, F, m, n) of independent errors, (Q, p, p)."""
    white = jacobian / np.sqrt(variance)[..., None]
    return 2 * np.einsum("qfmnp,qfmnr->qpr", white.conj(), white).real


def apart(found: np.ndarray, expected: np.ndarray) -> float:
    """Return the largest difference of matrices (..., p, p) in units of expected diagonals."""
    size = np.sqrt(np.einsum("...ii->...i", expected))
    return float(np.abs((found - expected) / size[..., :, None] / size[..., None, :]).max())
