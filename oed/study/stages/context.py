"""What every stage of a study is given: settings, robots, random numbers, earlier stages."""

import math
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from oed.study.settings.study_file import Frequencies, Study
from oed.study.stages.stage_cache import Stages
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array
from robotmodels.library.robot_digest import robot_digest
from robotmodels.linear.noise import RelativeNoise

STREAMS = (
    "data",
    "starts",
    "posterior",
    "validation",
    "held out",
    "importance",
    "robust",
    "comparison",
    "rival",
    "own-cost",
)
"""Independent random numbers; a new one goes to the end, lest the others change.

"rival" is that of `oed.replication`."""


@dataclass(frozen=True, eq=False)
class Run:
    """A study under way.

    Attributes
    ----------
    study : Study
        Its settings.
    robot : ElasticRobot
        Robot whose parameters are free.
    plant : ElasticRobot
        Plant that the data are simulated with; the same robot unless the study names a truth.
    stages : Stages
        Where results are kept.
    executor : Executor or None
        Executor for parallel work.
    """

    study: Study
    robot: ElasticRobot
    plant: ElasticRobot
    stages: Stages
    executor: Executor | None = None

    def rng(self, stream: str) -> np.random.Generator:
        """Return a generator of random numbers that depends on the seed and the stream only."""
        streams = np.random.default_rng(self.study.seed).spawn(len(STREAMS))
        return streams[STREAMS.index(stream)]

    @property
    def omega(self) -> Array:
        """Angular frequencies of the design, (F,) [rad/s]; only where data are simulated."""
        assert self.study.frequencies is not None  # the schema asks for them
        return frequency_grid(self.study.frequencies)

    @property
    def noise(self) -> RelativeNoise:
        """The noise law of the design; only where data are simulated."""
        law = self.study.noise
        assert law is not None  # the schema asks for it
        return RelativeNoise(relative=law.relative, floor=law.floor)

    def settings(self, *keys: str) -> dict[str, Any]:
        """Return sections of the study as plain data, for the key of a stage."""
        content = self.study.model_dump(mode="json", by_alias=True)
        return {key: content[key] for key in keys}

    @cached_property
    def robot_digest(self) -> str:
        """Content of the robot file."""
        return robot_digest(self.robot)

    @cached_property
    def plant_digest(self) -> str:
        """Content of the robot file behind simulated data."""
        return self.robot_digest if self.plant is self.robot else robot_digest(self.plant)


def frequency_grid(choice: Frequencies) -> Array:
    """Return the angular frequencies, ends included, (F,) [rad/s]."""
    space = np.geomspace if choice.spacing == "log" else np.linspace
    return np.asarray(2 * math.pi * space(choice.low, choice.high, choice.count))


def truth_of(robot: ElasticRobot, plant: ElasticRobot | None) -> Array:
    """Return the plant's values of the robot's parameters, (p,) SI; NaN where it has none."""
    values = np.full(len(robot.parameters), np.nan)
    if plant is not None:
        known = plant.parameters
        for i, name in enumerate(robot.parameters.names):
            if name in known.names:
                values[i] = known.values[known.index(name)]
    return values
