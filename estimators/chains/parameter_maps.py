"""Between masses, springs and couplings of chains and what their FRFs show: both ways."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.chains.inverse_eigenvalue import lanczos_chain
from estimators.chains.modal_model import ModalLayout
from robotmodels.common.arrays import Array, IntArray

_STEP = 1e-30  # of complex steps, which have no cancellation


@dataclass(frozen=True)
class ChainLayout:
    """Where masses, springs and couplings are in a vector theta, and what they are called.

    theta = (masses (M, N), springs (M, N - 1), couplings of chains i < j), flat, in SI units; names
    are those of `CoupledChains`.

    Attributes
    ----------
    chains, masses : int
        M and N.
    """

    chains: int
    masses: int

    @property
    def modes(self) -> int:
        """Number M (N - 1) of flexible modes."""
        return self.chains * (self.masses - 1)

    @property
    def modal(self) -> ModalLayout:
        """The modal vector's structure: as many entries as theta has, and more if N > 2."""
        return ModalLayout(self.chains, self.modes, losses=False)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of theta's entries."""
        count, length = self.chains, self.masses
        last = [length * (i + 1) for i in range(count)]
        return (
            *(f"m{i + 1}" for i in range(count * length)),
            *(f"K{i + 1}" for i in range(self.modes)),
            *(f"m{last[i]}_{last[j]}" for i, j in zip(*np.triu_indices(count, 1), strict=True)),
        )

    @property
    def positive(self) -> int:
        """Number of entries that must be positive: all but the couplings."""
        return self.chains * self.masses + self.modes

    @property
    def first(self) -> IntArray:
        """Places of the motors' masses."""
        return np.arange(self.chains) * self.masses

    def split(self, theta: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Return masses (M, N), springs (M, N - 1) and couplings (M, M)."""
        m, n = self.chains, self.masses
        masses, springs = theta[: m * n], theta[m * n : self.positive]
        couplings = np.zeros((m, m), dtype=theta.dtype)
        couplings[np.triu_indices(m, 1)] = theta[self.positive :]
        return masses.reshape(m, n), springs.reshape(m, n - 1), couplings + couplings.T

    def join(
        self, masses: NDArray[Any], springs: NDArray[Any], couplings: NDArray[Any]
    ) -> NDArray[Any]:
        """Return theta."""
        pairs = couplings[np.triu_indices(self.chains, 1)]
        return np.concatenate([np.ravel(masses), np.ravel(springs), pairs])


def inverse_map(
    x: NDArray[Any], layout: ChainLayout, first_masses: Array | None = None
) -> NDArray[Any]:
    """Return theta from the structure of a modal vector: inverse eigenvalue problem, all chains.

    Analytic in x, complex x included. Couplings and sums of masses are the low-frequency limit of
    (-omega^2 G)^-1, so no chain need be held.

    Parameters
    ----------
    x : ndarray
        J, ln omega and phi, see `ModalLayout`.
    first_masses : ndarray, (M,), optional
        Motors' inertias where they are known; from the high frequencies, (3), where None.
    """
    J, omega, phi, *_ = layout.modal.split(x)
    rigid = np.diag(np.linalg.inv(J))
    poles = np.concatenate([np.zeros(1), omega**2])
    masses, springs = [], []
    for i in range(layout.chains):
        weights = np.concatenate([rigid[i : i + 1], phi[:, i] ** 2])
        mass = 1 / weights.sum() if first_masses is None else first_masses[i]
        m, k = lanczos_chain(poles, weights, mass, layout.masses, J[i, i])
        masses.append(m)
        springs.append(k)
    return layout.join(np.array(masses), np.array(springs), J)


def inverse_slope(x: Array, layout: ChainLayout, first_masses: Array | None = None) -> Array:
    """Return d theta / dx, (k, p), by complex steps."""
    columns = []
    for i in range(len(x)):
        moved = x.astype(complex)
        moved[i] += 1j * _STEP
        columns.append(inverse_map(moved, layout, first_masses).imag / _STEP)
    return np.stack(columns, axis=1)


def forward_map(theta: Array, layout: ChainLayout, reference: Array) -> tuple[Array, Array]:
    """Return the modal vector x (p,) of chains, and dx/d(scaled theta), (p, k).

    Masses and springs are scaled logarithmically; couplings are not.

    Parameters
    ----------
    theta : ndarray
        See `ChainLayout`.
    reference : ndarray, (n, M)
        Mode shapes whose signs are to be kept.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the mass matrix is not positive definite.
    """
    masses, springs, couplings = layout.split(theta)
    m, n = masses.shape
    last = np.arange(1, m + 1) * n - 1
    mass = np.diag(masses.ravel())
    mass[np.ix_(last, last)] += couplings
    ends = _incidence(m, n)
    root = np.linalg.inv(np.linalg.cholesky(mass))
    squares, vectors = np.linalg.eigh(root @ (ends.T * springs.ravel()) @ ends @ root.T)
    shapes = root.T @ vectors
    squares[:m] = 0.0
    motors = shapes[layout.first]
    flexible = slice(m, None)
    signs = np.sign(np.sum(motors[:, flexible].T * reference, axis=1))
    shapes[:, flexible] *= np.where(signs == 0, 1.0, signs)
    inertia = np.diag(masses.sum(axis=1)) + couplings
    x = layout.modal.join(inertia, np.sqrt(squares[flexible]), shapes[layout.first][:, flexible].T)
    return x, _forward_slope(theta, layout, squares, shapes, ends)


def _forward_slope(
    theta: Array, layout: ChainLayout, squares: Array, shapes: Array, ends: Array
) -> Array:
    """Return dx/d(scaled theta) by first-order perturbation of the modes."""
    m, n = layout.chains, layout.masses
    last = np.arange(1, m + 1) * n - 1
    pairs = list(zip(*np.triu_indices(m, 1), strict=True))
    gaps = squares[:, None] - squares
    gaps[gaps == 0] = np.inf
    upper = np.zeros((m, m), dtype=np.int64)
    upper[np.triu_indices(m)] = np.arange(m * (m + 1) // 2)
    slope = np.zeros((layout.modal.size, len(theta)))
    stretched = ends @ shapes
    for k, value in enumerate(theta):
        stiff = np.zeros_like(gaps)
        heavy = np.zeros_like(gaps)
        if k < m * n:
            heavy = value * np.outer(shapes[k], shapes[k])
            slope[upper[k // n, k // n], k] = value
        elif k < layout.positive:
            row = stretched[k - m * n]
            stiff = value * np.outer(row, row)
        else:
            i, j = pairs[k - layout.positive]
            heavy = np.outer(shapes[last[i]], shapes[last[j]])
            heavy = heavy + heavy.T
            slope[upper[i, j], k] = 1.0
        # Columns r: change of mode r in terms of all modes s.
        mixing = (stiff - heavy * squares) / gaps.T
        mixing -= np.diag(np.diag(heavy)) / 2
        change = (stiff - heavy * squares).diagonal()[m:] / (2 * squares[m:])
        start = layout.modal.sizes[0]
        slope[start : start + layout.modes, k] = change
        slope[start + layout.modes :, k] = (shapes[layout.first] @ mixing)[:, m:].T.ravel()
    return slope


def _incidence(count: int, length: int) -> Array:
    """Return the springs' elongations, (M (N - 1), M N)."""
    one = np.zeros((length - 1, length))
    one[np.arange(length - 1), np.arange(length - 1)] = 1.0
    one[np.arange(length - 1), np.arange(1, length)] = -1.0
    return np.asarray(np.kron(np.eye(count), one), dtype=float)
