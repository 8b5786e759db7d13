"""The stages of a study up to its plan: candidates, information, design."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from oed.candidates.screening import ScreenedCandidates
from oed.criteria.criteria import Criterion, objective_of
from oed.criteria.robust_criteria import AverageCriterion, MaximinCriterion
from oed.design.constraints import Constraints
from oed.design.design import Design
from oed.design.optimal_design import optimal_design
from oed.design.robust_design import RobustDesign, robust_design
from oed.exact.exact_design import ExactDesign, exact_design
from oed.experiment.visiting_order import VisitingOrder, visiting_order
from oed.information_sets.candidates import InformationSamples
from oed.information_sets.compute import information
from oed.information_sets.information_set import InformationSet
from oed.information_sets.stored_information import StoredInformation
from oed.study.settings.design_settings import DesignChoice, Moves
from oed.study.stages.context import Run
from oed.study.stages.design_inputs import (
    compares_shapes,
    constraints_of,
    criterion_of,
    gather,
    home_position,
    move_limits,
    parameter_samples,
)
from oed.study.stages.serialisation import INFORMATION, STORE, STORED, dataclass_files
from oed.study.stages.stage_cache import Stage
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput, NoEquilibrium
from robotmodels.common.fingerprints import file_digest
from robotmodels.common.progress import Progress
from robotmodels.library.robot_digest import mesh_digests
from robotmodels.linear.derived_models import WithParameters

Information = InformationSet | StoredInformation

LARGEST_IN_MEMORY = 256 * 2**20
"""Bytes of information matrices; more are kept in a file and read in chunks."""


@dataclass(frozen=True, eq=False)
class Plan:
    """Where to measure.

    Attributes
    ----------
    design : Design
        Relaxed optimum.
    exact : ExactDesign
        Plan of whole experiments.
    robust : RobustDesign or None
        What the design keeps at each sample of theta; None where it is for one theta.
    order : VisitingOrder or None
        Order of the positions of `exact.support`; None where the study says nothing of moves.
    """

    design: Design
    exact: ExactDesign
    robust: RobustDesign | None = None
    order: VisitingOrder | None = None

    @property
    def used(self) -> IntArray:
        """Indices of the candidates that are measured in, in the order of visits."""
        return visited(self.exact, self.order)


def visited(exact: ExactDesign, order: VisitingOrder | None) -> IntArray:
    """Return the candidates that a plan measures in, in the order of visits where there is one."""
    return exact.support if order is None else np.asarray(exact.support[order.order])


def candidates(run: Run) -> Stage[ScreenedCandidates]:
    """Return the candidate positions that the robot can take, and why others are left out."""
    choice = run.study.candidates
    assert choice is not None  # the schema asks for them unless data were measured

    def compute(folder: Path, report: Progress | None) -> ScreenedCandidates:
        return gather(choice, run.robot, report)

    inputs = {
        "robot": run.robot_digest,
        "files": [file_digest(file) for file in choice.files],
        "meshes": mesh_digests(run.robot) if compares_shapes(choice) else {},
        "candidates": choice.model_dump(mode="json", exclude={"files"}),
    }
    return run.stages.run("candidates", inputs, compute, dataclass_files(ScreenedCandidates))


def candidate_information(run: Run, found: Stage[ScreenedCandidates]) -> Stage[Information]:
    """Return the information of an experiment in each candidate."""
    return _information(run, found, "information", run.robot)


def sampled_information(run: Run, found: Stage[ScreenedCandidates]) -> list[Stage[Information]]:
    """Return the same for the further samples of theta that a robust design asks for."""
    choice = run.study.design.robust
    if choice is None:
        return []
    values = parameter_samples(choice, run.robot, run.rng("robust"))
    return [
        _information(run, found, f"information-{k}", WithParameters(run.robot, values[k]))
        for k in range(1, len(values))
    ]


def _information(
    run: Run, found: Stage[ScreenedCandidates], name: str, robot: ElasticRobot | WithParameters
) -> Stage[Information]:
    asked = robot, found.value.positions, run.omega, run.noise

    def compute(folder: Path, report: Progress | None) -> InformationSet:
        with _of_sample(robot is not run.robot, name):
            return information(*asked, executor=run.executor, progress=report)

    def write(folder: Path, report: Progress | None) -> StoredInformation:
        store = folder / STORE
        with _of_sample(robot is not run.robot, name):
            return information(*asked, executor=run.executor, progress=report, store=store)

    inputs = {
        "robot": run.robot_digest,
        "candidates": found.digest,
        **run.settings("frequencies", "noise"),
        **({} if robot is run.robot else {"values": robot.parameters.values.tolist()}),
    }
    if len(found.value) * len(robot.parameters) ** 2 * 8 > LARGEST_IN_MEMORY:
        return run.stages.run(name, inputs, write, STORED)
    return run.stages.run(name, inputs, compute, INFORMATION)


@contextmanager
def _of_sample(is_one: bool, name: str) -> Iterator[None]:
    """Say of an error in a sample of theta that it is not the robot file's."""
    try:
        yield
    except NoEquilibrium as error:
        if not is_one:
            raise
        number = name.rsplit("-", 1)[-1]
        raise InvalidInput(
            f"design.robust: sample {number} of the parameters: {error}; a smaller std is needed"
        ) from error


def plan(
    run: Run, info: Stage[Information], sampled: Sequence[Stage[Information]] = ()
) -> Stage[Plan]:
    """Return the design, the plan of whole experiments and the order of its positions."""
    choice = run.study.design

    def compute(folder: Path, report: Progress | None) -> Plan:
        positions = np.asarray(info.value.positions)
        constraints = constraints_of(choice, run.robot, positions)
        if choice.robust is None:
            found = _for_one(choice, info.value, constraints)
        else:
            sets = (info.value, *(stage.value for stage in sampled))
            found = _for_all(choice, choice.robust.kind, InformationSamples(sets), constraints)
        return replace(found, order=_order(run, positions, found.exact))

    inputs = {
        "information": info.digest,
        "samples": [stage.digest for stage in sampled],
        "robot": run.robot_digest,  # names and ranges of its joints
        "number": choice.number,  # whether experiments are counted; a default leaves no trace
        **run.settings("design"),
    }
    return run.stages.run("design", inputs, compute, dataclass_files(Plan))


def _for_one(choice: DesignChoice, info: Information, constraints: Constraints | None) -> Plan:
    """Return the plan that is best at the robot file's values."""
    criterion = criterion_of(choice)
    design = optimal_design(
        info, criterion, constraints, tolerance=choice.tolerance, solver=choice.solver
    )
    number = _number(choice, constraints)
    exact = exact_design(info, number, design, criterion=criterion, constraints=constraints)
    return Plan(design, exact)


def _for_all(
    choice: DesignChoice, kind: str, samples: InformationSamples, constraints: Constraints | None
) -> Plan:
    """Return the plan that holds for samples of theta."""
    nominal = criterion_of(choice)
    robust = robust_design(
        samples,
        nominal,
        kind,
        constraints=constraints,
        tolerance=choice.tolerance,
        solver=choice.solver,
    )
    criterion: Criterion = AverageCriterion(nominal)
    if kind == "maximin":
        base = objective_of(nominal, samples.names)
        values = np.array([base.log_value(matrix) for matrix in robust.design.information])
        criterion = MaximinCriterion(nominal, (values - np.log(robust.efficiency)).tolist())
    number = _number(choice, constraints)
    exact = exact_design(
        samples, number, robust.design, criterion=criterion, constraints=constraints
    )
    return Plan(robust.design, exact, robust)


def _number(choice: DesignChoice, constraints: Constraints | None) -> int | None:
    """Return how many experiments, where the constraints do not say so themselves."""
    return choice.experiments if constraints is None else None


def _order(run: Run, positions: Array, exact: ExactDesign) -> VisitingOrder | None:
    """Return in which order to visit the plan's positions; None where no moves are asked for."""
    choice = run.study.design
    if choice.moves is None and choice.time is None:
        return None
    moves = choice.moves or Moves()
    home = home_position(moves, run.robot, positions)
    visited_positions = np.asarray(positions[exact.support])
    return visiting_order(visited_positions, move_limits(moves, run.robot), home, back=True)
