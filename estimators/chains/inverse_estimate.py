"""Chains from fitted modes by inverse eigenvalue theory: all Lanczos steps, or [HBH] 3.4's."""

from itertools import combinations

import numpy as np

from estimators.chains.chain_estimate import ChainEstimate, check_physical
from estimators.chains.inverse_eigenvalue import coupled_inertia
from estimators.chains.modal_model import chain_spectra
from estimators.chains.modes import FittedModes
from estimators.chains.parameter_maps import ChainLayout, inverse_map, inverse_slope
from estimators.chains.pole_zero_spectra import squared_components
from estimators.chains.stepwise import masses_in_steps
from robotmodels.common.arrays import Array
from robotmodels.common.errors import NotIdentifiable

_ROUNDING = 3e-4  # relative standard deviation in exact FRFs from which on a mass is refused


def inverse_estimate(
    modes: FittedModes, layout: ChainLayout, first_masses: Array | None, stepwise: bool = False
) -> ChainEstimate:
    """Return the solution of the inverse eigenvalue problem for fitted modes.

    The covariance is that of the modes carried through every step (delta method). It is the same
    for both ways, which compute the same function of the modes.

    Parameters
    ----------
    stepwise : bool
        Whether by [HBH] sections 3.1 to 3.4 as printed, two masses at a time, or one where motor
        inertias are given; by the Lanczos recursion to the end if not.

    Raises
    ------
    NotIdentifiable
        If a mass, a spring or the mass matrix comes out not positive: more masses than these data
        support; or, of exact FRFs, if rounding leaves a mass or a spring open.
    """
    p = layout.modal.size
    x = modes.x[:p]
    with np.errstate(all="ignore"):
        lanczos = inverse_map(x, layout, first_masses)
    theta = _stepwise(modes, layout, first_masses) if stepwise else lanczos
    check_physical(theta, layout)
    slope = inverse_slope(x, layout, first_masses)
    covariance = slope @ modes.covariance[:p, :p] @ slope.T
    if first_masses is not None:
        covariance[layout.first] = covariance[:, layout.first] = 0.0
    method = "inverse eigenvalue problem, " + ("step by step" if stepwise else "Lanczos")
    condition = _condition(slope, x, theta, layout)
    estimate = ChainEstimate(layout, theta, covariance, method, condition)
    if modes.data.undamped:
        _check_rounding(estimate)
    return estimate


def _check_rounding(estimate: ChainEstimate) -> None:
    """Refuse masses and springs that rounding of exact FRFs leaves open.

    Rounding errors are not independent: they exceed standard deviations made of the misfit by up
    to thirty times, so that about 1 % is refused.
    """
    p = estimate.layout.positive
    pairs = zip(estimate.names[:p], estimate.relative_std[:p], strict=True)
    if names := tuple(name for name, std in pairs if not std <= _ROUNDING):
        raise NotIdentifiable(
            names,
            "rounding of these FRFs leaves them undetermined: give fewer masses, or more "
            "lines, above all near the resonances that the motor hardly excites",
        )


def _stepwise(modes: FittedModes, layout: ChainLayout, first_masses: Array | None) -> Array:
    """Return theta from poles, zeros and gains: [HBH] (2), (3), (7), (8) and (13) to (22).

    The gains are those of the fitted modes with the other chains held, so that nobody need hold
    them.
    """
    poles = np.concatenate([[0.0], modes.omega**2])
    low, count = modes.low_gains, layout.masses
    motors, per_step = (first_masses, 1) if first_masses is not None else (1 / modes.high_gains, 2)
    masses, springs = [], []
    for i, (_, distances, _) in enumerate(chain_spectra(modes.x, modes.layout)):
        first = np.sqrt(squared_components(poles, distances))  # (13)
        felt = first > 0
        m, k = masses_in_steps(poles[felt], first[felt], motors[i], count, 1 / low[i], per_step)
        masses.append(m)
        springs.append(k)
    couplings = np.zeros((layout.chains, layout.chains))
    for i, j in combinations(range(layout.chains), 2):
        couplings[i, j] = coupled_inertia(modes.cross_gain(i, j), low[i], low[j])
    return layout.join(np.array(masses), np.array(springs), couplings)


def _condition(slope: Array, x: Array, theta: Array, layout: ChainLayout) -> float:
    """Return the norm of d ln theta / d ln (J, lambda, weights); couplings against their masses."""
    m, n = layout.chains, layout.modes
    scale_theta = np.abs(theta)
    masses, _, _ = layout.split(theta)
    last = masses[:, -1]
    i, j = np.triu_indices(m, 1)
    scale_theta[layout.positive :] = np.sqrt(last[i] * last[j])
    inertia = layout.modal.split(x)[0]
    diagonal = np.sqrt(np.outer(np.diag(inertia), np.diag(inertia)))[np.triu_indices(m)]
    # lambda = omega^2 and w = phi^2: half the slopes by their logarithms.
    scale_x = np.concatenate([diagonal, np.full(n, 0.5), 0.5 * np.abs(x[len(diagonal) + n :])])
    return float(np.linalg.norm(slope * scale_x / scale_theta[:, None], 2))
