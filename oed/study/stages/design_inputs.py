"""Criterion, limits and samples of theta that the section ``design`` of a study file asks for."""

import numpy as np

from estimators import DampingRatios, Quantity, Resonances, ToolCompliance, robot_prior
from oed.candidates.grids import candidate_at, sobol_positions
from oed.criteria.criteria import (
    AsCriterion,
    Criterion,
    DsCriterion,
    ICriterion,
    LargestVarianceCriterion,
)
from oed.criteria.prediction_variance import purpose_criterion
from oed.criteria.targets import by_name_or_kind
from oed.design.constraints import Constraints, Group
from oed.experiment.loop_settings import per_motor
from oed.experiment.moves import MoveLimits, move_times
from oed.study.settings.design_settings import (
    DesignChoice,
    Moves,
    PurposeChoice,
    Ranges,
    RobustChoice,
)
from oed.study.stages.assumed_springs import all_assumed
from robotmodels import ElasticRobot, Frame, tool_frame
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput, NoEquilibrium, check_word, naming

_ABOUT = {"Ds": DsCriterion, "As": AsCriterion, "maximin": LargestVarianceCriterion}
_DRAWS = 30  # for each sample of theta that is asked for
_MOST_TRIED = 1000  # candidates in which a sample must hold the robot up
_SLACK = 1e-9  # [rad] or [m]: ends of ranges belong to them in spite of rounding


def criterion_of(choice: DesignChoice, robot: ElasticRobot) -> str | Criterion:
    """Return the criterion, for one theta.

    Raises
    ------
    IdentificationError
        If what the design is for does not exist in its region.
    """
    if choice.purpose is not None:
        return purpose_of(choice.purpose, robot)
    kind = _ABOUT.get(choice.criterion)
    if kind is None:
        return choice.criterion
    springs = [] if choice.interest else all_assumed(choice, robot)
    return kind(choice.interest or tuple(f"{spring.name}.stiffness" for spring in springs))


def purpose_of(purpose: PurposeChoice, robot: ElasticRobot) -> ICriterion:
    """Return the criterion I of a purpose; errors: see `criterion_of`."""
    with naming("design.purpose"):
        region = sobol_positions(robot, purpose.positions, purpose.region)
        return purpose_criterion(robot, _quantity(purpose, robot), region)


def _quantity(purpose: PurposeChoice, robot: ElasticRobot) -> Quantity:
    if purpose.quantity == "tool_compliance":
        frame = Frame(purpose.link or tool_frame(robot).link, purpose.at)
        return ToolCompliance(frame, purpose.direction)
    kind = Resonances if purpose.quantity == "resonances" else DampingRatios
    return kind(purpose.count, purpose.motors)


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


def parameter_samples(
    choice: RobustChoice, robot: ElasticRobot, positions: Array, rng: np.random.Generator
) -> Array:
    """Return samples of theta, (samples, p) [SI]; parameters without a std stay as they are.

    A robot stands in the candidates, so samples of theta with which it would not are drawn again.

    Raises
    ------
    InvalidInput
        If `std` names neither a parameter nor a kind of them; without `std`, if the robot file has
        no standard deviations; if hardly any sample holds the robot up.
    """
    values = robot.parameters.values
    root = _prior_root(robot) if choice.std is None else np.diag(_std(choice.std, robot))
    few = positions[:: -(-len(positions) // _MOST_TRIED)]
    samples, refusal = [values], None
    for _ in range(_DRAWS * choice.samples):
        if len(samples) == choice.samples:
            return np.array(samples)
        theta = values * np.exp(rng.standard_normal(len(values)) @ root)
        try:
            robot.equilibrium(few, theta)
        except NoEquilibrium as error:
            refusal = error
        else:
            samples.append(theta)
    raise InvalidInput(
        f"design.robust: {_DRAWS * choice.samples} draws gave {len(samples) - 1} samples of the "
        f"parameters with which the robot stands; the last did not: {refusal}; a smaller std is "
        "needed"
    )


def _prior_root(robot: ElasticRobot) -> Array:
    """Return a root R of the covariance R^T R of ln theta that the robot file has, (p, p)."""
    prior, p = robot_prior(robot), len(robot.parameters)
    root, columns = np.zeros((p, p)), prior.columns(robot.parameters.names)
    correlation = np.eye(len(columns)) if prior.correlation is None else prior.correlation
    root[np.ix_(columns, columns)] = np.linalg.cholesky(correlation).T * prior.std
    return root


def _std(std: float | dict[str, float], robot: ElasticRobot) -> Array:
    """Return the standard deviation of ln theta that the study gives each parameter, (p,)."""
    return np.nan_to_num(by_name_or_kind(std, robot.parameters.names, "design.robust.std"))


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
        check_word(f"design.{key}:", joint, joints, "is not a driven joint")
        column = joints.index(joint)
        above = positions[:, column] - low
        if robot.turning[column]:
            above = above - 2 * np.pi * np.floor((above + _SLACK) / (2 * np.pi))
        inside &= (above >= -_SLACK) & (above <= high - low + _SLACK)
    if not inside.any():
        raise InvalidInput(f"design.{key}: no candidate lies in these ranges")
    return np.flatnonzero(inside)
