"""A study under way: settings, robots, random numbers and the stages that are finished."""

import math
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from estimators.fitting.fitted_robot import robot_prior
from estimators.fitting.multistart import perturbed_starts
from estimators.fitting.priors import Prior
from estimators.frf.file_formats import read_records
from oed.study.settings.candidates_settings import CandidatesChoice
from oed.study.settings.study_file import Frequencies, Study
from oed.study.stage_cache import Beside, Stages, open_stages
from robotmodels import ElasticRobot, at_recorded_speeds, load_robot, with_speeds
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput, naming
from robotmodels.common.progress import StageProgress
from robotmodels.library.robot_digest import robot_digest
from robotmodels.linear.noise import RelativeNoise

T = TypeVar("T")

STREAMS = (
    "data",
    "starts",
    "posterior",
    "validation",
    "held out",
    "importance",
    "robust",
    "comparison",
    "time domain",
    "cost-posterior",
    "local minima",
)
"""Independent random numbers; a new one goes to the end, lest the others change.

"time domain" and "local minima" are those of `oed.replication`."""


@dataclass(frozen=True, eq=False)
class Run:
    """A study under way, wherever its data come from.

    Attributes
    ----------
    study : Study
        Its settings.
    robot : ElasticRobot
        Robot whose parameters are free.
    stages : Stages
        Folder of the stages' results.
    executor : Executor or None
        Executor for parallel work.
    """

    study: Study
    robot: ElasticRobot
    stages: Stages
    executor: Executor | None

    def rng(self, stream: str) -> np.random.Generator:
        """Return a generator of random numbers that depends on the seed and the stream only."""
        streams = np.random.default_rng(self.study.seed).spawn(len(STREAMS))
        return streams[STREAMS.index(stream)]

    def settings(self, *keys: str) -> dict[str, Any]:
        """Return sections of the study as plain data, for the key of a stage."""
        content = self.study.model_dump(mode="json", by_alias=True)
        return {key: content[key] for key in keys}

    @cached_property
    def robot_digest(self) -> str:
        """Content of the robot file."""
        return robot_digest(self.robot)

    def beside(self, name: str, compute: Callable[[], T]) -> AbstractContextManager[Beside[T]]:
        """Give a stage that other processes compute meanwhile, see `Stages.beside`."""
        return self.stages.beside(name, compute, at_once=self.executor is not None)

    @cached_property
    def starts(self) -> Array:
        """Starts of searches, (N, p), SI, the same for every estimator, so that they compare."""
        choice = self.study.fit
        rng = self.rng("starts")
        return perturbed_starts(self.robot.parameters, choice.starts, choice.decades, rng)

    @cached_property
    def prior(self) -> Prior | None:
        """Prior that the study asks for.

        Raises
        ------
        InvalidInput
            If its robot file holds none.
        """
        return robot_prior(self.robot) if self.study.fit.prior == "robot" else None

    @property
    def prior_key(self) -> dict[str, Any]:
        """Plain data that stand for the prior in the keys of stages; nothing without one."""
        if self.prior is None:
            return {}
        key = {"prior": dict(zip(self.prior.names, self.prior.std.tolist(), strict=True))}
        if self.prior.correlation is None:
            return key
        return {**key, "prior correlation": self.prior.correlation.tolist()}


@dataclass(frozen=True, eq=False)
class SimulatedRun(Run):
    """A study that chooses its positions and simulates its data.

    Attributes
    ----------
    plant : ElasticRobot
        Robot that is simulated; the same unless the study names a truth.
    candidates : CandidatesChoice
        Positions to choose from.
    omega : ndarray, (F,), rad/s
        Angular frequencies of the design, and of data simulated by the noise law.
    noise : RelativeNoise
        Noise law of the design, and of data simulated by it.
    """

    plant: ElasticRobot
    candidates: CandidatesChoice
    omega: Array
    noise: RelativeNoise

    @cached_property
    def plant_digest(self) -> str:
        """Content of the robot file behind simulated data."""
        return self.robot_digest if self.plant is self.robot else robot_digest(self.plant)


@dataclass(frozen=True, eq=False)
class MeasuredRun(Run):
    """A study of measured data.

    Attributes
    ----------
    file : Path
        File of the data.
    content : {"records", "frf"}
        Kind of data in it.
    """

    file: Path
    content: Literal["records", "frf"]


@dataclass(frozen=True, eq=False)
class Visits:
    """Positions in the order in which a plan visits them.

    Attributes
    ----------
    positions : ndarray, (Q, n)
        Positions.
    repetitions : ndarray of int, (Q,)
        Visits to each.
    key : dict of str to Any
        Plain data that stand for them in the keys of stages.
    """

    positions: Array
    repetitions: IntArray
    key: dict[str, Any]


@contextmanager
def open_run(
    study: Study,
    progress: StageProgress | None = None,
    executor: Executor | None = None,
    fresh: bool = False,
) -> Iterator[SimulatedRun | MeasuredRun]:
    """Give the run of a study, whose folder of stages no other process can use meanwhile.

    Parameters
    ----------
    progress : StageProgress, optional
        Told how far each stage is.
    executor : Executor, optional
        Runs parallel work.
    fresh : bool
        Compute every stage again.

    Raises
    ------
    InvalidInput
        If the robot or the folder cannot be used, or a setting is missing that simulated data need.
    """
    robot = _counted(load_robot(study.robot), study)
    plant = robot if study.truth is None else _counted(load_robot(study.truth), study)
    with open_stages(study.output / "stages", progress, fresh) as stages:
        yield _run(study, robot, plant, stages, executor)


def _counted(robot: ElasticRobot, study: Study) -> ElasticRobot:
    """Return the robot whose Coulomb friction counts as dampers at the speeds of the study."""
    speeds, records = study.data.coulomb_speeds, study.data.records
    if isinstance(speeds, tuple):
        with naming("data.coulomb_speeds"):
            return with_speeds(robot, np.array(speeds))
    if speeds == "data" and records is not None:
        with naming(records):
            return at_recorded_speeds(robot, read_records(records))
    return robot


def _run(
    study: Study,
    robot: ElasticRobot,
    plant: ElasticRobot,
    stages: Stages,
    executor: Executor | None,
) -> SimulatedRun | MeasuredRun:
    if study.data.records is not None:
        return MeasuredRun(study, robot, stages, executor, study.data.records, "records")
    if study.data.frf is not None:
        return MeasuredRun(study, robot, stages, executor, study.data.frf, "frf")
    candidates, frequencies, noise = study.candidates, study.frequencies, study.noise
    # The schema asks for them; a copy of a study with changes is not checked by it.
    if candidates is None or frequencies is None or noise is None:
        raise InvalidInput(
            "study: candidates, frequencies and noise are needed where data are simulated"
        )
    omega = frequency_grid(frequencies)
    mixed = len(set(robot.output_units)) > 1
    law = RelativeNoise(relative=noise.relative, floor=noise.floor, by_output=mixed)
    return SimulatedRun(study, robot, stages, executor, plant, candidates, omega, law)


def frequency_grid(choice: Frequencies) -> Array:
    """Return the angular frequencies, ends included, (F,) [rad/s]."""
    space = np.geomspace if choice.spacing == "log" else np.linspace
    return np.asarray(2 * math.pi * space(choice.low, choice.high, choice.count))
