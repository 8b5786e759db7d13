"""Pairs of shapes in very many positions, each compared once per combination of what decides it.

Whether two links touch depends on the joints between them, and whether a link touches the floor on
all joints before it but a first one that turns about the vertical. A grid has few combinations of
their angles. What else stands on the ground is enclosed in a cylinder about the axis of that first
joint, and compared itself only in positions in which something touches the cylinder.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from robotmodels.collision.pair_checker import PairChecker
from robotmodels.collision.shapes import Shape
from robotmodels.collision.turntable import Turntable
from robotmodels.common.arrays import Array, BoolArray, IntArray, distinct_rows
from robotmodels.common.progress import Progress, tell
from robotmodels.elastic.rigid_pose import configurations
from robotmodels.elastic.robot import ElasticRobot

_TASK = 50_000
"""Positions in a task of an executor, with which the shapes travel; a tenth of that here."""

Pairs = Sequence[tuple[int, int]]


@dataclass(frozen=True, eq=False)
class Comparison:
    """What is compared in many positions.

    Attributes
    ----------
    robot : ElasticRobot
        Moves the shapes.
    shapes : tuple of Shape
        Shapes of its links and of what stands on the ground.
    pairs : sequence of tuple of (int, int)
        Indices of the shapes that are compared.
    margin : float, m
        Distance below which two shapes count as touching.
    """

    robot: ElasticRobot
    shapes: tuple[Shape, ...]
    pairs: Pairs
    margin: float

    def touching(
        self, positions: Array, executor: Executor | None, progress: Progress | None
    ) -> BoolArray:
        """Return which pairs touch, (Q, pairs), at positions (Q, n)."""
        around, members = self._enclosed
        touching = around._by_combination(positions, executor, progress)
        near = np.flatnonzero(touching[:, members].any(axis=1))
        if len(near):
            closer = replace(self, pairs=[self.pairs[k] for k in members])
            itself = closer._by_combination(positions[near], executor, None)
            touching[np.ix_(near, members)] = itself
        return touching

    def _by_combination(
        self, positions: Array, executor: Executor | None, progress: Progress | None
    ) -> BoolArray:
        """Return `touching` of the pairs as they are."""
        touching = np.zeros((len(positions), len(self.pairs)), dtype=bool)
        decided = 0.0  # pairs, and parts of them
        for members, first, each in self._combinations(positions):
            few, parts = positions[first], []
            for part in self._compared(members, few, executor):
                parts.append(part)
                decided += len(members) * len(part) / len(few)
                tell(progress, round(len(positions) * decided / len(self.pairs)), len(positions))
            touching[:, members] = np.concatenate(parts)[each]
        return touching

    def _combinations(
        self, positions: Array
    ) -> Iterator[tuple[list[int], IntArray | slice, IntArray | slice]]:
        """Yield pairs, positions of each combination of what decides, and that of each position.

        Pairs of which hardly any combination repeats come last, with all positions.
        """
        groups: dict[tuple[int, ...], list[int]] = defaultdict(list)
        for k, pair in enumerate(self.pairs):
            groups[self._deciding(pair)].append(k)
        codes = [_codes(column) for column in positions.T]
        everywhere: list[int] = []
        for columns, members in groups.items():
            combinations = distinct_rows([codes[j] for j in columns], len(positions))
            if combinations is None:
                everywhere += members
            else:
                yield members, *combinations
        if everywhere:
            yield everywhere, slice(None), slice(None)

    def _compared(
        self, members: list[int], positions: Array, executor: Executor | None
    ) -> Iterator[BoolArray]:
        """Yield which of some pairs touch, some positions after the other."""
        what = self.robot.rigid, self.shapes, [self.pairs[k] for k in members], self.margin
        pool = executor if len(positions) >= _TASK else None
        size = _TASK if pool else _TASK // 10
        parts = (positions[i : i + size] for i in range(0, len(positions), size))
        configured = (configurations(self.robot, part) for part in parts)
        if pool is None:
            yield from map(PairChecker(*what), configured)
        else:
            yield from pool.map(partial(_touching, *what), configured)

    @cached_property
    def _turntable(self) -> Turntable | None:
        return Turntable.of(self.robot.rigid)

    @cached_property
    def _enclosed(self) -> tuple["Comparison", IntArray]:
        """Return the comparison with cylinders for shapes on the ground, and the pairs changed."""
        shapes, pairs, members = list(self.shapes), list(self.pairs), []
        cylinders: dict[int, int] = {}
        for i, shape in enumerate(self.shapes):
            cylinder = self._turntable.cylinder(shape) if self._turntable else None
            if shape.joint == 0 and cylinder is not None:
                cylinders[i] = len(shapes)
                shapes.append(cylinder)
        for k, (i, j) in enumerate(pairs):
            if i in cylinders or j in cylinders:
                pairs[k] = cylinders.get(i, i), cylinders.get(j, j)
                members.append(k)
        changed = replace(self, shapes=tuple(shapes), pairs=pairs)
        return changed, np.array(members, dtype=np.int64)

    def _deciding(self, pair: tuple[int, int]) -> tuple[int, ...]:
        """Return the columns of positions that decide whether a pair touches."""
        rigid, turntable = self.robot.rigid, self._turntable
        first, second = (self.shapes[i] for i in pair)
        joints = {*rigid.supports[first.joint]} ^ {*rigid.supports[second.joint]}
        if turntable and any(turntable.keeps(shape) for shape in (first, second)):
            joints.discard(turntable.joint)
        names = [rigid.names[joint] for joint in joints - {0}]
        leaders = self.robot.couplings
        driven = {leaders[name].leader if name in leaders else name for name in names}
        return tuple(j for j, name in enumerate(self.robot.motor_joints) if name in driven)


def _codes(column: Array) -> NDArray[np.integer]:
    """Return whole numbers from 0 for the values of a column, in as few bytes as they take."""
    values, codes = np.unique(column, return_inverse=True)
    return codes.astype(np.min_scalar_type(len(values)))


def _touching(
    rigid: pin.Model, shapes: Sequence[Shape], pairs: Pairs, margin: float, configured: Array
) -> BoolArray:
    """Return what a `PairChecker` made of the others says of configurations, in a worker."""
    return PairChecker(rigid, shapes, pairs, margin)(configured)
