"""Marginal likelihoods of noise against integrals, and against exact intervals."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import t

from estimators.uncertainty.likelihood import Noise


def test_the_scale_is_integrated_out():
    n = 12
    found = Noise("unknown").of_cost(np.array([2.0, 5.0]), n)

    def integral(cost):
        return quad(lambda s: s**-n * np.exp(-cost / s**2) / s, 0, np.inf)[0]

    assert found[1] - found[0] == pytest.approx(np.log(integral(5.0) / integral(2.0)), rel=1e-8)


def test_variances_are_integrated_out():
    """One element: blocks - 1 complex residuals about the mean, and the mean's own."""
    blocks, variance = 5, 0.3
    noise = Noise("estimated", blocks=blocks)
    found = noise.of_squares(np.array([[1.0 / variance], [4.0 / variance]]), 1)

    def integral(square):
        def joint(v):
            return v**-blocks * np.exp(-((blocks - 1) * variance + square) / v)

        return quad(joint, 0, np.inf)[0]

    assert found[1] - found[0] == pytest.approx(np.log(integral(4.0) / integral(1.0)), rel=1e-8)


def sampled(rng, blocks, d, *shape):
    """Return means (..., d) of correlated complex normals, and the inverse of their covariance."""
    root = np.linalg.cholesky(np.full((d, d), 0.7) + 0.3 * np.eye(d))
    z = rng.standard_normal((2, *shape, blocks, d)) @ root.T / np.sqrt(2)
    samples = z[0] + 1j * z[1]
    mean = samples.mean(axis=-2)
    apart = samples - mean[..., None, :]
    covariance = np.einsum("...bi,...bj->...ij", apart, apart.conj()) / (blocks * (blocks - 1))
    return mean, np.linalg.inv(covariance)


@pytest.mark.parametrize(("more", "low", "high"), [(0, 0.93, 0.97), (1, 0, 0.94), (4, 0, 0.91)])
def test_one_parameter_of_many_lines_is_covered(more, low, high):
    """Of d elements only the first moves with theta; the others tell its error by correlation.

    The exponents of the priors 1/|covariance| and Jeffreys', larger by 1 and d, are the negative
    controls.
    """
    d, blocks, lines, runs = 4, 9, 30, 1000
    mean, inverse = sampled(np.random.default_rng(0), blocks, d, runs, lines)
    power, theta = Noise("estimated", blocks=blocks).power(d) + more, np.zeros(runs)
    for _ in range(4):
        error = mean - theta[:, None, None] * np.eye(d)[0]
        pulled = np.einsum("rlij,rlj->rli", inverse, error)
        total = blocks - 1 + np.einsum("rli,rli->rl", error.conj(), pulled).real
        slope = 2 * power * (pulled[..., 0].real / total)
        bent = (
            2 * power * (inverse[..., 0, 0].real / total - 2 * (pulled[..., 0].real / total) ** 2)
        )
        theta = theta + slope.sum(axis=1) / bent.sum(axis=1)
    inside = np.abs(theta) * np.sqrt(bent.sum(axis=1)) < 1.96
    assert low < inside.mean() < high


def test_one_parameter_of_one_line_has_a_wide_interval():
    d, blocks, runs = 3, 8, 4000
    mean, inverse = sampled(np.random.default_rng(0), blocks, d, runs)
    # log p is a Student t of theta: center, least Q and curvature of Q = Q0 + h (theta - c)^2,
    # theta a real and an imaginary part.
    h = inverse[:, 0, 0].real
    center = np.einsum("rj,rj->r", inverse[:, 0], mean) / h
    rest = mean - center[:, None] * np.eye(d)[0]
    q0 = np.einsum("ri,rij,rj->r", rest.conj(), inverse, rest).real
    # (1 + Q/nu)^-power over a plane; one part alone has the power less 1/2, 2 power - 2 degrees.
    dof = 2 * Noise("estimated", blocks=blocks).power(d) - 2
    scale = np.sqrt((blocks - 1 + q0) / h / dof)
    inside = np.abs(center.real) < t.ppf(0.975, dof) * scale
    assert 0.955 < inside.mean() < 0.99


def test_single_elements_of_known_and_estimated_noise_meet_for_many_blocks():
    squares = np.array([[0.3, 2.0], [1.0, 0.1]])
    many = Noise("estimated", blocks=100_000).of_squares(squares, 1)
    assert many == pytest.approx(-squares.sum(axis=1), rel=1e-4)
