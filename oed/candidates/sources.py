"""All ways to name candidate positions in one call, screened: what a study file asks for."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from oed.candidates.grids import candidate_positions, sobol_positions
from oed.candidates.position_files import read_positions
from oed.candidates.screening import ScreenedCandidates, screened_candidates
from oed.candidates.task_space import TaskBox, task_space_positions
from robotmodels.arrays import Array, real_numbers
from robotmodels.collision.obstacles import Obstacle
from robotmodels.collision.surroundings import Surroundings, surroundings
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.errors import InvalidInput


@dataclass(frozen=True, eq=False)
class Workcell:
    """What keeps a robot from a position, in plain values.

    Attributes
    ----------
    floor : its height above the root link's origin, against gravity [m]; None for none.
    obstacles : planes, boxes and spheres in the root link's frame.
    self_collision : whether links are compared with each other.
    link_radius : takes links for capsules [m], where the URDF has no collision shapes.
    margin : distance to keep [m].
    ignored : pairs of links that may touch.
    torque_limits : that hold the arm and its payload, on the motor shafts, (n,) or one [N m].
    """

    floor: float | None = None
    obstacles: Sequence[Obstacle] = ()
    self_collision: bool = True
    link_radius: float | None = None
    margin: float = 0.0
    ignored: Sequence[tuple[str, str]] = ()
    torque_limits: float | Sequence[float] | None = None

    def surroundings(self, robot: ElasticRobot) -> Surroundings | None:
        """Return what `robot` is compared with; None where nothing can be in its way.

        Raises
        ------
        InvalidInput : as `robotmodels.surroundings`.
        """
        if self.floor is None and not self.obstacles and not self.self_collision:
            return None
        return surroundings(
            robot,
            floor=self.floor,
            obstacles=self.obstacles,
            self_collision=self.self_collision,
            link_radius=self.link_radius,
            margin=self.margin,
            ignored=self.ignored,
        )


def gathered_candidates(
    robot: ElasticRobot,
    *,
    per_joint: int | Sequence[int] | Mapping[str, int] | None = None,
    limits: Sequence[Sequence[float]] | Mapping[str, Sequence[float]] | Array | None = None,
    sobol: int = 0,
    boxes: Iterable[TaskBox] = (),
    files: Iterable[str | Path] = (),
    listed: Sequence[Sequence[float]] | Array = (),
    workcell: Workcell | None = None,
    rng: np.random.Generator | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> ScreenedCandidates:
    """Return the candidates of all sources that the robot can take in its cell.

    Without any source it is the usual joint grid.

    Parameters
    ----------
    robot : the robot.
    per_joint : points per joint of a joint grid, as in `candidate_positions`.
    limits : ranges of the grid and of the Sobol points.
    sobol : number of Sobol points; 0 for none.
    boxes : in task space.
    files : lists of positions, as in `read_positions`.
    listed : (k, n) positions by hand.
    workcell : what may be in the way; None checks joint limits and duplicates only.
    rng : scrambles the Sobol points and draws the starts of the inverse kinematics; None takes
        the plain Sobol points, and a fixed seed for the starts.
    progress : of the comparison with the surroundings: positions done and their total.

    Raises
    ------
    InvalidInput : as the functions named above; with counts by reason, if none is left.
    """
    cell = Workcell(self_collision=False) if workcell is None else workcell
    boxes, files = tuple(boxes), tuple(files)
    found, notes = [], []
    if per_joint is not None or not (sobol or boxes or files or len(listed)):
        found.append(candidate_positions(robot, per_joint, limits))
    if sobol:
        found.append(sobol_positions(robot, sobol, limits, rng))
    starts = np.random.default_rng(0) if rng is None else rng
    for box in boxes:
        reached = task_space_positions(robot, box, starts)
        found.append(reached.positions)
        if len(reached.unreached):
            notes.append(
                f"{len(reached.unreached)} of {len(reached.targets)} points of the task box on "
                f"{box.link!r} are out of reach"
            )
    found += [read_positions(path, robot) for path in files]
    found += [_by_hand(listed, robot)] if len(listed) else []
    screened = screened_candidates(
        robot,
        np.concatenate(found),
        cell.surroundings(robot),
        torque_limits=cell.torque_limits,
        progress=progress,
    )
    return replace(screened, notes=(*notes, *screened.notes))


def _by_hand(listed: Sequence[Sequence[float]] | Array, robot: ElasticRobot) -> Array:
    n = len(robot.motor_names)
    for i, row in enumerate(listed):
        if len(row) != n:
            raise InvalidInput(
                f"positions[{i}]: {len(row)} angles; {n} are needed, one per motor "
                f"({', '.join(robot.motor_names)})"
            )
    return real_numbers(listed, "positions")
