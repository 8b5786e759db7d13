"""Transients of runs whose lines are dense: polynomials of the frequency, block by block.

[PS] section 7.3. In blocks of adjacent lines the transient of each output is a polynomial, whose
coefficients in each run are eliminated. The transient has the poles of the model, so that blocks
must be narrow against the distance to the nearest one: at a resonance, half its half-power width.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimators.input_output.free_response import state_rates
from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.linear.linear_model import LinearModel

_LINES, _DEGREE = 10, 2
_CLOSE = 2.0
"""Least distance of a pole, over half the span of a block: a quadratic misses 1 % of it then."""
_RANK = 1e-9


@dataclass(frozen=True, eq=False)
class PolynomialPart:
    """The span of whitened polynomials.

    Attributes
    ----------
    lines : ndarray of int, (K, B)
        Lines of each block; -1 where a block has fewer.
    basis : ndarray of complex, (Q, K, B, m, s)
        Orthonormal columns over the lines and outputs of a block, zero beyond the rank.
    """

    lines: IntArray
    basis: ComplexArray

    def degrees_of_freedom(self, runs: int) -> Array:
        """Return the real degrees of freedom that the transients of runs take, (Q,)."""
        return np.asarray(2 * runs * np.round((np.abs(self.basis) ** 2).sum(axis=(1, 2, 3, 4))))

    def taken_off(self, columns: ComplexArray) -> ComplexArray:
        """Return columns (Q, F, m, ...) less what polynomials can imitate of them."""
        flat = columns.reshape(*columns.shape[:3], -1)
        blocks = flat[:, self.lines]  # of -1 any line: its basis is zero
        along = np.einsum("qkbms,qkbmr->qksr", np.conj(self.basis), blocks, optimize=True)
        parts = np.einsum("qkbms,qksr->qkbmr", self.basis, along, optimize=True)
        inside = self.lines >= 0
        less = flat.copy()
        less[:, self.lines[inside]] -= parts[:, inside]
        return np.asarray(less.reshape(columns.shape))


@dataclass(frozen=True, eq=False)
class LocalPolynomials:
    """Blocks of adjacent lines, in which transients are polynomials.

    Attributes
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    outputs : int
        Number m of outputs.
    """

    omega: Array
    outputs: int

    @cached_property
    def lines(self) -> IntArray:
        """Lines of each block, (K, B); -1 where a block has fewer."""
        blocks = np.array_split(np.arange(len(self.omega)), max(1, len(self.omega) // _LINES))
        return np.array(
            [np.pad(b, (0, len(blocks[0]) - len(b)), constant_values=-1) for b in blocks]
        )

    @cached_property
    def columns(self) -> ComplexArray:
        """Powers of the frequency in a line's block, for each output, (1, F, m, m s)."""
        block = np.repeat(np.arange(len(self.lines)), (self.lines >= 0).sum(axis=1))
        low, high = (self.omega[ends] for ends in (self._first, self._last))
        step = (2 * self.omega - (low + high)[block]) / np.where(high > low, high - low, 1.0)[block]
        powers = step[:, None] ** np.arange(_DEGREE + 1)
        columns = np.einsum("fs,ij->fijs", powers, np.eye(self.outputs)) + 0j
        return np.asarray(columns.reshape(1, len(step), self.outputs, -1))

    def part(self, columns: ComplexArray, errors: ComplexArray) -> PolynomialPart:
        """Return the span of whitened `columns` (Q, F, m, s), whatever the errors."""
        inside = self.lines >= 0
        blocks = np.where(inside[..., None, None], columns[:, self.lines], 0.0)
        q, k, b, m, s = blocks.shape
        basis, values, _ = np.linalg.svd(blocks.reshape(q, k, b * m, s), full_matrices=False)
        basis = basis * (values > _RANK * values[..., :1])[..., None, :]
        return PolynomialPart(self.lines, basis.reshape(q, k, b, m, -1))

    def check(self, model: LinearModel) -> None:
        """Refuse blocks that are wide against the distance to a resonance within the band.

        Raises
        ------
        InvalidInput
            Naming the resonance, its width and the blocks'.
        """
        low, high = self.omega[self._first], self.omega[self._last]
        poles = np.linalg.eigvals(state_rates(model)).reshape(-1)
        poles = poles[(poles.imag >= self.omega[0]) & (poles.imag <= self.omega[-1])]
        if not len(poles):
            return
        distance = np.abs(1j * (low + high)[:, None] / 2 - poles)
        ratio = distance / np.maximum((high - low)[:, None] / 2, 1e-300)
        k, i = np.unravel_index(np.argmin(ratio), ratio.shape)
        if ratio[k, i] < _CLOSE:
            hertz = np.abs([poles[i].imag, 2 * poles[i].real, high[k] - low[k]]) / (2 * np.pi)
            raise InvalidInput(
                f"states: 'polynomial' needs lines that are dense against resonances: the one at "
                f"{hertz[0]:.4g} Hz is {hertz[1]:.3g} Hz wide, {(self.lines[k] >= 0).sum()} lines "
                f"beside it are {hertz[2]:.3g} Hz wide; take states='yes', measure runs "
                f"{np.ceil(_CLOSE / ratio[k, i]):.0f} times as long, or periodic ones"
            )

    @property
    def _first(self) -> IntArray:
        return np.asarray(self.lines[:, 0])

    @property
    def _last(self) -> IntArray:
        return np.asarray(self.lines.max(axis=1))
