"""Candidates, criterion, limits and samples of theta that a study file asks for."""

import numpy as np

from oed.candidates.grids import candidate_at
from oed.candidates.screening import ScreenedCandidates
from oed.candidates.sources import Workcell, gathered_candidates
from oed.candidates.task_space import TaskBox
from oed.criteria.criteria import AsCriterion, Criterion, DsCriterion
from oed.design.constraints import Constraints, Group
from oed.experiment.experiment_file import per_motor
from oed.experiment.moves import MoveLimits, move_times
from oed.study.settings.candidates_settings import CandidatesChoice, ObstacleChoice
from oed.study.settings.design_settings import DesignChoice, Moves, Ranges, RobustChoice
from robotmodels import ElasticRobot
from robotmodels.collision.obstacles import Box, Obstacle, Plane, Sphere
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput, nearest
from robotmodels.common.progress import Progress

_SLACK = 1e-9  # [rad] or [m]: ends of ranges belong to them in spite of rounding


def gather(
    settings: CandidatesChoice, robot: ElasticRobot, progress: Progress | None = None
) -> ScreenedCandidates:
    """Return the candidates that `robot` can take.

    Raises
    ------
    InvalidInput
        As `oed.candidates.sources.gathered_candidates`, naming the key of the study file.
    """
    workcell = Workcell(
        floor=settings.floor,
        obstacles=[obstacle(choice) for choice in settings.obstacles],
        self_collision=_compares_links(settings),
        link_radius=settings.link_radius,
        margin=settings.margin,
        ignored=settings.ignored,
        torque_limits=settings.torque,
    )
    try:
        return gathered_candidates(
            robot,
            per_joint=settings.per_joint,
            limits=settings.limits,
            sobol=settings.sobol or 0,
            boxes=[TaskBox(**box.model_dump()) for box in settings.boxes],
            files=settings.files,
            listed=settings.positions,
            workcell=workcell,
            progress=progress,
        )
    except InvalidInput as error:
        # Of arguments that are this section's keys; files are named by their paths.
        message = str(error).replace("torque_limits", "torque", 1)
        section = "candidates." if message.startswith(tuple(CandidatesChoice.model_fields)) else ""
        raise InvalidInput(section + message) from error


def compares_shapes(settings: CandidatesChoice) -> bool:
    """Return whether collisions are checked, with the shapes and meshes of the URDF."""
    return _compares_links(settings) or _has_surroundings(settings)


def obstacle(choice: ObstacleChoice) -> Obstacle:
    """Return the plane, box or sphere that settings describe."""
    if choice.normal is not None and choice.offset is not None:
        return Plane(choice.name, choice.normal, choice.offset)
    center = choice.center or (0.0, 0.0, 0.0)
    if choice.size is not None:
        return Box(choice.name, center, choice.size, choice.rpy or (0.0, 0.0, 0.0))
    return Sphere(choice.name, center, choice.radius or 0.0)


def _compares_links(settings: CandidatesChoice) -> bool:
    """Return whether links are compared with each other; by default where anything else is."""
    default = _has_surroundings(settings)
    return default if settings.self_collision is None else settings.self_collision


def _has_surroundings(settings: CandidatesChoice) -> bool:
    return bool(settings.obstacles) or settings.floor is not None


def criterion_of(choice: DesignChoice) -> str | Criterion:
    """Return the criterion, for one theta."""
    if choice.criterion == "Ds":
        return DsCriterion(choice.interest)
    return AsCriterion(choice.interest) if choice.criterion == "As" else choice.criterion


def constraints_of(
    choice: DesignChoice, robot: ElasticRobot, positions: Array
) -> Constraints | None:
    """Return the limits on experiments in candidates (Q, n); None if shares need only sum to one.

    Raises
    ------
    InvalidInput
        Naming the key that fits no joint or no candidate.
    """
    if not choice.limited:
        return None
    groups = {}
    for name, group in choice.groups.items():
        members = _within(group.where, positions, robot, f"groups.{name}.where")
        most = np.inf if group.most is None else float(group.most)
        groups[name] = Group(members.tolist(), most, float(group.least))
    forbidden = [
        _within(where, positions, robot, f"forbidden[{i}]")
        for i, where in enumerate(choice.forbidden)
    ]
    remedy = "name it in candidates.positions too"
    mandatory = [
        candidate_at(positions, np.array(position), f"design.mandatory[{i}]", remedy, robot.turning)
        for i, position in enumerate(choice.mandatory)
    ]
    return Constraints(
        experiments=choice.number,
        time=choice.time,
        durations=None if choice.time is None else _durations(choice, robot, positions),
        most=choice.most,
        mandatory=dict.fromkeys(mandatory, 1.0),
        forbidden=np.concatenate(forbidden).tolist() if forbidden else (),
        groups=groups,
    )


def move_limits(moves: Moves, robot: ElasticRobot) -> MoveLimits:
    """Return the limits of moves.

    Raises
    ------
    InvalidInput
        For a wrong number of motors.
    """
    motors = tuple(robot.motor_names)
    return MoveLimits(
        motors,
        robot.position_limits,
        per_motor("design.moves.speed", moves.speed, motors),
        per_motor("design.moves.acceleration", moves.acceleration, motors),
    )


def home_position(moves: Moves, robot: ElasticRobot, positions: Array) -> Array:
    """Return where the robot starts and ends, (n,), by default amid the candidates (Q, n)."""
    if moves.home is None:
        return np.asarray((positions.min(axis=0) + positions.max(axis=0)) / 2)
    if len(moves.home) != len(robot.motor_names):
        raise InvalidInput(
            f"design.moves.home: {len(moves.home)} angles; {len(robot.motor_names)} are needed"
        )
    return np.array(moves.home)


def parameter_samples(choice: RobustChoice, robot: ElasticRobot, rng: np.random.Generator) -> Array:
    """Return samples of theta, (samples, p) [SI]; parameters without a std stay as they are.

    Raises
    ------
    InvalidInput
        If `std` names neither a parameter nor a kind of them.
    """
    names, values = robot.parameters.names, robot.parameters.values
    by_key = dict.fromkeys(names, choice.std) if isinstance(choice.std, float) else choice.std
    kinds = [name.split(".", 1)[-1] for name in names]
    for key in by_key:
        if key not in names and key not in kinds:
            possible = [*dict.fromkeys(kinds), *names]
            raise InvalidInput(
                f"design.robust.std: {key!r} is no free parameter and no kind of them"
                f"{nearest(key, possible)}"
            )
    std = [by_key.get(n, by_key.get(k, 0.0)) for n, k in zip(names, kinds, strict=True)]
    steps = rng.standard_normal((choice.samples - 1, len(values))) * np.array(std)
    return np.asarray(values * np.exp(np.vstack([np.zeros(len(values)), steps])))


def _durations(choice: DesignChoice, robot: ElasticRobot, positions: Array) -> Array:
    """Return what one experiment in each candidate takes, moves included, (Q,) [s]."""
    moves = choice.moves or Moves()
    home = home_position(moves, robot, positions)
    one_way = move_times(np.atleast_2d(home), positions, move_limits(moves, robot))[0]
    return np.asarray((choice.measuring or 0.0) + 2 * one_way)


def _within(where: Ranges, positions: Array, robot: ElasticRobot, key: str) -> IntArray:
    """Return the candidates (k,) within ranges of joints, whole turns aside where a joint turns."""
    joints = tuple(robot.motor_joints)
    inside = np.ones(len(positions), dtype=bool)
    for joint, (low, high) in where.items():
        if joint not in joints:
            raise InvalidInput(
                f"design.{key}: {joint!r} is not a driven joint{nearest(joint, joints)}; "
                f"there are {', '.join(joints)}"
            )
        column = joints.index(joint)
        above = positions[:, column] - low
        if robot.turning[column]:
            above = above - 2 * np.pi * np.floor((above + _SLACK) / (2 * np.pi))
        inside &= (above >= -_SLACK) & (above <= high - low + _SLACK)
    if not inside.any():
        raise InvalidInput(f"design.{key}: no candidate lies in these ranges")
    return np.flatnonzero(inside)
