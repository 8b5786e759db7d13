"""The schema of a campaign file: which robot, what is to be known how well, what it may cost.

schema: campaign/1
robot: ur10                  # a built-in robot, or the path of a robot file with guesses
guesses_within: 2.0          # factor that its values may be off by (one standard deviation), or
                             # robot: the standard deviations in the file's `guessed`, `fitted`
targets:                     # relative standard deviations; names may have * and ?
  "*.stiffness": 0.01
  "*.damping": 0.05
minutes: 30                  # robot time at most, moves included
candidates: {sobol: 512}     # positions to choose from, as in a study
multisine: {band: [1.0, 60.0], sample_time: 0.002, period: 2.0, detection: 4}
settle: 1.0                  # rest after each move [s]
transient_periods: 1         # before those measured
most_periods: 16             # measured in one visit
limits: {torque: 50.0, speed: 10.0}     # as in an experiment file, and so the next three
moves: {speed: 1.0, acceleration: 2.0}
carrier: {speed: 10.0}
friction: true               # whether levels of the motors' Coulomb friction are estimated along
controller: {...}
files: [csv]                 # for the controller: csv, mat, trajectory (JointTrajectory of ROS 2)
seed: 1
output: ../out/campaign      # folder; relative to this file, as every path in it
"""

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from oed.criteria.targets import by_name_or_kind
from oed.experiment.loop_settings import Format, LoopSettings
from oed.experiment.settings_files import read_settings
from oed.study.settings.candidates_settings import CandidatesChoice
from robotmodels.common.arrays import Array
from robotmodels.description.ranges import Count, NonNegative, Positive, Seed

Accuracy = Annotated[float, Field(gt=0, lt=1)]


class VisitSettings(LoopSettings):
    """What visits with planned spectra have in common, whoever asks for them."""

    robot: str
    candidates: CandidatesChoice = CandidatesChoice(sobol=512)
    settle: NonNegative = 1.0
    transient_periods: Count = 1
    most_periods: Annotated[int, Field(ge=2, le=10_000)] = 16
    files: Annotated[tuple[Format, ...], Field(min_length=1)] = ("csv",)
    seed: Seed = 1
    output: Path

    @model_validator(mode="after")
    def _spectra_are_planned(self) -> Self:
        if self.multisine.slope:
            raise ValueError("multisine.slope: spectra are planned; leave it out")
        return self

    @property
    def friction_factor(self) -> float:
        """One: visits are for robots, imperfections for rehearsals."""
        return 1.0

    @property
    def period_counts(self) -> list[int]:
        """Numbers of measured periods to choose from: powers of two, and the most."""
        most = self.most_periods
        return sorted({*(n for n in (1, 2, 4, 8, 16, 32, 64) if n < most), most})


class CampaignSettings(VisitSettings):
    """A campaign file, ``schema: campaign/1``; paths in it are relative to the file."""

    schema_: Literal["campaign/1"] = Field(alias="schema")
    guesses_within: Annotated[float, Field(gt=1, le=100)] | Literal["robot"] = 2.0
    targets: Annotated[dict[str, Accuracy], Field(min_length=1)]
    minutes: Positive
    friction: bool = True

    @model_validator(mode="after")
    def _planned(self) -> Self:
        if self.multisine.detection is None:
            raise ValueError("multisine.detection: missing; single runs show their noise there")
        return self

    def accuracies(self, names: tuple[str, ...]) -> Array:
        """Return the relative standard deviation asked for of each parameter, (p,).

        Infinite where none is asked for. Keys are names, kinds or patterns, see `by_name_or_kind`.

        Raises
        ------
        InvalidInput
            If a pattern fits no free parameter.
        """
        asked = by_name_or_kind(self.targets, names, "targets")
        return np.where(np.isnan(asked), np.inf, asked)


def load_campaign(path: str | Path) -> CampaignSettings:
    """Read a campaign file, see `read_settings`."""
    return read_settings(path, CampaignSettings)
