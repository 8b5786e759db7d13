"""The section ``design`` of a study file: criterion, limits, and how sure theta is.

    design:
      criterion: D               # or A, E, Ds, As, maximin, I
      interest: [g1.stiffness]   # parameters that Ds, As and maximin are about
      purpose:                   # what I is to predict: its mean relative variance
        quantity: tool_compliance                        # or resonances, damping_ratios
        link: tool0              # of compliance; left out: the last one
        at: [0.0, 0.0, 0.1]      # point in its frame [m]
        direction: [0, 0, 1]     # in the base's axes; left out: all three half axes
        count: 1                 # of resonances or damping ratios
        motors: clamped          # or free
        region: {elbow_joint: [0.5, 2.0]}                # ranges; left out: all joints' ranges
        positions: 32            # so many, all over the region
      experiments: 15            # visits with a run per motor; left out where there is a time: any
      most: 1                    # in one position; left out: any number
      time: 3600.0               # of all experiments and moves [s]
      measuring: 40.0            # what one experiment takes [s]; needed with time
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
        std: 0.3                 # of their logarithms; left out: those of the robot file
        samples: 8               # of theta
      distinguish:                # springs as in a robot file, which the data shall show if there
        - {name: b2x, joint: shoulder_lift_joint, axis: x, stiffness: 1.0e+6, damping: 1.0e+3}
        - structure.yaml         # or a robot file with further springs, which go together
      tolerance: 1.0e-6          # certified gap
      solver: auto               # newton, which takes every criterion but E, where it can; or cvxpy

A time counts a move from home and back for each experiment, so that it suffices in any order.
A robust design holds for samples of theta: the robot file's, and others whose logarithms are normal
about it with standard deviation `std`: one number, or numbers by parameter or kind, as
``{stiffness: 0.2, damping: 0.7}``, or those that the robot file has of guesses or of a fit.
With springs to tell apart the criterion is about the stiffnesses of these, too, at the values that
are assumed: D over both, or with interest in them alone, which Ds, As and maximin have if they name
nothing else. maximin raises the least information that one of them has.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from oed.experiment.loop_settings import MoveChoice
from robotmodels.common.yaml_files import FileSection
from robotmodels.description.ranges import Coordinate, Count, JointLimit, Seconds, Vector
from robotmodels.description.robot_file import Spring

Deviation = Annotated[float, Field(ge=1e-6, le=10)]

Ranges = Annotated[dict[str, tuple[JointLimit, JointLimit]], Field(min_length=1)]


_ABOUT_PARAMETERS = {"robust": "samples are", "purpose": "predictions are functions"}


class Moves(MoveChoice):
    """How the robot moves between positions, and from where."""

    home: Annotated[tuple[Coordinate, ...], Field(min_length=1)] | None = None


class GroupChoice(FileSection):
    """Limits on the experiments in candidates within ranges of joints."""

    where: Ranges
    most: Count | None = None
    least: Annotated[int, Field(ge=0, le=100_000)] = 0

    @model_validator(mode="after")
    def _some(self) -> Self:
        if self.most is None and not self.least:
            raise ValueError("neither most nor least is given; one of them is needed")
        return self


class PurposeChoice(FileSection):
    """Quantity to predict, and positions."""

    quantity: Literal["tool_compliance", "resonances", "damping_ratios"]
    link: str | None = None
    at: Vector = (0.0, 0.0, 0.0)
    direction: Vector | None = None
    count: Count = 1
    motors: Literal["clamped", "free"] = "clamped"
    region: Ranges | None = None
    positions: Annotated[int, Field(ge=1, le=10_000)] = 32

    @model_validator(mode="after")
    def _of_its_quantity(self) -> Self:
        of_tool = self.quantity == "tool_compliance"
        foreign = {"count", "motors"} if of_tool else {"link", "at", "direction"}
        if unused := sorted(foreign & self.model_fields_set):
            raise ValueError(f"{unused[0]}: {self.quantity} has no such setting; leave it out")
        return self


class RobustChoice(FileSection):
    """Samples of theta for which a design is to hold, the robot file's values first."""

    kind: Literal["maximin", "average"] = "maximin"
    std: Deviation | Annotated[dict[str, Deviation], Field(min_length=1)] | None = None
    samples: Annotated[int, Field(ge=2, le=64)] = 8


class DesignChoice(FileSection):
    """What to maximise and within what limits; see the module."""

    criterion: Literal["D", "A", "E", "Ds", "As", "maximin", "I"] = "D"
    interest: tuple[str, ...] = ()
    purpose: PurposeChoice | None = None
    experiments: Count = 15
    most: Count | None = None
    time: Seconds | None = None
    measuring: Seconds | None = None
    moves: Moves | None = None
    mandatory: tuple[tuple[Coordinate, ...], ...] = ()
    forbidden: tuple[Ranges, ...] = ()
    groups: dict[str, GroupChoice] = {}
    robust: RobustChoice | None = None
    distinguish: Annotated[tuple[Spring | str, ...], Field(max_length=64)] = ()
    tolerance: Annotated[float, Field(ge=1e-12, le=1)] = 1e-6
    solver: Literal["auto", "cvxpy", "newton"] = "auto"

    @model_validator(mode="after")
    def _interest(self) -> Self:
        about = self.criterion in ("Ds", "As", "maximin")
        if about != bool(self.interest) and not (about and self.distinguish):
            needed = "needs" if about else "has no"
            raise ValueError(
                f"interest: criterion {self.criterion} {needed} parameters of interest"
            )
        return self

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        for name, about in _ABOUT_PARAMETERS.items():
            if getattr(self, name) is not None and self.distinguish:
                raise ValueError(
                    f"{name} and distinguish: {about} of the robot's parameters, and the springs "
                    "of distinguish are none of them; leave one out, or put the springs into the "
                    "robot"
                )
        return self

    @model_validator(mode="after")
    def _purpose(self) -> Self:
        if (self.criterion == "I") != (self.purpose is not None):
            raise ValueError("purpose: criterion I needs one, and no other has one")
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
