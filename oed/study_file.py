"""The schema of a study file: which robot, where it may be put, how well to measure and fit."""

import math
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt, model_validator

from oed.file_paths import output_folder, robot_reference
from robotmodels.arrays import Array
from robotmodels.files import Strict, read_yaml
from robotmodels.noise import RelativeNoise

Residual = Literal["nls", "lls", "lls_magnitude"]

MOST_CANDIDATES = 250_000
"""Their matrices stay in memory: 1.4 GB at 26 parameters."""


class Frequencies(Strict):
    """The frequency grid [Hz], ends included."""

    low: PositiveFloat
    high: PositiveFloat
    count: PositiveInt
    spacing: Literal["log", "linear"] = "log"

    @model_validator(mode="after")
    def _rising(self) -> Self:
        if self.high <= self.low:
            raise ValueError(f"high ({self.high:g} Hz) must be above low ({self.low:g} Hz)")
        return self

    def omega(self) -> Array:
        """Return the grid, (F,) [rad/s]."""
        space = np.geomspace if self.spacing == "log" else np.linspace
        return np.asarray(2 * math.pi * space(self.low, self.high, self.count))


class Noise(Strict):
    """The noise law of `RelativeNoise`: parts of the element and of the largest element [-]."""

    relative: NonNegativeFloat
    floor: NonNegativeFloat

    @model_validator(mode="after")
    def _positive(self) -> Self:
        if self.relative == 0 and self.floor == 0:
            raise ValueError("relative and floor are both zero; one must be positive")
        return self

    def law(self) -> RelativeNoise:
        """Return the noise law."""
        return RelativeNoise(relative=self.relative, floor=self.floor)


class Candidates(Strict):
    """A joint grid: points per joint (one where not named) and narrower limits [rad; m]."""

    per_joint: dict[str, PositiveInt] = Field(min_length=1)
    limits: dict[str, tuple[float, float]] = {}

    @model_validator(mode="after")
    def _not_too_many(self) -> Self:
        number = math.prod(self.per_joint.values())
        if number > MOST_CANDIDATES:
            raise ValueError(f"per_joint: {number} positions; at most {MOST_CANDIDATES} fit")
        return self


class DesignChoice(Strict):
    """The criterion, the number of experiments, and the certified gap to reach."""

    criterion: Literal["D"] = "D"
    experiments: PositiveInt = 15
    tolerance: PositiveFloat = 1e-6


class FitChoice(Strict):
    """Residuals to fit, each from the same starts, perturbed by 10^U(-decades, decades)."""

    residuals: Annotated[tuple[Residual, ...], Field(min_length=1)] = ("lls", "nls")
    decades: Annotated[float, Field(ge=0, lt=3)] = 0.3  # fits seek within three decades
    starts: PositiveInt = 4

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        if len(set(self.residuals)) < len(self.residuals):
            raise ValueError("residuals: each residual can be named once only")
        return self


class PosteriorChoice(Strict):
    """Independent ensembles of emcee walkers, and steps kept of each."""

    ensembles: Annotated[int, Field(ge=2)] = 4
    walkers: PositiveInt = 64
    steps: PositiveInt = 2000


class Study(Strict):
    """A study file, ``schema: study/1``; `robot` and `output` are relative to the file."""

    schema_: Literal["study/1"] = Field(alias="schema")
    robot: str
    seed: Annotated[int, Field(ge=0)] = 1
    frequencies: Frequencies
    noise: Noise
    candidates: Candidates
    design: DesignChoice = DesignChoice()
    fit: FitChoice = FitChoice()
    posterior: PosteriorChoice = PosteriorChoice()
    output: Path


def load_study(path: str | Path) -> Study:
    """Read a study file; the paths inside it become absolute.

    Raises
    ------
    InvalidInput : if the file is absent, is not YAML, or does not fit the schema; the key is named.
    """
    path = Path(path)
    study = read_yaml(path, Study)
    changed = {
        "output": output_folder(path, study.output),
        "robot": robot_reference(path, study.robot),
    }
    return study.model_copy(update=changed)
