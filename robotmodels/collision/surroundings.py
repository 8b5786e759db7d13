"""Where a robot would touch itself or what stands around it.

Shapes are checked at the rigid pose: elastic deflections, far smaller than any sensible margin,
are neglected.
"""

from collections.abc import Iterable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property

import coal
import numpy as np
import pinocchio as pin

from robotmodels.collision.comparison import Comparison
from robotmodels.collision.obstacles import Box, Obstacle, Plane, floor as floor_at
from robotmodels.collision.pair_checker import PairChecker
from robotmodels.collision.shapes import RobotShapes, Shape, robot_shapes
from robotmodels.common.arrays import Array, BoolArray, check_above_zero
from robotmodels.common.errors import InvalidInput, check_word
from robotmodels.common.progress import Progress, tell
from robotmodels.elastic.rigid_pose import configurations
from robotmodels.elastic.robot import ElasticRobot

_SAMPLES = 32  # positions, and one more, in all of which what is built to touch does so
_MANY = 1_000  # positions in which pairs are compared once per combination of angles


@dataclass(frozen=True)
class Pair:
    """Two things that are compared; the second is a link or an obstacle."""

    first: str
    second: str
    obstacle: bool

    def __str__(self) -> str:
        return f"{self.first!r} and {self.second!r}"


@dataclass(frozen=True, eq=False)
class Surroundings:
    """A robot among obstacles.

    Links are compared with each other by their convex hulls first, and by the surfaces of their
    meshes where the hulls touch; with obstacles by their hulls, which is on the safe side. What
    the ground carries is not compared with obstacles. Never compared with each other are links
    that one joint moves together; neighbours, on either side of one joint, which often overlap at
    their bearing and are kept apart by the joint's limits; links that touch in all of 33
    positions spread over the joints' ranges, hence by design; and the pairs of `ignored`.

    Attributes
    ----------
    robot : ElasticRobot
        The robot.
    shapes : RobotShapes
        Shapes of its links, see `robot_shapes`.
    obstacles : tuple of Obstacle
        What stands around it.
    self_collision : bool
        Whether links are compared with each other.
    margin : float, m
        Distance below which two things count as touching.
    ignored : tuple of tuple of (str, str)
        Pairs of links that may touch.

    Raises
    ------
    InvalidInput
        If the margin is negative, two obstacles have one name, or `ignored` names a link without a
        shape.
    """

    robot: ElasticRobot
    shapes: RobotShapes
    obstacles: tuple[Obstacle, ...] = ()
    self_collision: bool = True
    margin: float = 0.0
    ignored: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        links = list(dict.fromkeys(shape.link for shape in self.shapes.shapes))
        for link in (link for pair in self.ignored for link in pair):
            check_word("ignored:", link, links, "is not a link with a collision shape")
        check_above_zero(self.margin, "margin [m]", zero=True)
        names = [obstacle.name for obstacle in self.obstacles]
        for name in names:
            if names.count(name) > 1:
                raise InvalidInput(f"obstacles: the name {name!r} is used twice; names are unique")

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """What is compared: links with links, then links with obstacles."""
        return tuple(self._groups)

    @cached_property
    def built_touching(self) -> tuple[tuple[str, str], ...]:
        """Links that are not compared because they are built to touch."""
        return tuple(dict.fromkeys(self._names(pair) for pair in self._pair_lists[1]))

    def touching(
        self,
        positions: Array,
        progress: Progress | None = None,
        executor: Executor | None = None,
    ) -> BoolArray:
        """Return which of `pairs` touch, (Q, pairs), at `positions` (Q, n) within their limits."""
        if len(positions) < _MANY:
            hits = self._checker(configurations(self.robot, positions))
            tell(progress, len(positions), len(positions))
        else:
            pairs = self._checker.pairs
            many = Comparison(self.robot, self._things, pairs, self.margin)
            hits = many.touching(positions, executor, progress)
        touching = np.zeros((len(positions), len(self._groups)), dtype=bool)
        for k, group in enumerate(self._groups.values()):
            touching[:, k] = hits[:, group].any(axis=1)
        return touching

    @cached_property
    def _things(self) -> tuple[Shape, ...]:
        return (*self.shapes.shapes, *(_shape(obstacle) for obstacle in self.obstacles))

    @cached_property
    def _groups(self) -> dict[Pair, list[int]]:
        """Compared shapes by the pair of things they belong to."""
        groups: dict[Pair, list[int]] = {}
        for k, (i, j) in enumerate(self._checker.pairs):
            pair = Pair(*self._names((i, j)), j >= len(self.shapes.shapes))
            groups.setdefault(pair, []).append(k)
        return groups

    @cached_property
    def _checker(self) -> PairChecker:
        shapes = self.shapes.shapes
        pairs = list(self._pair_lists[0])
        for j in range(len(shapes), len(self._things)):
            pairs += [(i, j) for i, shape in enumerate(shapes) if shape.joint]
        return PairChecker(self.robot.rigid, self._things, pairs, self.margin)

    @cached_property
    def _pair_lists(self) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
        """Return the pairs of link shapes to compare, and those built to touch."""
        if not (self.self_collision and self.shapes.solid):
            return [], []
        shapes = self.shapes.shapes
        ignored = {frozenset(pair) for pair in self.ignored}
        pairs = [
            (i, j)
            for j in range(len(shapes))
            for i in range(j)
            if not _together(self.robot.rigid, shapes[i].joint, shapes[j].joint)
            and frozenset((shapes[i].link, shapes[j].link)) not in ignored
        ]
        low, high = self.robot.position_limits.T
        spread = np.vstack([0.5 * (low + high), low + _even(_SAMPLES, len(low)) * (high - low)])
        check = PairChecker(self.robot.rigid, shapes, pairs, self.margin)
        built = {pairs[k] for k in check.always(configurations(self.robot, spread))}
        return [p for p in pairs if p not in built], [p for p in pairs if p in built]

    def _names(self, pair: tuple[int, int]) -> tuple[str, str]:
        return self._things[pair[0]].link, self._things[pair[1]].link


def _even(count: int, n: int) -> Array:
    """Return points (count, n) spread over the unit cube, a Kronecker sequence.

    Its steps are powers of the root of x^(n + 1) = x + 1, for n = 1 the golden ratio.
    """
    root = 2.0
    for _ in range(60):
        root = (1 + root) ** (1 / (n + 1))
    return np.asarray(np.outer(np.arange(1, count + 1), root ** -np.arange(1.0, n + 1)) % 1.0)


def _together(rigid: pin.Model, first: int, second: int) -> bool:
    """Return whether two joints are one or follow each other."""
    a, b = sorted((first, second))
    return a == b or bool(rigid.parents[b] == a)


def _shape(obstacle: Obstacle) -> Shape:
    """Return an obstacle as a shape on the ground."""
    at = pin.SE3.Identity()
    if isinstance(obstacle, Plane):
        return Shape(
            obstacle.name, 0, at, coal.Halfspace(obstacle.direction, float(obstacle.offset))
        )
    at.translation = np.asarray(obstacle.center, dtype=float)
    if isinstance(obstacle, Box):
        # Roll, pitch and yaw turn about fixed axes, in this order.
        at.rotation = pin.rpy.rpyToMatrix(np.array(obstacle.rpy, dtype=float))
        return Shape(obstacle.name, 0, at, coal.Box(*map(float, obstacle.size)))
    return Shape(obstacle.name, 0, at, coal.Sphere(float(obstacle.radius)))


def surroundings(
    robot: ElasticRobot,
    *,
    floor: float | None = None,
    obstacles: Iterable[Obstacle] = (),
    self_collision: bool = True,
    link_radius: float | None = None,
    margin: float = 0.0,
    ignored: Iterable[tuple[str, str]] = (),
) -> Surroundings:
    """Return a robot with its collision shapes among obstacles.

    Parameters
    ----------
    robot : ElasticRobot
        The robot.
    floor : float, m, optional
        Height of the floor above the root link's origin, against gravity; None for none.
    obstacles : iterable of Obstacle
        Planes, boxes and spheres in the root link's frame.
    self_collision : bool
        As `Surroundings`.
    margin : float
        As `Surroundings`.
    ignored : iterable of tuple of (str, str)
        As `Surroundings`.
    link_radius : float, m, optional
        Takes links for capsules, where the URDF has no collision shapes.

    Raises
    ------
    InvalidInput
        As `Surroundings`, `robot_shapes` and `obstacles.floor`.
    """
    ground = () if floor is None else (floor_at(floor, robot.file.gravity),)
    return Surroundings(
        robot,
        robot_shapes(robot, link_radius),
        (*ground, *obstacles),
        self_collision,
        margin,
        tuple((first, second) for first, second in ignored),
    )
