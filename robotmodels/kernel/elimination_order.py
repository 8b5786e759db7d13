"""Which coordinates of a spring network are eliminated how, and in which order."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.arrays import Array, IntArray
from robotmodels.linear.spring_network import SpringNetwork

BLOCK = 3
"""Rows and columns of the register blocks of the factorisation."""
GROUND, MOTOR, INERTANCE, MOTOR_INERTANCE = -1, -2, -3, -4
"""What a term joins its row to, where that is no row (see `EliminationPlan`)."""


@dataclass(frozen=True, eq=False)
class EliminationPlan:
    """A network's structure, the same at every position.

    Motors that only one spring joins to the robot are eliminated by formula; what remains
    is factorised in the order [coordinates without needed springs, with them, driven by motors].

    Terms are numbered as in `SpringNetwork`. A code stands for `GROUND`, a spring to the ground;
    `MOTOR`, a spring to the eliminated motor of the row; `INERTANCE` of the row; `MOTOR_INERTANCE`,
    that of the row's eliminated motor.

    Attributes
    ----------
    order : ndarray of int, (size,)
        Coordinate of each row of the factorisation; -1 pads the front to whole blocks. Its last n
        rows are the coordinates that the n motors drive.
    pad : int
        Number of padding rows.
    first : int
        First row that a needed spring touches or a motor drives.
    motors : ndarray of int, (n, 3)
        The coordinate of an eliminated motor, its spring and its inertance or -1; or -1 thrice
        where the motor moves its row rigidly.
    gears : ndarray, (n,)
        The selector's entries.
    inner : ndarray of int, (.., 3)
        Terms between rows: term, row, and the other row or a code.
    needed : ndarray of int, (m, 3)
        Terms whose sensitivity is asked for: the same.
    """

    order: IntArray
    pad: int
    first: int
    motors: IntArray
    gears: Array
    inner: IntArray
    needed: IntArray


def layout(network: SpringNetwork) -> EliminationPlan | None:
    """Return the layout of `network`; None where the kernel does not know it.

    It knows motors that act on one coordinate each, and their motions as outputs.
    """
    S, ends = np.asarray(network.selector), np.asarray(network.nodes)
    n = S.shape[-1]
    if S.ndim == 3 or not network.only_motors or np.any(np.count_nonzero(S, axis=0) != 1):
        return None
    acted = np.abs(S).argmax(axis=0)
    if len(set(acted)) < n:
        return None
    motors = _eliminated(network, acted)
    driven = [
        _other_end(ends[s], m) if m >= 0 else int(a)
        for (m, s), a in zip(motors.tolist(), acted, strict=True)
    ]
    moving = [] if network.inertances is None else network.inertances.coordinates.tolist()
    inertances = np.array(
        [
            len(network.nodes) + moving.index(m) if m in moving else -1
            for m in motors[:, 0].tolist()
        ],
        dtype=np.int64,
    )
    ends = np.concatenate([ends.reshape(-1, 2), [(c, INERTANCE) for c in moving] or ends[:0]])
    needed = network.free_terms
    touched = set(ends[needed].ravel().tolist())
    elsewhere = {*motors[:, 0].tolist(), *driven}
    inner = [c for c in range(S.shape[0]) if c not in elsewhere]
    free = [c for c in inner if c not in touched]
    pad = -(len(inner) + n) % BLOCK
    order = np.array(
        [-1] * pad + free + [c for c in inner if c in touched] + driven, dtype=np.int64
    )
    motors = np.column_stack([motors, inertances])
    table = _terms(ends, order, motors, driven)
    return EliminationPlan(
        order=order,
        pad=pad,
        first=pad + len(free),
        motors=motors,
        gears=S[acted, np.arange(n)].astype(float),
        inner=table[(table[:, 2] != MOTOR) & (table[:, 2] != MOTOR_INERTANCE)],
        needed=table[needed],
    )


def _terms(ends: IntArray, order: IntArray, motors: IntArray, driven: list[int]) -> IntArray:
    """Return term, row, and the other row or a code, (terms, 3), from the terms' `nodes`."""
    row = {c: i for i, c in enumerate(order.tolist()) if c >= 0}
    motor_terms: dict[int, tuple[int, int]] = {}  # terms of eliminated motors
    for (_, spring, inertance), c in zip(motors.tolist(), driven, strict=True):
        motor_terms |= {spring: (row[c], MOTOR), inertance: (row[c], MOTOR_INERTANCE)}
    row |= {code: code for code in (GROUND, INERTANCE)}
    return np.array(
        [
            (t, *motor_terms.get(t, (row.get(a), row.get(b))))
            for t, (a, b) in enumerate(ends.tolist())
        ],
        dtype=np.int64,
    ).reshape(-1, 3)


def reduced(plan: EliminationPlan) -> EliminationPlan:
    """Return the plan of the rows from `plan.first` on, the others being eliminated."""
    remaining = plan.order[plan.first :]
    pad = -len(remaining) % BLOCK
    needed = plan.needed.copy()
    needed[:, 1:] += np.where(needed[:, 1:] >= 0, pad - plan.first, 0)
    return replace(
        plan,
        order=np.concatenate([np.full(pad, -1, dtype=np.int64), remaining]),
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
    coupled = _coupled(network, acted)
    for i, c in enumerate(acted):
        springs = np.flatnonzero(np.any(network.nodes == c, axis=1))
        if len(springs) != 1 or coupled[i]:
            continue
        other = _other_end(network.nodes[springs[0]], c)
        if other >= 0 and other != c and other not in taken:
            motors[i] = c, springs[0]
            taken.add(other)
    return motors


def _coupled(network: SpringNetwork, coordinates: IntArray) -> NDArray[np.bool_]:
    """Return which of the `coordinates`, (n,), more than springs couple to others."""
    d = network.mass.shape[-1]
    together = np.zeros((len(coordinates), d), dtype=bool)
    for matrix in (network.mass, network.damping, network.stiffness):
        together |= np.any(matrix.reshape(-1, d, d)[:, coordinates], axis=0)
    together[np.arange(len(coordinates)), coordinates] = False
    return np.asarray(together.any(axis=1))
