"""Steps from the modes of the motors to masses, springs and couplings: [HBH] sections 3.2 to 3.4.

A chain is a Jacobi matrix up to its last mass, whose coupling to the other chains is inside the
spectrum.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.chains.pole_zero_spectra import zeros_between
from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput, NotIdentifiable


@dataclass(frozen=True, eq=False)
class LanczosStep:
    """First step of the Lanczos algorithm, [HBH] (14)-(16).

    Attributes
    ----------
    b11, b12, b22 : float, 1/s^2
        Elements of B = M^-1/2 K M^-1/2 that belong to the first two masses.
    d2 : ndarray, (k,), 1/s^2
        The vector d_2 whose direction is u2.
    u2 : ndarray, (k,), dimensionless
        Second components of the eigenvectors.
    """

    b11: float
    d2: Array
    b12: float
    u2: Array
    b22: float


def lanczos_step(poles: Array, first: Array) -> LanczosStep:
    """Return B11, d2, B12, u2 and B22 from lambda (k,) and u1 (k,), [HBH] (14)-(16)."""
    b11 = float(first @ (poles * first))
    d2 = b11 * first - poles * first
    b12 = float(np.sqrt(d2 @ d2))
    u2 = d2 / b12
    return LanczosStep(b11, d2, b12, u2, float(u2 @ (poles * u2)))


def without_first_mass(poles: Array, weights: Array, mass: float) -> tuple[Array, Array]:
    """Return poles and weights of the chain without its first mass and spring, end of [HBH] 3.4.

    tau_2 = tau_1 + m_1 omega^2 theta_1 and theta_2 = theta_1 - tau_2/K_1 (the paper prints tau_1
    for tau_2 there): the new poles are the zeros of tau_2/tau_1 = 1 + m_1 lambda sum w/(lambda_r -
    lambda), which is m_1 sum w lambda_r/(lambda_r - lambda) as m_1 = 1/sum w. K_1 takes no part in
    poles and weights: it only shifts theta_2/tau_2 by a constant.

    Parameters
    ----------
    poles : ndarray, (k,), rad^2/s^2
        Lambda, the first zero.
    weights : ndarray, (k,)
        w; they are scaled so that their sum is 1/mass.
    mass : float
        First mass.
    """
    weights = weights / (weights.sum() * mass)
    flexible, w = poles[1:], weights[1:]
    bent = w * flexible
    zeros, distances = zeros_between(flexible, bent)
    # Nothing is subtracted from here on, so that small weights stay right to rounding.
    slope = mass * (bent / distances**2).sum(axis=1)
    rigid = weights[0] / (mass * w.sum())
    new = np.concatenate([[rigid], 1 / (mass * zeros * slope)])
    return np.concatenate([[0.0], zeros]), new


def lanczos_chain(
    poles: NDArray[Any], weights: NDArray[Any], first_mass: Any, count: int, total: Any
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return masses (..., N) and springs (..., N - 1) by N - 1 Lanczos steps.

    alpha_j = (K_{j-1} + K_j)/m_j and beta_j = K_j/sqrt(m_j m_{j+1}), so K_1 = alpha_1 m_1,
    m_{j+1} = K_j^2/(m_j beta_j^2), K_{j+1} = alpha_{j+1} m_{j+1} - K_j. The last beta would meet
    the coupled mass: m_N follows from the total. Analytic in its arguments, complex ones included:
    vectors are polynomials in lambda, orthogonal under the weights, which may vanish.

    Parameters
    ----------
    poles : ndarray, (..., k), rad^2/s^2
        Squared resonances lambda, the rigid one included; leading axes are cases.
    weights : ndarray, (..., k)
        Squares of the first components, (13), of any sum.
    first_mass, total : float or complex
        m_1, and the sum of the chain's masses.
    count : int
        Number of masses N.
    """
    shares = weights / weights.sum(axis=-1, keepdims=True)
    vectors = [np.ones_like(poles)]
    masses, springs = [first_mass * np.ones_like(shares[..., 0])], []
    before: Any = 0.0
    for j in range(count - 1):
        v = vectors[-1]
        image = poles * v
        springs.append(_inner(shares, v, image) * masses[-1] - before)
        before = springs[-1]
        if j == count - 2:
            break
        remainder = image
        for other in (*vectors, *vectors):  # twice is enough (Parlett)
            remainder = remainder - _inner(shares, other, remainder)[..., None] * other
        square = _inner(shares, remainder, remainder)
        masses.append(before**2 / (masses[-1] * square))
        vectors.append(remainder / np.sqrt(square)[..., None])
    masses.append(total - sum(masses))
    return np.stack(masses, axis=-1), np.stack(springs, axis=-1)


def _inner(weights: NDArray[Any], a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
    return np.asarray((weights * a * b).sum(axis=-1))


def coupled_inertia(cross_gain: complex, low_i: float, low_j: float) -> float:
    """Return the coupling between two last masses from low-frequency gains, [HBH] (7) and (8).

    Parameters
    ----------
    cross_gain : complex, 1/kg
        Motor acceleration i per motor torque j at low frequency, its sign or phase included, all
        other chains held by position controllers, (9).
    low_i, low_j : float, 1/kg
        A_iL and A_jL, with all other chains held, (4).

    Raises
    ------
    InvalidInput
        If a low-frequency gain is not positive.
    NotIdentifiable
        If the cross gain's phase is nearer to 90 degrees than to 0 or 180.
    """
    if not (low_i > 0 and low_j > 0):
        raise InvalidInput(f"low-frequency gains: {low_i:g} and {low_j:g}; both must be positive")
    size = abs(cross_gain)
    if size == 0:
        return 0.0
    cosine = float(np.real(cross_gain)) / size
    if abs(cosine) < np.sqrt(0.5):
        raise NotIdentifiable(
            ("sign of the cross gain",),
            f"its phase is {np.degrees(np.angle(cross_gain)):.0f} degrees, neither near 0 nor "
            "180; measure at lower frequencies, with more torque, or with less friction",
        )
    # A mass matrix is positive definite, so m^2 < 1/(A_iL A_jL): the root with the plus sign, and
    # the second case of (8). The fraction is written without the cancellation of (7).
    both = 1 / (low_i * low_j)
    inertia = 2 * size * both / (1 + np.sqrt(1 + 4 * size**2 * both))
    return float(-np.sign(cosine) * inertia)


def check_count(count: int, poles: int) -> None:
    """Refuse numbers of masses that so many poles cannot belong to.

    Raises
    ------
    InvalidInput
        If there are less than two masses, or fewer poles than masses.
    """
    if count < 2:
        raise InvalidInput(
            f"n_masses: {count}; a chain needs at least 2 (a single mass has no spring, "
            "and its FRF is 1/mass)"
        )
    if poles < count:
        raise InvalidInput(
            f"n_masses: {count} masses need {count} poles or more, the rigid one included; "
            f"{poles} given"
        )
