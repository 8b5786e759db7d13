"""Which coordinates of a spring network are eliminated how, and in which order."""

from dataclasses import dataclass, replace

import numpy as np

from robotmodels.arrays import Array, IntArray
from robotmodels.spring_network import SpringNetwork

BLOCK = 3
"""Rows and columns of the register blocks of the factorisation."""


@dataclass(frozen=True, eq=False)
class Layout:
    """A network's structure, the same at every position.

    Motors that only their own spring ties to the rest are eliminated by formula; what remains
    is factorised in the order [coordinates without needed springs, with them, driven by motors].

    Attributes
    ----------
    order : (size,) coordinate of each row of the factorisation; -1 pads the front to whole blocks.
        Its last n rows are the coordinates that the n motors drive.
    pad : number of padding rows.
    first : first row that a needed spring touches or a motor drives.
    motors : (n, 2) the coordinate of an eliminated motor and its spring, or -1, -1 where the
        motor moves its row rigidly.
    gears : (n,) the selector's entries.
    inner : (.., 3) springs between rows: spring, row, other row or -1 for the ground.
    needed : (m, 3) springs whose sensitivity is asked for: spring, row, other row; -1 for the
        ground, -2 for the eliminated motor of that row.
    """

    order: IntArray
    pad: int
    first: int
    motors: IntArray
    gears: Array
    inner: IntArray
    needed: IntArray


def needed_springs(network: SpringNetwork) -> IntArray:
    """Return the springs of which a free parameter sets the stiffness or the damping."""
    s = len(network.ends)
    moved = (
        np.any(network.exponents != 0, axis=(0, 2)) if len(network.exponents) else np.ones(2 * s)
    )
    return np.flatnonzero(np.logical_or(moved[:s], moved[s:]))


def layout(network: SpringNetwork) -> Layout | None:
    """Return the layout of `network`; None where the kernel does not know it.

    It knows motors that act on one coordinate each, and their accelerations as outputs.
    """
    S, ends = np.asarray(network.selector), np.asarray(network.ends)
    n = S.shape[1]
    if network.measurement is not None or np.any(np.count_nonzero(S, axis=0) != 1):
        return None
    acted = np.abs(S).argmax(axis=0)
    if len(set(acted)) < n:
        return None
    motors = _eliminated(network, acted)
    driven = [
        _other_end(ends[s], m) if m >= 0 else a for (m, s), a in zip(motors, acted, strict=True)
    ]
    needed = needed_springs(network)
    touched = {int(c) for s in needed for c in ends[s] if c >= 0}
    inner = [c for c in range(S.shape[0]) if c not in set(motors[:, 0]) | set(driven)]
    free = [c for c in inner if c not in touched]
    pad = -(len(inner) + n) % BLOCK
    order = np.array(
        [-1] * pad + free + [c for c in inner if c in touched] + driven, dtype=np.int64
    )
    row = {int(c): i for i, c in enumerate(order) if c >= 0} | {-1: -1}
    own = {int(s): row[c] for (_, s), c in zip(motors, driven, strict=True) if s >= 0}
    table = np.array(
        [
            (s, own[s], -2) if s in own else (s, row[int(a)], row[int(b)])
            for s, (a, b) in enumerate(ends)
        ],
        dtype=np.int64,
    ).reshape(-1, 3)
    return Layout(
        order=order,
        pad=pad,
        first=pad + len(free),
        motors=motors,
        gears=S[acted, np.arange(n)].astype(float),
        inner=table[table[:, 2] != -2],
        needed=table[needed],
    )


def reduced(plan: Layout) -> Layout:
    """Return the layout of what is left when rows before `plan.first` have been eliminated."""
    kept = plan.order[plan.first :]
    pad = -len(kept) % BLOCK
    needed = plan.needed.copy()
    needed[:, 1:] += np.where(needed[:, 1:] >= 0, pad - plan.first, 0)
    return replace(
        plan,
        order=np.concatenate([np.full(pad, -1, dtype=np.int64), kept]),
        pad=pad,
        first=pad,
        inner=plan.inner[:0],
        needed=needed,
    )


def _other_end(ends: IntArray, coordinate: int) -> int:
    return int(ends[1] if ends[0] == coordinate else ends[0])


def _eliminated(network: SpringNetwork, acted: IntArray) -> IntArray:
    """Return, (n, 2), the coordinate and the spring of motors that only that spring ties."""
    motors = np.full((len(acted), 2), -1, dtype=np.int64)
    taken = {int(c) for c in acted}
    for i, c in enumerate(acted):
        springs = np.flatnonzero(np.any(network.ends == c, axis=1))
        if len(springs) != 1 or not _alone(network, c):
            continue
        other = _other_end(network.ends[springs[0]], c)
        if other >= 0 and other != c and other not in taken:
            motors[i] = c, springs[0]
            taken.add(other)
    return motors


def _alone(network: SpringNetwork, coordinate: int) -> bool:
    """Return whether nothing but springs couples `coordinate` to the others."""
    return not any(
        np.any(np.delete(matrix[..., coordinate, :], coordinate, axis=-1))
        for matrix in (network.mass, network.damping, network.stiffness)
    )
