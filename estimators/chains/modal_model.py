"""FRFs of chains as sums over modes that all elements share, and their derivatives.

G(s) = e^{-s delay} [(J + C/s)^-1 + sum_r (phi phi^T + (s/omega_r)(phi chi^T + chi phi^T)) h_r(s)],
h_r = s^2/(s^2 + 2 zeta_r omega_r s + omega_r^2): motor torque to motor acceleration. J is the rigid
inertia matrix and C the viscous friction of the motors. phi_r are the motors' components of the
mode shape of unit modal mass, so every element has the poles in common and its zeros follow. chi_r
is what unequal dampers turn the shapes by, to first order in damping (Gawronski 2004, section 2).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.chains.pole_zero_spectra import zeros_between
from robotmodels.common.arrays import Array, ComplexArray


@dataclass(frozen=True)
class ModalLayout:
    """Where the parts of a modal model are in its vector x.

    x = (J's upper triangle by rows, ln omega, phi by modes | zeta, friction, delay, chi): structure
    first, losses after the bar, those that are left out absent.

    Attributes
    ----------
    chains : int
        M motors.
    modes : int
        n flexible modes.
    losses : bool
        Whether damping ratios, friction and delay are in it.
    turned : bool
        Whether chi is.
    """

    chains: int
    modes: int
    losses: bool = True
    turned: bool = False

    @property
    def sizes(self) -> tuple[int, ...]:
        """Lengths of the parts: J, ln omega, phi, zeta, friction, delay, chi."""
        m, n = self.chains, self.modes
        lossy = (n, m, 1) if self.losses else (0, 0, 0)
        return (m * (m + 1) // 2, n, n * m, *lossy, n * m if self.turned else 0)

    @property
    def structure(self) -> int:
        """Number of entries before the losses."""
        return sum(self.sizes[:3])

    @property
    def size(self) -> int:
        """Length of x."""
        return sum(self.sizes)

    @property
    def names(self) -> tuple[str, ...]:
        """What the entries of x are, for messages."""
        m, n = self.chains, self.modes
        modes = [f"mode {r + 1}" for r in range(n)]
        motors = [f"motor {i + 1}" for i in range(m)]
        shapes = [f"{mode} at {motor}" for mode in modes for motor in motors]
        named = [f"inertia {i + 1}, {j + 1}" for i, j in zip(*np.triu_indices(m), strict=True)]
        named += [f"frequency of {mode}" for mode in modes] + shapes
        if self.losses:
            named += [f"damping of {mode}" for mode in modes]
            named += [f"friction of {motor}" for motor in motors] + ["delay"]
        return (*named, *(f"turn of {shape}" for shape in (shapes if self.turned else [])))

    def split(self, x: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """Return J (M, M), omega (n,), phi (n, M), zeta (n,), friction (M,), delay, chi (n, M)."""
        m, n = self.chains, self.modes
        parts = np.split(x, np.cumsum(self.sizes)[:-1])
        J = np.zeros((m, m), dtype=x.dtype)
        J[np.triu_indices(m)] = parts[0]
        J = J + J.T - np.diag(np.diag(J))
        zeta, friction, delay = parts[3:6] if self.losses else (np.zeros(n), np.zeros(m), [0.0])
        chi = parts[6].reshape(n, m) if self.turned else np.zeros((n, m))
        return J, np.exp(parts[1]), parts[2].reshape(n, m), zeta, friction, np.ravel(delay), chi

    def join(
        self,
        inertia: Array,
        omega: Array,
        shapes: Array,
        damping: Array | None = None,
        friction: Array | None = None,
        delay: float = 0.0,
        chi: Array | None = None,
    ) -> Array:
        """Return x; losses that are not given are zero."""
        m, n = self.chains, self.modes
        parts = [inertia[np.triu_indices(m)], np.log(omega), shapes.ravel()]
        if self.losses:
            parts += [
                np.zeros(n) if damping is None else damping,
                np.zeros(m) if friction is None else friction,
                np.array([delay]),
            ]
        if self.turned:
            parts.append(np.zeros(n * m) if chi is None else chi.ravel())
        return np.concatenate(parts)


def modal_response(x: Array, layout: ModalLayout, omega: Array) -> ComplexArray:
    """Return G, (F, M, M), at `omega` (F,)."""
    return _evaluate(x, layout, omega)[0]


def modal_sensitivity(
    x: Array, layout: ModalLayout, omega: Array
) -> tuple[ComplexArray, ComplexArray]:
    """Return G, (F, M, M), and dG/dx, (F, M, M, p)."""
    G, (P, s, late, h, slope_omega, slope_zeta) = _evaluate(x, layout, omega)
    m, n = layout.chains, layout.modes
    _, w, phi, _, _, _, chi = layout.split(x)
    columns: list[ComplexArray] = []
    for row, column in zip(*np.triu_indices(m), strict=True):
        change = P[:, :, row, None] * P[:, None, column, :]
        columns.append(-(change + np.swapaxes(change, 1, 2) if row != column else change))
    ratio = s[:, None] / w
    straight = phi[:, :, None] * phi[:, None, :]
    bent = phi[:, :, None] * chi[:, None, :] + chi[:, :, None] * phi[:, None, :]
    modes, motors = list(range(n)), list(range(m))
    for r in modes:
        # ln omega acts through h and through s/omega.
        first = slope_omega[:, r, None, None] * (straight[r] + ratio[:, r, None, None] * bent[r])
        columns.append(first - (ratio * h)[:, r, None, None] * bent[r])
    unit = np.eye(m)
    for r in modes:
        for i in motors:
            by_phi = np.outer(unit[i], phi[r]) + np.outer(phi[r], unit[i])
            by_chi = np.outer(unit[i], chi[r]) + np.outer(chi[r], unit[i])
            columns.append(h[:, r, None, None] * (by_phi + ratio[:, r, None, None] * by_chi))
    if layout.losses:
        for r in modes:
            value = straight[r] + ratio[:, r, None, None] * bent[r]
            columns.append(slope_zeta[:, r, None, None] * value)
        for i in motors:
            columns.append(-(P[:, :, i, None] * P[:, None, i, :]) / s[:, None, None])
        columns.append(-s[:, None, None] * G / late[:, None, None])
    if layout.turned:
        for r in modes:
            for i in motors:
                both = np.outer(unit[i], phi[r]) + np.outer(phi[r], unit[i])
                columns.append((h * ratio)[:, r, None, None] * both)
    return G, np.stack(columns, axis=-1) * late[:, None, None, None]


def _evaluate(
    x: Array, layout: ModalLayout, omega: Array
) -> tuple[ComplexArray, tuple[NDArray[Any], ...]]:
    J, w, phi, zeta, friction, delay, chi = layout.split(x)
    s = 1j * np.asarray(omega, dtype=float)
    P = np.linalg.inv(J + np.diag(friction) / s[:, None, None])
    square = s[:, None] ** 2
    denominator = square + 2 * zeta * w * s[:, None] + w**2
    h: ComplexArray = np.asarray(square / denominator)
    slope_omega = -h * (2 * zeta * w * s[:, None] + 2 * w**2) / denominator
    slope_zeta = -h * 2 * w * s[:, None] / denominator
    late = np.exp(-s * delay[0])
    elements = np.einsum("fr,ri,rj->fij", h, phi, phi)
    if layout.turned:
        turned = np.einsum("fr,ri,rj->fij", h * s[:, None] / w, phi, chi)
        elements = elements + turned + np.swapaxes(turned, 1, 2)
    G = late[:, None, None] * (P + elements)
    return np.asarray(G), (P, s, late, h, slope_omega, slope_zeta)


def modal_anti_resonances(x: Array, layout: ModalLayout) -> Array:
    """Return each chain's undamped anti-resonances, (M, n), in rising order [rad/s]."""
    return np.sqrt([zeros for zeros, _, _ in chain_spectra(x, layout)])


def anti_resonance_slopes(x: Array, layout: ModalLayout) -> Array:
    """Return their derivatives by the structure of x, (M, n, p) [rad/s per unit].

    Along sum_r w_r/(lambda_r - zero) = 0 a zero moves with the poles, each by its share of
    w/(lambda - zero)^2, and with the weights.
    """
    J, omega, phi, *_ = layout.split(x)
    inverse = np.linalg.inv(J)
    inertias, n = layout.sizes[0], layout.modes
    rows, columns = np.triu_indices(layout.chains)
    slopes = np.zeros((layout.chains, n, layout.structure))
    for i, (zeros, distances, weights) in enumerate(chain_spectra(x, layout)):
        pull, by_weight = _zero_slopes(distances, weights)
        # w_0 is an element of the inverse inertia matrix, w_r = phi^2, lambda = omega^2.
        change = -inverse[i, rows] * inverse[columns, i] * np.where(rows == columns, 1.0, 2.0)
        slopes[i, :, :inertias] = by_weight[:, :1] * change
        slopes[i, :, inertias : inertias + n] = pull[:, 1:] * 2 * omega**2
        at = inertias + n + np.arange(n) * layout.chains + i
        slopes[i][:, at] = by_weight[:, 1:] * 2 * phi[:, i]
        slopes[i] /= 2 * np.sqrt(zeros)[:, None]
    return slopes


def _zero_slopes(distances: Array, weights: Array) -> tuple[Array, Array]:
    """Return derivatives of zeros by poles and by weights, both (n, n + 1)."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        pull = weights / distances**2
        pull = pull / pull.sum(axis=1, keepdims=True)
        by_weight = -pull * distances / weights
    # A zero that a mode without weight cancels moves with its pole.
    cancelled = distances == 0
    alone = cancelled.any(axis=1)
    pull[alone] = cancelled[alone] / cancelled[alone].sum(axis=1, keepdims=True)
    by_weight[alone] = 0.0
    return pull, np.nan_to_num(by_weight)


def chain_spectra(x: Array, layout: ModalLayout) -> list[tuple[Array, Array, Array]]:
    """Return each chain's squared zeros (n,), the poles' distances above them and weights.

    Distances are (n, n + 1), weights (n + 1,), the rigid pole first.
    """
    J, omega, phi, *_ = layout.split(x)
    rigid = np.diag(np.linalg.inv(J))
    poles = np.concatenate([[0.0], omega**2])
    spectra = []
    for i in range(layout.chains):
        weights = np.concatenate([rigid[i : i + 1], phi[:, i] ** 2])
        spectra.append((*zeros_between(poles, weights), weights))
    return spectra
