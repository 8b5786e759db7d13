"""The memory a thread computes in: network, structure and buffers, by address."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from robotmodels.common.arrays import Array, IntArray
from robotmodels.kernel.elimination_order import BLOCK, EliminationPlan
from robotmodels.kernel.memory import address, aligned
from robotmodels.linear.spring_network import SpringNetwork, shared


class Work(NamedTuple):
    """Sizes, and addresses of tables and buffers.

    Sizes: coordinates d, terms s, rows of the factorisation, rows of padding, first row needed,
    motors n, vectors in a row of right-hand sides, inner springs, needed springs m, parameters p,
    doubles from one position's damping and exponents to the next (0 if all share them).

    Tables, as in `SpringNetwork` and `EliminationPlan`: mass .. spring_damping, order .. needed.

    Buffers of doubles:
        packed : (3, triangle) mass, damping, stiffness of one position, by row.
        bounds : (3, size) largest off-diagonal entry of each row of the three.
        arms : (n, 3) mass, damping and stiffness of each eliminated motor.
        block : (2 m, 2 m) information on ln k and ln c.
        listed : (2 m p, 3) the exponents that are not zero, see `sensitivity_products`.
    Buffers of vectors (complex ones but for off, worst and sums):
        matrix : triangle of A, then of the unscaled factor L D.
        diagonal : (size,) A's.
        off : (size,) largest off-diagonal magnitude of each row.
        inverse : (size,) -1/D.
        panel : (2, size, 3) columns of -L, of this block and of the next.
        receptance : (size, columns) rows of A^-1, columns of the driven coordinates.
        wind : (n, 3) of each motor, gear * rho; 1 - rho; gear/z (see `motor_terms`).
        worst : the guard.
        elongation : (m + 1, columns) v, of the needed springs.
        roots : (elements,) square roots of weights, of elements i <= j of the motors' response.
        rows : (m + 1 or m + 2, elements) a_s, and the residual (see `sensitivity_products`); or
            (m, 2, n) with separable noise.
        sums : (pairs, 4) of rows s >= t, in tiles of two by two.
        scratch : what the likelihood of runs needs, see `run_cells`.
    """

    d: int
    s: int
    size: int
    pad: int
    first: int
    n: int
    wide: int
    n_inner: int
    m: int
    p: int
    damping_step: int
    exponents_step: int
    mass: int
    damping: int
    stiffness: int
    spring_stiffness: int
    spring_damping: int
    exponents: int
    order: int
    motors: int
    gears: int
    inner: int
    needed: int
    packed: int
    bounds: int
    arms: int
    block: int
    listed: int
    matrix: int
    diagonal: int
    off: int
    inverse: int
    panel: int
    receptance: int
    wind: int
    worst: int
    elongation: int
    roots: int
    rows: int
    sums: int
    scratch: int


@dataclass(frozen=True, eq=False)
class Workspace:
    """Addresses, and the arrays they point to, which must live as long."""

    at: Work
    arrays: Sequence[Array | IntArray]


class Workspaces:
    """The memory of threads that take turns: no two get the same at once."""

    def __init__(
        self,
        plan: EliminationPlan,
        network: SpringNetwork,
        tables: Sequence[Array],
        scratch: int = 0,
    ) -> None:
        self._made_of = plan, network, tables, scratch
        self._idle: list[Workspace] = []

    @contextmanager
    def one(self) -> Iterator[Work]:
        """Lend one out for the length of the block."""
        try:
            space = self._idle.pop()
        except IndexError:
            space = workspace(*self._made_of)
        yield space.at
        self._idle.append(space)


def contiguous(array: Array) -> Array:
    """Return `array` as contiguous doubles, fit to be used by its address."""
    return np.ascontiguousarray(array, dtype=np.float64)


def network_tables(network: SpringNetwork) -> list[Array]:
    """Return the arrays of `network` that the kernel reads, to be shared by all threads."""
    return [
        contiguous(a)
        for a in (
            network.mass,
            network.damping,
            network.stiffness,
            *network.coefficients,
            shared(network.coefficient_exponents),
        )
    ]


def _step(table: Array) -> int:
    """Return the doubles from one position to the next; 0 where all share one."""
    return table[0].size if table.ndim == 3 and len(table) > 1 else 0


def workspace(
    plan: EliminationPlan, network: SpringNetwork, tables: Sequence[Array], scratch: int = 0
) -> Workspace:
    """Return the memory of one thread, with so many vectors of scratch."""
    size, n, m = len(plan.order), len(plan.motors), len(plan.needed)
    p = len(network.parameters)
    columns = -(-n // BLOCK) * BLOCK
    sizes = (
        network.mass.shape[-1],
        network.coefficients[0].shape[1],
        size,
        plan.pad,
        plan.first,
        n,
        2 * columns,
        len(plan.inner),
        m,
        p,
        _step(tables[1]),
        _step(tables[5]),
    )
    structure: list[Array | IntArray] = [
        *(np.ascontiguousarray(t) for t in (plan.order, plan.motors)),
        contiguous(plan.gears),
        *(np.ascontiguousarray(t) for t in (plan.inner, plan.needed)),
    ]
    pointed: list[Array | IntArray] = [
        *tables,
        *structure,
        *_doubles(size, n, m, p),
        *_vectors(size, n, m, columns),
        aligned(scratch),
    ]
    return Workspace(Work(*sizes, *(address(a) for a in pointed)), pointed)


def _doubles(size: int, n: int, m: int, p: int) -> list[Array]:
    """Return the buffers of doubles, in the order of `Work`."""
    lengths = (3 * size * (size + 1) // 2, 3 * size, 3 * n, 4 * m * m, 6 * m * p)
    return [np.zeros(length) for length in lengths]


def _vectors(size: int, n: int, m: int, columns: int) -> list[Array]:
    """Return the buffers of vectors, in the order of `Work`; a complex one takes two."""
    elements, pairs = n * (n + 1), (m + 2) // 2
    counts = (
        size * (size + 1),
        2 * size,
        size,
        2 * size,
        4 * BLOCK * size,
        2 * size * columns,
        6 * n,
        1,
        2 * (m + 1) * columns,
        elements,
        max(elements, 4 * n) * pairs * 2,
        8 * pairs * (pairs + 1),
    )
    return [aligned(count) for count in counts]
