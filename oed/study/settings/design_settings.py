"""The section ``design`` of a study file: what is wanted, what limits it, and how sure theta is.

    design:
      criterion: D               # or A, E, Ds, As
      interest: [g1.stiffness]   # parameters that Ds and As are about
      experiments: 15            # visits, a run per motor each; left out where there is a time: any
      most: 1                    # in one position; left out: any number
      time: 3600.0               # of all visits and moves [s]
      measuring: 40.0            # what one visit takes [s]; needed with time
      moves:                     # orders the visits; each motor's largest, arm side
        speed: 1.0               # [rad/s]
        acceleration: 2.0        # [rad/s^2]
        home: [0, -1.5, 1.5]     # where the robot starts and ends; left out: middle of the ranges
      mandatory: [[0, -1.0, 0.5]]                        # candidates measured at least once
      forbidden: [{elbow_joint: [-0.2, 0.2]}]            # ranges in which nothing is measured
      groups:                                            # of candidates within ranges
        folded: {where: {elbow_joint: [1.5, 2.5]}, most: 4, least: 1}
      robust:                    # holds for samples of theta
        kind: maximin            # or average
        std: 0.3                 # of their logarithms
        samples: 8               # of theta
      tolerance: 1.0e-6          # certified gap
      solver: cvxpy              # or newton, which is faster and takes every criterion but E

A time counts a move from home and back for each experiment, so that it suffices in any order.
A robust design holds for samples of theta: the robot file's, and others whose logarithms are normal
about it with standard deviation `std`: one number, or numbers by parameter or kind, as
``{stiffness: 0.2, damping: 0.7}``.
"""

from typing import TYPE_CHECKING, Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from oed.experiment.experiment_file import MoveChoice, per_motor
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput, nearest
from robotmodels.common.yaml_files import Strict
from robotmodels.description.ranges import Coordinate, Count, JointLimit, Seconds

if TYPE_CHECKING:
    from oed.criteria.criteria import Criterion
    from oed.design.constraints import Constraints
    from oed.experiment.moves import MoveLimits
    from robotmodels import ElasticRobot

_SAME = 1e-6  # [rad] or [m]

Deviation = Annotated[float, Field(ge=1e-6, le=10)]

Ranges = Annotated[dict[str, tuple[JointLimit, JointLimit]], Field(min_length=1)]


class Moves(MoveChoice):
    """How the robot moves between positions, and from where."""

    home: Annotated[tuple[Coordinate, ...], Field(min_length=1)] | None = None

    def limits(self, robot: "ElasticRobot") -> "MoveLimits":
        """Return the limits of moves.

        Raises
        ------
        InvalidInput
            For a wrong number of motors.
        """
        from oed.experiment.moves import MoveLimits

        motors = tuple(robot.motor_names)
        return MoveLimits(
            motors,
            robot.position_limits,
            per_motor("design.moves.speed", self.speed, motors),
            per_motor("design.moves.acceleration", self.acceleration, motors),
        )

    def start(self, robot: "ElasticRobot", positions: Array) -> Array:
        """Return where the robot starts and ends, (n,), given the candidates (Q, n)."""
        if self.home is None:
            return np.asarray((positions.min(axis=0) + positions.max(axis=0)) / 2)
        if len(self.home) != len(robot.motor_names):
            raise InvalidInput(
                f"design.moves.home: {len(self.home)} angles; {len(robot.motor_names)} are needed"
            )
        return np.array(self.home)


class GroupChoice(Strict):
    """Limits on the experiments in candidates within ranges of joints."""

    where: Ranges
    most: Count | None = None
    least: Annotated[int, Field(ge=0, le=100_000)] = 0

    @model_validator(mode="after")
    def _some(self) -> Self:
        if self.most is None and not self.least:
            raise ValueError("neither most nor least is given; one of them is needed")
        return self


class RobustChoice(Strict):
    """Samples of theta for which a design is to hold, the robot file's values first."""

    kind: Literal["maximin", "average"] = "maximin"
    std: Deviation | Annotated[dict[str, Deviation], Field(min_length=1)]
    samples: Annotated[int, Field(ge=2, le=64)] = 8

    def values(self, robot: "ElasticRobot", rng: np.random.Generator) -> Array:
        """Return samples of theta, (samples, p) [SI]; parameters without a std stay as they are.

        Raises
        ------
        InvalidInput
            If `std` names neither a parameter nor a kind of them.
        """
        names, own = robot.parameters.names, robot.parameters.values
        given = dict.fromkeys(names, self.std) if isinstance(self.std, float) else self.std
        kinds = [name.split(".", 1)[-1] for name in names]
        for key in given:
            if key not in names and key not in kinds:
                known = [*dict.fromkeys(kinds), *names]
                raise InvalidInput(
                    f"design.robust.std: {key!r} is no free parameter and no kind of them"
                    f"{nearest(key, known)}"
                )
        std = [given.get(n, given.get(k, 0.0)) for n, k in zip(names, kinds, strict=True)]
        drawn = rng.standard_normal((self.samples - 1, len(own))) * np.array(std)
        return np.asarray(own * np.exp(np.vstack([np.zeros(len(own)), drawn])))


class DesignChoice(Strict):
    """What to maximise and within what limits; see the module."""

    criterion: Literal["D", "A", "E", "Ds", "As"] = "D"
    interest: tuple[str, ...] = ()
    experiments: Count = 15
    most: Count | None = None
    time: Seconds | None = None
    measuring: Seconds | None = None
    moves: Moves | None = None
    mandatory: tuple[tuple[Coordinate, ...], ...] = ()
    forbidden: tuple[Ranges, ...] = ()
    groups: dict[str, GroupChoice] = {}
    robust: RobustChoice | None = None
    tolerance: Annotated[float, Field(ge=1e-12, le=1)] = 1e-6
    solver: Literal["cvxpy", "newton"] = "cvxpy"

    @model_validator(mode="after")
    def _interest(self) -> Self:
        if (self.criterion in ("Ds", "As")) != bool(self.interest):
            needed = "needs" if self.criterion in ("Ds", "As") else "has no"
            raise ValueError(
                f"interest: criterion {self.criterion} {needed} parameters of interest"
            )
        return self

    @model_validator(mode="after")
    def _time(self) -> Self:
        if (self.time is None) != (self.measuring is None):
            one, other = ("time", "measuring") if self.time else ("measuring", "time")
            raise ValueError(f"{one} needs {other}: seconds of all, and of one experiment")
        if self.time is not None and self.time < (self.measuring or 0.0):
            raise ValueError(f"time: {self.time:g} s; one experiment takes {self.measuring:g} s")
        return self

    @property
    def limited(self) -> bool:
        """Whether more than the number of experiments limits the plan."""
        return bool(self.most or self.time or self.mandatory or self.forbidden or self.groups)

    @property
    def number(self) -> int | None:
        """Experiments in all; None where only time limits them."""
        counted = self.time is None or "experiments" in self.model_fields_set
        return self.experiments if counted else None

    def wanted(self) -> "str | Criterion":
        """Return the criterion, for one theta."""
        from oed.criteria.criteria import AsCriterion, DsCriterion

        if self.criterion == "Ds":
            return DsCriterion(self.interest)
        return AsCriterion(self.interest) if self.criterion == "As" else self.criterion

    def constraints(self, robot: "ElasticRobot", positions: Array) -> "Constraints | None":
        """Return the limits on experiments; None where shares need only sum to one.

        Raises
        ------
        InvalidInput
            Naming the key that fits no joint or no candidate.
        """
        from oed.design.constraints import Constraints, Group

        if not self.limited:
            return None
        joints = tuple(robot.motor_joints)
        groups = {}
        for name, choice in self.groups.items():
            members = _within(choice.where, positions, joints, f"groups.{name}.where")
            most = np.inf if choice.most is None else float(choice.most)
            groups[name] = Group(members.tolist(), most, float(choice.least))
        forbidden = [
            _within(where, positions, joints, f"forbidden[{i}]")
            for i, where in enumerate(self.forbidden)
        ]
        return Constraints(
            experiments=self.number,
            time=self.time,
            durations=None if self.time is None else self._durations(robot, positions),
            most=self.most,
            mandatory={_place(p, positions, i): 1.0 for i, p in enumerate(self.mandatory)},
            forbidden=np.concatenate(forbidden).tolist() if forbidden else (),
            groups=groups,
        )

    def _durations(self, robot: "ElasticRobot", positions: Array) -> Array:
        """Return what one experiment in each candidate takes, moves included, (Q,) [s]."""
        from oed.experiment.moves import move_times

        moves = self.moves or Moves()
        home = moves.start(robot, positions)
        ways = move_times(np.atleast_2d(home), positions, moves.limits(robot))[0]
        return np.asarray((self.measuring or 0.0) + 2 * ways)


def _within(where: Ranges, positions: Array, joints: tuple[str, ...], key: str) -> IntArray:
    """Return the candidates (k,) within ranges of joints."""
    inside = np.ones(len(positions), dtype=bool)
    for joint, (low, high) in where.items():
        if joint not in joints:
            raise InvalidInput(
                f"design.{key}: {joint!r} is not a driven joint{nearest(joint, joints)}; "
                f"there are {', '.join(joints)}"
            )
        column = positions[:, joints.index(joint)]
        inside &= (column >= low) & (column <= high)
    if not inside.any():
        raise InvalidInput(f"design.{key}: no candidate lies in these ranges")
    return np.flatnonzero(inside)


def _place(position: tuple[float, ...], positions: Array, number: int) -> int:
    """Return the candidate at a position."""
    key = f"design.mandatory[{number}]"
    if len(position) != positions.shape[1]:
        raise InvalidInput(f"{key}: {len(position)} angles; {positions.shape[1]} are needed")
    away = np.abs(positions - np.array(position)).max(axis=1)
    nearby = int(np.argmin(away))
    if away[nearby] > _SAME:
        raise InvalidInput(
            f"{key}: {list(position)} is not among the candidates; the nearest is "
            f"{np.round(positions[nearby], 4).tolist()}; name it in candidates.positions too"
        )
    return nearby
