"""The schema of a study of visits: what to run within minutes, or until accuracies are reached.

    schema: study/1
    robot: ur10                  # a built-in robot, or the path of a robot file
    truth: ur10                  # what `oed simulate` runs the visits on; left out: robot
    candidates: {sobol: 512}     # positions to choose from, as in other studies
    noise:                       # of one period
      torque: 0.05               # of a line, in parts of its flat level
      speed: 0.002               # of a line, root mean square, motor shaft [rad/s]
    design:
      minutes: 30                # robot time of all visits, moves included; with targets the most
      targets: {stiffness: 0.01, "*.damping": 0.05}    # relative standard deviations, by kind, name
                                 # or pattern; left out: the criterion within the minutes
      criterion: D               # or A, E; without targets
      excitations: [orthogonal, zippered]    # to choose from, and random_phase
      spectra: flat              # per_motor: which motor on which line; full: phases as well
      line_cap: 3.0              # largest power of a line, in parts of the flat one
      robust: {kind: maximin, std: 0.3, samples: 8}    # over samples of theta, or average, as in
                                 # other designs; targets are reached at every sample, or on average
      curve: [10, 20, 60]        # minutes of other plans, to compare; left out: half, twice, ...
    multisine: {band: [1.0, 60.0], sample_time: 0.002, period: 2.0}
    settle: 1.0                  # rest after each move [s]
    transient_periods: 1         # before those measured
    most_periods: 16             # measured in one visit
    limits: {torque: 50.0, speed: 10.0}     # as in an experiment file, and so the next four
    moves: {speed: 1.0, acceleration: 2.0}
    carrier: {speed: 10.0}
    controller: {...}
    imperfections: {...}
    files: [csv]                 # for the controller: csv, mat, trajectory (JointTrajectory)
    seed: 1
    output: ../out/ur10_visits   # folder; relative to this file, as every path in it

It is told from other study files by the minutes or targets of its design.
"""

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from oed.campaign.settings import Accuracy, VisitSettings
from oed.experiment.settings_files import read_settings
from oed.study.settings.design_settings import RobustChoice
from robotmodels.common.yaml_files import FileSection
from robotmodels.description.ranges import NonNegative, Positive

Spectra = Literal["flat", "per_motor", "full"]


class PeriodNoise(FileSection):
    """Noise of one period, see `robotmodels.InputOutputNoise`."""

    torque: NonNegative = 0.05
    speed: Positive


class VisitDesignChoice(FileSection):
    """Minutes or targets, and which excitations there are."""

    minutes: Positive | None = None
    targets: Annotated[dict[str, Accuracy], Field(min_length=1)] | None = None
    criterion: Literal["D", "A", "E"] = "D"
    excitations: Annotated[
        tuple[Literal["orthogonal", "zippered", "random_phase"], ...], Field(min_length=1)
    ] = ("orthogonal", "zippered")
    spectra: Spectra = "flat"
    line_cap: Annotated[float, Field(ge=1, le=1e6)] = 3.0
    robust: RobustChoice | None = None
    curve: Annotated[tuple[Positive, ...], Field(max_length=20)] = ()

    @model_validator(mode="after")
    def _minutes_or_targets(self) -> Self:
        if self.minutes is None and self.targets is None:
            raise ValueError("neither minutes nor targets given; one of them is needed")
        if self.targets is not None and "criterion" in self.model_fields_set:
            raise ValueError("criterion: targets define one; leave out one of the two")
        return self


class VisitStudy(VisitSettings):
    """A study file of visits, ``schema: study/1``; paths in it are relative to the file."""

    schema_: Literal["study/1"] = Field(alias="schema")
    truth: str | None = None
    noise: PeriodNoise
    design: VisitDesignChoice


def load_visit_study(path: str | Path) -> VisitStudy:
    """Read a study of visits, see `read_settings`."""
    return read_settings(path, VisitStudy)
