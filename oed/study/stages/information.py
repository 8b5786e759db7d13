"""The stage ``information``: what an experiment in each position tells of the parameters.

A robust design has a stage ``information-K`` more for each sample K of the parameters.
"""

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

import estimators
from estimators.fitting.run_problem import run_problem
from estimators.input_output.run_spectra import RunSpectra
from oed.candidates.screening import ScreenedCandidates
from oed.information_sets.compute import information as compute_information
from oed.information_sets.information_set import InformationSet
from oed.information_sets.stored_information import StoredInformation
from oed.study.stage_cache import Files, Stage
from oed.study.stages.assumed_springs import all_assumed
from oed.study.stages.data import Data
from oed.study.stages.design_inputs import parameter_samples
from oed.study.stages.run import MeasuredRun, SimulatedRun
from robotmodels import ElasticRobot, sensitivity, with_springs
from robotmodels.common.errors import InvalidInput, NoEquilibrium, naming
from robotmodels.common.progress import Progress
from robotmodels.linear.derived_models import WithParameters

Information = InformationSet | StoredInformation

LARGEST_IN_MEMORY = 256 * 2**20
"""Bytes of information matrices; more are stored in a file and read in chunks."""
_STORE = "information.store"
_STRUCTURE = "information-structure"

_IN_MEMORY: Files[InformationSet] = Files(
    save=lambda info, folder: info.save(folder / "information.h5"),
    load=lambda folder: InformationSet.load(folder / "information.h5"),
)


def information(run: SimulatedRun, screened: Stage[ScreenedCandidates]) -> Stage[Information]:
    """Return the information of an experiment in each candidate."""
    return _information(run, screened, "information", run.robot)


def sampled_information(
    run: SimulatedRun, screened: Stage[ScreenedCandidates]
) -> list[Stage[Information]]:
    """Return the same for the further samples of theta that a robust design asks for."""
    choice = run.study.design.robust
    if choice is None:
        return []
    positions = np.asarray(screened.value.positions)
    values = parameter_samples(choice, run.robot, positions, run.rng("robust"))
    return [
        _information(run, screened, f"information-{k}", WithParameters(run.robot, values[k]))
        for k in range(1, len(values))
    ]


def structure_information(
    run: SimulatedRun, screened: Stage[ScreenedCandidates]
) -> Stage[Information] | None:
    """Return the same of the parameters and of springs that a design is to tell apart, if any.

    Raises
    ------
    InvalidInput
        If the robot cannot have such a spring.
    """
    if not run.study.design.distinguish:
        return None
    springs = all_assumed(run.study.design, run.robot)
    with naming("design.distinguish"):
        robot = with_springs(run.robot, springs, free=True)
    choice, dampers = robot.file.parameters, [f"{spring.name}.damping" for spring in springs]
    choice = choice.model_copy(update={"fixed": [*choice.fixed, *dampers]})
    robot = ElasticRobot(robot.file.model_copy(update={"parameters": choice}), robot.folder)
    return _information(run, screened, _STRUCTURE, robot)


def _information(
    run: SimulatedRun,
    screened: Stage[ScreenedCandidates],
    name: str,
    robot: ElasticRobot | WithParameters,
) -> Stage[Information]:
    problem = robot, screened.value.positions, run.omega, run.noise

    def compute(folder: Path, report: Progress | None) -> InformationSet:
        with _naming_sample(robot is not run.robot, name):
            return compute_information(*problem, executor=run.executor, progress=report)

    def write(folder: Path, report: Progress | None) -> StoredInformation:
        store = folder / _STORE
        with _naming_sample(robot is not run.robot, name):
            return compute_information(
                *problem, executor=run.executor, progress=report, store=store
            )

    inputs = {
        "robot": run.robot_digest,
        "candidates": screened.digest,
        **run.settings("frequencies", "noise"),
        **({} if robot is run.robot else {"values": robot.parameters.values.tolist()}),
        **({"springs": _springs(run)} if name == _STRUCTURE else {}),
    }
    if len(screened.value) * len(robot.parameters) ** 2 * 8 > LARGEST_IN_MEMORY:
        return run.stages.run(name, inputs, write, _in_chunks(run.executor))
    return run.stages.run(name, inputs, compute, _IN_MEMORY)


def _in_chunks(executor: Executor | None) -> Files[StoredInformation]:
    """Return how a store is loaded; the computation writes it itself."""
    return Files(
        save=lambda info, folder: None,
        load=lambda folder: replace(StoredInformation.open(folder / _STORE), executor=executor),
    )


def _springs(run: SimulatedRun) -> list[dict[str, object]]:
    """Return the springs that a design is to tell apart."""
    return [spring.model_dump(mode="json") for spring in all_assumed(run.study.design, run.robot)]


@contextmanager
def _naming_sample(is_sample: bool, name: str) -> Iterator[None]:
    """Say of an error in a sample of theta that it is not the robot file's."""
    try:
        yield
    except NoEquilibrium as error:
        if not is_sample:
            raise
        if name == _STRUCTURE:
            raise InvalidInput(
                f"design.distinguish: {error}; stiffer springs are needed"
            ) from error
        number = name.rsplit("-", 1)[-1]
        raise InvalidInput(
            f"design.robust: sample {number} of the parameters: {error}; a smaller std is needed"
        ) from error


def measured_information(run: MeasuredRun, data: Stage[Data]) -> Stage[InformationSet]:
    """Return the information of one experiment in each measured position, at the robot's values."""

    def compute(folder: Path, report: Progress | None) -> InformationSet:
        estimate, names = data.value.estimate, run.robot.parameters.names
        if isinstance(estimate, RunSpectra):
            matrices = run_problem(run.robot, estimate).information(run.robot.parameters.values)
            return InformationSet(estimate.positions, matrices, names)
        _, slopes = sensitivity(run.robot, estimate.positions, estimate.omega)
        matrices = estimators.information(slopes, 1 / estimate.variance)
        repetitions = estimate.repetitions[:, None, None]
        return InformationSet(estimate.positions, matrices / repetitions, names)

    inputs = {"robot": run.robot_digest, "data": data.digest}
    return run.stages.run("information", inputs, compute, _IN_MEMORY)
