"""The spectra that every position may have, in which motors share lines as they like."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from oed.design.column_generation import Columns
from oed.design.spectral_oracle import SpectralOracle
from oed.information_sets.candidates import sensitivities
from oed.information_sets.excitations import Orthogonal, UserSpectrum
from oed.information_sets.experiment_candidates import experiment_candidates
from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.linear.noise import OutputErrors
from robotmodels.linear.response import Elastic, linearization, sensitivity_about
from robotmodels.linear.spring_network import SpringNetwork

_PART = 8  # positions whose sensitivities are in memory at once


class White(Protocol):
    """Sensitivities A_a = L^-1 dG/d ln theta_a per torque of a position, L L^H the noise."""

    def prices(self, weight: Array) -> ComplexArray:
        """Return P with tr(W H(X)) = sum_k tr(P_k X_k), (F, n, n)."""

    def information(self, spectrum: ComplexArray) -> Array:
        """Return H(X), 2 sum_k Re tr(A_a^H A_b X_k), (p, p)."""


@dataclass(frozen=True, eq=False)
class RankOne:
    """A_a = sum_t w_ta y_t v_t^T, as springs and dampers have, see `rank_one_sensitivity`.

    Attributes
    ----------
    products : ndarray of complex, (F, t, t)
        y_s^H y_t, white.
    inputs : ndarray of complex, (F, n, t)
        v, per torque.
    weights : ndarray of complex, (F, t, p)
        w.
    """

    products: ComplexArray
    inputs: ComplexArray
    weights: ComplexArray

    def prices(self, weight: Array) -> ComplexArray:
        """Return 2 V* [(w* W w^T) o R] V^T, see `White`."""
        inner = self.weights.conj() @ weight @ np.swapaxes(self.weights, 1, 2)
        return 2 * self.inputs.conj() @ (inner * self.products) @ np.swapaxes(self.inputs, 1, 2)

    def information(self, spectrum: ComplexArray) -> Array:
        """Return 2 sum_k Re w^H (R o B^T) w with B = V^T X V*, see `White`."""
        inner = np.swapaxes(self.inputs, 1, 2) @ spectrum @ self.inputs.conj()
        moved = (self.products * np.swapaxes(inner, 1, 2)) @ self.weights
        total = np.tensordot(self.weights.conj(), moved, axes=([0, 1], [0, 1]))
        return np.asarray(total.real + total.real.T)


@dataclass(frozen=True, eq=False)
class Whole:
    """Any sensitivities, A (F, m, n, p)."""

    sensitivity: ComplexArray

    def prices(self, weight: Array) -> ComplexArray:
        """Return 2 sum_ab W_ab A_a^H A_b, see `White`."""
        sizes, vectors = np.linalg.eigh(weight)
        B = self.sensitivity @ (vectors * np.sqrt(np.maximum(sizes, 0.0)))
        B = np.moveaxis(B, 2, 1).reshape(len(B), B.shape[2], -1)
        return np.asarray(2 * B.conj() @ np.swapaxes(B, 1, 2))

    def information(self, spectrum: ComplexArray) -> Array:
        """Return the information, see `White`."""
        sizes, vectors = np.linalg.eigh(spectrum)
        roots = vectors * np.sqrt(np.maximum(sizes, 0.0))[:, None, :]
        moved = np.einsum("fmip,fir->fmrp", self.sensitivity, roots, optimize=True)
        flat = moved.reshape(-1, moved.shape[-1])
        return np.asarray(2 * (flat.conj().T @ flat).real)


class FreeSpectra:
    """Spectral matrices of one run in each position, a `SpectrumSets`.

    They are in units of the motors' torques; `torque` makes them N^2 m^2.

    Parameters
    ----------
    robots : tuple of Elastic
        One for each sample of theta.
    positions : ndarray, (Q, n), rad
        Positions.
    omega : ndarray, (F,), rad/s
        Lines.
    errors : OutputErrors
        Noise of a period.
    torque : ndarray, (n,), N m
        Root mean square torques.
    speed, swing : ndarray, (n,), rad/s, rad
        Root mean square speeds and swings of the motors; infinite where there is no limit.
    oracle : SpectralOracle
        Searches a position's spectra.
    """

    def __init__(
        self,
        robots: tuple[Elastic, ...],
        positions: Array,
        omega: Array,
        errors: OutputErrors,
        torque: Array,
        speed: Array,
        swing: Array,
        oracle: SpectralOracle,
    ) -> None:
        self.robots, self.positions, self.omega = robots, positions, omega
        self.errors, self.torque, self.oracle = errors, torque, oracle
        self._largest = np.stack([speed, swing])
        self._bounds: Array = np.full(len(positions), np.inf)
        self._weight: Array | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the p parameters."""
        return self.robots[0].parameters.names

    def flat(self) -> Columns:
        """Return the flat spectrum of every position, weaker where it would move too fast."""
        q, f, n = len(self.positions), len(self.omega), len(self.torque)
        level = np.broadcast_to(np.eye(n) / f, (q, f, n, n))
        if np.isinf(self._largest).all():
            return Columns(np.arange(q), level, self._flat)
        motions = [np.sum(np.abs(s) ** 2, axis=(1, 2)).max() for _, _, s in self._parts(range(q))]
        share = 1 / np.maximum(1.0, np.array(motions) / f)
        shares = share.reshape(-1, *(1,) * (self._flat.ndim - 1))
        return Columns(np.arange(q), share[:, None, None, None] * level, shares * self._flat)

    @cached_property
    def _flat(self) -> Array:
        """Information of flat spectra at all torques, (Q, p, p) or (Q, K, p, p)."""
        n = len(self.torque)
        flat = UserSpectrum(Orthogonal().spectrum(self.torque, len(self.omega)) / n, n)
        sets = [
            experiment_candidates(
                robot, self.positions, [flat], self.omega, self.errors, periods=1
            ).information.take(np.arange(len(self.positions)))
            for robot in self.robots
        ]
        return sets[0] if len(sets) == 1 else np.stack(sets, axis=1)

    def best_columns(self, weight: Array, level: float) -> tuple[float, Columns]:
        """Return a bound on tr(W H) of any spectrum, and the best ones, see `SpectrumSets`.

        What a position earned at another W bounds what it earns now: with W <= a W', a times it.
        And no line has more than cap times the power of all motors.
        """
        W, most = weight.reshape(-1, *weight.shape[-2:]), 2 * len(self.names)
        capped = self.oracle.cap * len(self.omega) * sensitivities(weight, self._flat)
        bounds = np.minimum(self._bounds * _growth(self._weight, W), capped)
        best: list[_Column] = []
        # The most promising first. Where enough are found and others do not better them, the rest
        # wait for another round: their bounds hold unsearched.
        order, idle = np.argsort(-bounds, kind="stable"), 0
        for q, white, motions in self._parts(order[bounds[order] > level]):
            full = len(best) == most
            if full and idle > 2 * most:
                break
            bounds[q], column = self._search(
                q, white, motions, W, best[-1].bound if full else level
            )
            idle = 0 if column else idle + 1
            best = sorted([*best, *column], key=lambda one: -one.bound)[:most]
        self._bounds, self._weight = bounds, W
        columns = self._columns(
            np.array([one.owner for one in best], dtype=np.int64),
            [one.spectrum for one in best],
            [one.matrices for one in best],
        )
        return float(bounds.max()), columns

    def _search(
        self, q: int, white: list[White], motions: ComplexArray, weight: Array, threshold: float
    ) -> tuple[float, "list[_Column]"]:
        """Return a position's bound, and its best spectrum if that is above the threshold."""
        prices = np.sum([A.prices(W) for A, W in zip(white, weight, strict=True)], axis=0)
        bound = float(self.oracle.quick_bounds(prices[None])[0])
        if bound <= threshold:
            return bound, []
        bound, X = self.oracle.solve(prices, motions)
        if bound <= threshold:
            return bound, []
        return bound, [_Column(bound, q, X, np.stack([A.information(X) for A in white]))]

    def slowed(self, owners: IntArray, runs: ComplexArray) -> ComplexArray:
        """Return single runs (k, F, n), weaker where they would move too fast."""
        fastest = [
            np.sum(np.abs(np.einsum("rfi,fi->rf", s, u)) ** 2, axis=1).max(initial=1.0)
            for u, (_, _, s) in zip(runs, self._parts(owners), strict=True)
        ]
        return np.asarray(runs / np.sqrt(fastest)[:, None, None])

    def informations(self, owners: IntArray, spectra: ComplexArray) -> Array:
        """Return the information of spectra (k, F, n, n), (k, p, p) or (k, K, p, p)."""
        pairs = zip(spectra, self._parts(owners), strict=True)
        parts = [np.stack([A.information(X) for A in white]) for X, (_, white, _) in pairs]
        return self._columns(owners, list(spectra), parts).matrices

    def _columns(
        self, owners: IntArray, spectra: list[ComplexArray], matrices: list[Array]
    ) -> Columns:
        f, n, p = len(self.omega), len(self.torque), len(self.names)
        stack = np.array(matrices).reshape(len(owners), len(self.robots), p, p)
        return Columns(
            owners,
            np.array(spectra, dtype=complex).reshape(len(owners), f, n, n),
            stack[:, 0] if len(self.robots) == 1 else stack,
        )

    def _parts(
        self, indices: Sequence[int] | IntArray
    ) -> Iterator[tuple[int, list[White], ComplexArray]]:
        """Yield positions, their sensitivities for each sample, and motions (R, F, n)."""
        for start in range(0, len(indices), _PART):
            part = np.asarray(indices[start : start + _PART])
            samples = [self._white(robot, self.positions[part]) for robot in self.robots]
            for i, q in enumerate(part):
                white, motions = zip(*(sample[i] for sample in samples), strict=True)
                yield int(q), list(white), np.concatenate(motions)

    def _white(self, robot: Elastic, positions: Array) -> list[tuple[White, ComplexArray]]:
        """Return the sensitivities of positions, and their motions."""
        network, tangents = linearization(robot, positions, equilibrium_shift=False)
        rank_one = tangents is None and network.only_springs and network.torque_springs is None
        if rank_one:
            # Imported when used: other designs do not need it.
            import robotmodels.kernel as kernel

            G, left, right, weights = kernel.rank_one_sensitivity(network, self.omega)
            weighted = np.linalg.solve(self.errors.output_error(network, G, self.omega), left)
            products = np.conj(np.swapaxes(left, -1, -2)) @ weighted
            inputs = self.torque[:, None] * right
            white: list[White] = list(map(RankOne, products, inputs, weights))
        else:
            G, J = sensitivity_about(network, tangents, self.omega)
            L = np.linalg.cholesky(self.errors.output_error(network, G, self.omega))
            A = np.linalg.solve(L, J.reshape(*J.shape[:3], -1)).reshape(J.shape)
            white = list(map(Whole, A * self.torque[:, None]))
        return list(zip(white, self._motions(network), strict=True))

    def _motions(self, network: SpringNetwork) -> ComplexArray:
        """Return the limited speeds and swings in units of their limits, (Q, R, F, n)."""
        order, motor = np.nonzero(np.isfinite(self._largest))
        if not len(motor):
            q, f, n = len(network.mass), len(self.omega), len(self.torque)
            return np.zeros((q, 0, f, n), dtype=complex)
        motors = replace(network, measurement=None, torque_springs=None)
        G = motors.frequency_response(self.omega)[:, :, motor]
        units = (1j * self.omega[:, None]) ** (order + 1) * self._largest[order, motor]
        return np.asarray(np.swapaxes(G * self.torque / units[..., None], 1, 2))


def _growth(old: Array | None, new: Array) -> float:
    """Return the least a with new <= a old, of weights (K, p, p); infinite if there is none."""
    if old is None:
        return 1.0
    try:
        inverse = [np.linalg.inv(np.linalg.cholesky(W)) for W in old]
    except np.linalg.LinAlgError:
        return np.inf
    pairs = zip(inverse, new, strict=True)
    return max(float(np.linalg.eigvalsh(T @ W @ T.T)[-1]) for T, W in pairs) * (1 + 1e-9)


class _Column(NamedTuple):
    """A position's best spectrum, with its bound and its information for each sample."""

    bound: float
    owner: int
    spectrum: ComplexArray
    matrices: Array
