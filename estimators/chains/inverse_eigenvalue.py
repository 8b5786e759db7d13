"""Masses and springs of a chain from its poles and zeros: [HBH] sections 3.3 and 3.4.

Everything is seen from one motor. With lambda = omega^2 its compliance theta_1/tau_1 is
sum_r w_r/(lambda_r - lambda), where lambda_r are the squared resonances of all chains together,
one of them zero, and w = u^2/m_1 with u the first components of the eigenvectors. The chain itself
is a Jacobi matrix up to its last mass, whose coupling to the other chains is inside the spectrum.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
        D2.
    u2 : ndarray, (k,), dimensionless
        Second components of the eigenvectors.
    """

    b11: float
    d2: Array
    b12: float
    u2: Array
    b22: float


def first_components(poles: Array, zeros: Array) -> Array:
    """Return the first components of the eigenvectors, (k,), [HBH] (13).

    Parameters
    ----------
    poles : ndarray, (k,), rad^2/s^2
        Squared resonances lambda, the rigid mode's zero included.
    zeros : ndarray, (k - 1,), rad^2/s^2
        Squared anti-resonances lambda_0.

    Raises
    ------
    InvalidInput
        If poles and zeros do not interlace, naming the pair.
    """
    poles, zeros = np.sort(np.asarray(poles, float)), np.sort(np.asarray(zeros, float))
    check_interlacing(poles, zeros)
    gaps = poles[:, None] - poles
    np.fill_diagonal(gaps, 1.0)
    # Products of ratios near one: those of the numbers themselves overflow for long chains.
    ratios = np.ones_like(gaps)
    order = np.arange(len(poles))
    for i in order:
        others = order[order != i]
        ratios[i, others] = (poles[i] - zeros) / gaps[i, others]
    return np.asarray(np.sqrt(np.prod(ratios, axis=1)))


def check_interlacing(poles: Array, zeros: Array) -> None:
    """Refuse spectra that no chain can have: lambda_1 <= lambda0_1 <= lambda_2 <= ...

    Raises
    ------
    InvalidInput
        Naming the first pair out of order.
    """
    if zeros.shape != (len(poles) - 1,):
        raise InvalidInput(
            f"poles and zeros: {len(poles)} poles (the rigid one included) and {len(zeros)} zeros; "
            f"{max(len(poles) - 1, 0)} zeros, one between each two poles, are needed"
        )
    for i, zero in enumerate(zeros):
        for j, wrong in ((i, zero < poles[i]), (i + 1, zero > poles[i + 1])):
            if wrong:
                raise InvalidInput(
                    f"poles and zeros do not interlace: anti-resonance {i + 1} at "
                    f"{_hertz(zero)} Hz lies {'below' if j == i else 'above'} the pole "
                    f"{j + 1} at {_hertz(poles[j])} Hz; one of the two is not of this chain, "
                    "or a mode was missed"
                )


def lanczos_step(poles: Array, first: Array) -> LanczosStep:
    """Return B11, d2, B12, u2 and B22 from lambda (k,) and u1 (k,), [HBH] (14)-(16)."""
    b11 = float(first @ (poles * first))
    d2 = b11 * first - poles * first
    b12 = float(np.sqrt(d2 @ d2))
    u2 = d2 / b12
    return LanczosStep(b11, d2, b12, u2, float(u2 @ (poles * u2)))


def zeros_between(poles: Array, weights: Array) -> Array:
    """Return the k - 1 zeros of sum_r w_r/(lambda_r - lambda), all w positive.

    They are the eigenvalues of diag(lambda) on the complement of sqrt(w): the chain with its
    motor locked.
    """
    root = np.sqrt(weights / weights.sum())
    basis = np.linalg.qr(root[:, None], mode="complete")[0][:, 1:]
    return np.asarray(np.linalg.eigvalsh(basis.T @ (poles[:, None] * basis)))


def peeled(poles: Array, weights: Array, mass: float) -> tuple[Array, Array]:
    """Return poles and weights of the chain without its first mass and spring.

    tau_2 = tau_1 + m_1 omega^2 theta_1 and theta_2 = theta_1 - tau_2/K_1 (the paper prints tau_1
    for tau_2 there): the new poles are the zeros of tau_2/tau_1 = 1 + m_1 lambda sum w/(lambda_r -
    lambda), which is m_1 sum w lambda_r/(lambda_r - lambda) as m_1 = 1/sum w. K_1 takes no part in
    poles and weights: it only shifts theta_2/tau_2 by a constant.

    Parameters
    ----------
    poles : ndarray, (k,)
        Lambda, the first zero.
    weights : ndarray, (k,)
        w; they are scaled so that their sum is 1/mass.
    mass : float
        First mass.
    """
    weights = weights / (weights.sum() * mass)
    flexible, w = poles[1:], weights[1:]
    bent = w * flexible
    remaining = zeros_between(flexible, bent)
    slope = mass * (bent / (flexible - remaining[:, None]) ** 2).sum(axis=1)
    rigid = weights[0] / (1 - mass * weights[0])
    new = np.concatenate([[rigid], 1 / (mass * remaining * slope)])
    return np.concatenate([[0.0], remaining]), new


def stepwise_chain(
    poles: Array,
    zeros: Array,
    first_mass: float,
    count: int,
    total: float,
    *,
    per_step: int = 2,
) -> tuple[Array, Array]:
    """Return masses (N,) and springs (N - 1,) as [HBH] section 3.4 has them, (13)-(22).

    Parameters
    ----------
    poles, zeros : ndarray, (k,) and (k - 1,)
        Squared, the rigid pole included.
    first_mass : float
        m_1, the motor's: 1/A_H by (3), or from its data sheet.
    count : int
        Number of masses N.
    total : float
        Sum of the chain's masses: 1/A_L by (2), the other chains held, or an entry of the rigid
        inertia matrix. Poles and zeros do not say it unless the chain is alone.
    per_step : int
        2 takes a pair of masses off at a time and reads each next first mass from the high
        frequencies of what is left; 1 takes one off, whose successor is known already, and needs no
        high frequencies.

    Raises
    ------
    InvalidInput
        For spectra that do not interlace, or a count that does not fit.
    """
    check_count(count, poles)
    if per_step not in (1, 2):
        raise InvalidInput(f"per_step: {per_step} masses at a time; 1 or 2 are possible")
    masses, springs, mass = [float(first_mass)], [], float(first_mass)
    while len(masses) < count:
        first = first_components(poles, zeros)
        step = lanczos_step(np.sort(poles), first)
        stiffness = step.b11 * mass  # (17)
        springs.append(stiffness)
        if count - len(masses) == 1:
            masses.append(total - sum(masses))  # (22)
            break
        second = mass * step.b11**2 / step.b12**2  # (19)
        masses.append(second)
        poles, weights = peeled(np.sort(poles), first**2, mass)
        if per_step == 2:
            springs.append(step.b22 * second - stiffness)  # (18)
            if count - len(masses) == 1:
                masses.append(total - sum(masses))
                break
            poles, weights = peeled(poles, weights, second)
            second = 1 / float(weights.sum())  # (3) of what is left
            masses.append(second)
        zeros = zeros_between(poles, weights)
        mass = second
    return np.array(masses), np.array(springs)


def lanczos_chain(
    poles: NDArray[Any], first: NDArray[Any], first_mass: Any, count: int, total: Any
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return masses (N,) and springs (N - 1,) by N - 1 Lanczos steps on (lambda, u1).

    alpha_j = (K_{j-1} + K_j)/m_j and beta_j = K_j/sqrt(m_j m_{j+1}), so K_1 = alpha_1 m_1,
    m_{j+1} = K_j^2/(m_j beta_j^2), K_{j+1} = alpha_{j+1} m_{j+1} - K_j. The last beta would meet
    the coupled mass: m_N follows from the total. Analytic in its arguments, complex ones included.
    """
    vectors = [first / np.sqrt(first @ first)]
    masses, springs = [first_mass], []
    before: Any = 0.0
    for j in range(count - 1):
        v = vectors[-1]
        image = poles * v
        springs.append((v @ image) * masses[-1] - before)
        before = springs[-1]
        if j == count - 2:
            break
        rest = image
        for known in (*vectors, *vectors):  # twice is enough (Parlett)
            rest = rest - (known @ rest) * known
        beta = np.sqrt(rest @ rest)
        masses.append(before**2 / (masses[-1] * beta**2))
        vectors.append(rest / beta)
    masses.append(total - sum(masses))
    return np.array(masses), np.array(springs)


def check_count(count: int, poles: Array) -> None:
    """Refuse numbers of masses that these poles cannot belong to.

    Raises
    ------
    InvalidInput
        If there are less than two masses, or fewer poles than masses.
    """
    if count < 2:
        raise InvalidInput(
            f"n_masses: {count}; a chain needs at least 2 (a single mass has no spring, "
            "and its FRF says the mass alone)"
        )
    if len(poles) < count:
        raise InvalidInput(
            f"n_masses: {count} masses need {count} poles or more, the rigid one included; "
            f"{len(poles)} given"
        )


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


def _hertz(square: float) -> str:
    return f"{np.sqrt(max(square, 0.0)) / (2 * np.pi):.4g}"
