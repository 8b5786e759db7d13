"""Signs and units of measured FRFs, judged by the robot's rigid inertia.

At low frequencies springs do not yield and the FRF is that of the rigid robot, which is known far
better than the springs: a factor of 57, a gear ratio or a minus there is a mix-up, not a spring.
"""

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.frf.frf_estimate import FrfEstimate
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import IdentificationWarning, InvalidInput
from robotmodels.linear.response import Elastic
from robotmodels.linear.spring_network import SpringNetwork

# Friction and a payload not modelled change the low end, but rarely by more.
PLAUSIBLE = 2.5
# Within this of a known factor, in ln.
_NEAR = 0.25
_LINES = 3
_MOST_MOTORS = 12
# A sign counts if the couplings that it turns are this large against the diagonal.
_CLEAR = 0.03


@dataclass(frozen=True, eq=False)
class RigidLimit:
    """The low end of measured FRFs against the rigid robot.

    Attributes
    ----------
    ratio : ndarray of complex, (n,)
        Measured over rigid diagonal elements, median over positions and lowest lines; not a number
        for motors that are not judged.
    messages : tuple of str
        One line for each thing that looks wrong.
    """

    ratio: ComplexArray
    messages: tuple[str, ...]


def check_rigid_limit(estimate: FrfEstimate, model: Elastic) -> RigidLimit:
    """Warn of signs and units that the rigid robot contradicts.

    Only the lowest three lines count, and only where the model's own springs do not yet yield: a
    motor whose lowest lines lie near or above an anti-resonance is not judged.

    Parameters
    ----------
    model : Elastic
        Robot, or anything with its ``parameters`` and ``network``.

    Raises
    ------
    InvalidInput
        If the model has other motors than the estimate.
    """
    network = model.network(estimate.positions)
    m, n = estimate.response.shape[2:]
    if m != n or network.selector.shape[1] != n:
        raise InvalidInput(
            f"rigid limit: FRFs of {m} outputs and {n} motors against a model of "
            f"{network.selector.shape[1]} motors; they must be the same"
        )
    lines = slice(0, _LINES)
    rigid = rigid_response(network, estimate.omega[lines])
    elastic = network.frequency_response(estimate.omega[lines])
    near = np.abs(np.log(np.abs(_diagonal(elastic) / _diagonal(rigid)))) < np.log(PLAUSIBLE) / 2
    measured = estimate.response[:, lines]
    ratios = np.where(near, _diagonal(measured) / _diagonal(rigid), np.nan)
    ratio = np.array([_median(ratios[..., i]) for i in range(n)])
    messages = _judge(ratio, network)
    if not messages:
        messages = _judge_couplings(measured, rigid, near)
    for message in messages:
        warnings.warn(message, IdentificationWarning, stacklevel=2)
    return RigidLimit(ratio, tuple(messages))


def rigid_response(network: SpringNetwork, omega: Array) -> ComplexArray:
    """Return the FRFs (Q, F, n, n) of the robot with all springs rigid, with gravity and friction.

    Motions without any spring's elongation are spanned by the null space of the incidence.
    """
    _, values, vectors = np.linalg.svd(network.incidence())
    rank = int((values > 1e-9 * values.max(initial=1.0)).sum())
    T = vectors[rank:].T
    w = omega[:, None, None]
    M, D, K = (
        np.expand_dims(np.broadcast_to(T.T @ a @ T, (len(network.mass), *[T.shape[1]] * 2)), 1)
        for a in (*network.without_springs(), network.stiffness)
    )
    A = K - w**2 * M + 1j * w * D
    S = T.T @ network.selector + 0j
    return np.asarray(
        -(w**2) * (S.T @ np.linalg.solve(A, np.broadcast_to(S, (*A.shape[:2], *S.shape))))
    )


def _judge(ratio: ComplexArray, network: SpringNetwork) -> list[str]:
    """Say which simple mix-up explains the ratios, if any is needed; motors alike in one line."""
    gears = np.abs(network.selector).max(axis=0)
    motors_by_finding: dict[str, list[int]] = {}
    for i, value in enumerate(ratio):
        if not np.isfinite(value):
            continue
        angle = abs(float(np.angle(value, deg=True)))
        if angle > 120:
            text = "the FRF has the wrong sign; turn the torque's or the angle's"
            motors_by_finding.setdefault(text, []).append(i)
        elif angle > 60:
            text = (
                "the phase is more than 60 degrees off the rigid robot's; angle, speed or "
                "acceleration mixed up, a delay, or friction"
            )
            motors_by_finding.setdefault(text, []).append(i)
        if not 1 / PLAUSIBLE < abs(value) < PLAUSIBLE:
            motors_by_finding.setdefault(_units(abs(value), float(gears[i])), []).append(i)
    return [
        f"low frequencies, {_motors(motors)}: {text.format(_sizes(ratio[motors]))}"
        for text, motors in motors_by_finding.items()
    ]


def _units(size: float, gear: float) -> str:
    """Say which factor between units is near `size`, or near 1 / `size`."""
    units = {
        "degrees for radians": 180 / np.pi,
        "revolutions for radians": 2 * np.pi,
        "milli-units": 1e3,
        "arm side for motor side, a gear ratio": max(gear, 1 / gear),
        "arm side for motor side twice, a gear ratio squared": max(gear, 1 / gear) ** 2,
    }
    close = [
        name
        for name, factor in units.items()
        if factor > PLAUSIBLE and abs(abs(np.log(size)) - np.log(factor)) < _NEAR
    ]
    why = f" ({' or '.join(close)}?)" if close else ""
    return f"the FRF is {{}} times the rigid robot's; check the units{why}"


def _judge_couplings(
    measured: ComplexArray, rigid: ComplexArray, near: NDArray[np.bool_]
) -> list[str]:
    """Look for motors whose torque and angle are both turned round: their couplings change sign.

    Among all patterns of signs the one that agrees best with the rigid robot's is taken.
    """
    n = rigid.shape[-1]
    size = np.sqrt(np.abs(_diagonal(rigid)))
    scale = size[..., :, None] * size[..., None, :]
    both = near[..., :, None] & near[..., None, :] & ~np.eye(n, dtype=bool)
    agree = np.where(both, np.real(measured * np.conj(rigid)) / scale**2, 0.0).sum(axis=(0, 1))
    if not 2 <= n <= _MOST_MOTORS:
        return []
    signs = 1 - 2 * ((np.arange(2 ** (n - 1))[:, None] >> np.arange(n)) & 1)
    scores = np.einsum("si,ij,sj->s", signs, agree, signs)
    best = signs[int(np.argmax(scores))]
    # Weak couplings drown in noise and friction; what the best pattern gains must be clear.
    if not scores.max() - agree.sum() > _CLEAR**2 * near[..., 0].size:
        return []
    turned = np.flatnonzero(best < 0)
    if 2 * len(turned) > n:
        turned = np.flatnonzero(best > 0)
    also = " (or all the others)" if 2 * len(turned) == n else ""
    return [
        f"low frequencies, {_motors(turned.tolist())}{also}: couplings to other motors have the "
        "wrong sign; torque and angle may both be turned round, or motors be swapped"
    ]


def _motors(motors: list[int]) -> str:
    plural = "s" if len(motors) > 1 else ""
    return f"motor{plural} {', '.join(str(j + 1) for j in motors)}"


def _sizes(ratio: ComplexArray) -> str:
    low, high = float(np.abs(ratio).min()), float(np.abs(ratio).max())
    return f"{low:.3g}" if high < 1.01 * low else f"{low:.3g} to {high:.3g}"


def _diagonal(matrices: ComplexArray) -> ComplexArray:
    return np.asarray(np.diagonal(matrices, axis1=-2, axis2=-1))


def _median(values: ComplexArray) -> complex:
    finite = values[np.isfinite(values)]
    return (
        complex(np.median(finite.real), np.median(finite.imag)) if finite.size else complex(np.nan)
    )
