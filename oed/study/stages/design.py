"""The stage ``design``: the relaxed optimum, the plan of whole experiments, the order of visits.

Of measured data the positions are those of the data: what was measured stands for the plan, beside
the optimum over the same positions.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from oed.criteria.criteria import Criterion, named_criterion, objective_of
from oed.criteria.robust_criteria import AverageCriterion, MaximinCriterion
from oed.design.certificate import efficiency_bound
from oed.design.constraints import Constraints
from oed.design.design import Design
from oed.design.optimal_design import optimal_design
from oed.design.robust_design import RobustDesign, robust_design
from oed.exact.exact_design import ExactDesign, exact_design
from oed.experiment.visiting_order import VisitingOrder, visiting_order
from oed.information_sets.candidates import InformationSamples
from oed.information_sets.information_set import InformationSet
from oed.study.settings.design_settings import DesignChoice, Moves
from oed.study.stage_cache import Stage, dataclass_files
from oed.study.stages.data import Data
from oed.study.stages.design_inputs import (
    constraints_of,
    criterion_of,
    home_position,
    move_limits,
)
from oed.study.stages.information import Information
from oed.study.stages.run import MeasuredRun, SimulatedRun, Visits
from robotmodels.common.arrays import Array, IntArray, read_only
from robotmodels.common.progress import Progress


@dataclass(frozen=True, eq=False)
class StudyDesign:
    """Where to measure.

    Attributes
    ----------
    design : Design
        Relaxed optimum.
    exact : ExactDesign
        Plan of whole experiments.
    robust : RobustDesign or None
        Efficiency of the design at each sample of theta; None where it is for one theta.
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
        if self.order is None:
            return self.exact.support
        return np.asarray(self.exact.support[self.order.order])


def design(
    run: SimulatedRun, info: Stage[Information], sampled: Sequence[Stage[Information]] = ()
) -> Stage[StudyDesign]:
    """Return the design, the plan of whole experiments and the order of its positions.

    `info` is that of the parameters, and of springs to tell apart where there are any.
    """
    choice = run.study.design

    def compute(folder: Path, report: Progress | None) -> StudyDesign:
        positions = np.asarray(info.value.positions)
        constraints = constraints_of(choice, run.robot, positions)
        criterion = criterion_of(choice, run.robot)
        if choice.robust is None:
            plan = _for_one(choice, criterion, info.value, constraints)
        else:
            sets = (info.value, *(stage.value for stage in sampled))
            plan = _for_all(choice, criterion, InformationSamples(sets), constraints)
        return replace(plan, order=_order(run, positions, plan.exact))

    inputs = {
        "information": info.digest,
        "samples": [stage.digest for stage in sampled],
        "robot": run.robot_digest,  # names and ranges of its joints
        "number": choice.number,  # whether experiments are counted; a default leaves no trace
        **run.settings("design"),
    }
    return run.stages.run("design", inputs, compute, dataclass_files(StudyDesign))


def visits(info: Stage[Information], plan: Stage[StudyDesign]) -> Visits:
    """Return the positions that a plan visits, in the order of visits."""
    used = plan.value.used
    key = {"information": info.digest, "design": plan.digest, "visits": used.tolist()}
    return Visits(info.value.positions[used], plan.value.exact.repetitions[used], key)


def _for_one(
    choice: DesignChoice,
    criterion: str | Criterion,
    info: Information,
    constraints: Constraints | None,
) -> StudyDesign:
    """Return the plan that is best at the robot file's values."""
    relaxed = optimal_design(
        info, criterion, constraints, tolerance=choice.tolerance, solver=choice.solver
    )
    number = _number(choice, constraints)
    exact = exact_design(info, number, relaxed, criterion=criterion, constraints=constraints)
    return StudyDesign(relaxed, exact)


def _for_all(
    choice: DesignChoice,
    criterion: str | Criterion,
    samples: InformationSamples,
    constraints: Constraints | None,
) -> StudyDesign:
    """Return the plan that holds for samples of theta."""
    assert choice.robust is not None
    kind = choice.robust.kind
    robust = robust_design(
        samples,
        criterion,
        kind,
        constraints=constraints,
        tolerance=choice.tolerance,
        solver=choice.solver,
    )
    of_samples: Criterion = AverageCriterion(criterion)
    if kind == "maximin":
        base = objective_of(criterion, samples.names)
        values = np.array([base.log_value(matrix) for matrix in robust.design.information])
        of_samples = MaximinCriterion(criterion, (values - np.log(robust.efficiency)).tolist())
    number = _number(choice, constraints)
    exact = exact_design(
        samples, number, robust.design, criterion=of_samples, constraints=constraints
    )
    return StudyDesign(robust.design, exact, robust)


def _number(choice: DesignChoice, constraints: Constraints | None) -> int | None:
    """Return how many experiments, where the constraints do not say so themselves."""
    return choice.experiments if constraints is None else None


def _order(run: SimulatedRun, positions: Array, exact: ExactDesign) -> VisitingOrder | None:
    """Return in which order to visit the plan's positions; None where no moves are asked for."""
    choice = run.study.design
    if choice.moves is None and choice.time is None:
        return None
    moves = choice.moves or Moves()
    home = home_position(moves, run.robot, positions)
    visited = np.asarray(positions[exact.support])
    return visiting_order(visited, move_limits(moves, run.robot), home, back=True)


def measured_design(
    run: MeasuredRun, info: Stage[InformationSet], data: Stage[Data]
) -> Stage[StudyDesign]:
    """Return what was measured as a plan, beside the optimum over the positions measured."""
    choice = run.study.design

    def compute(folder: Path, report: Progress | None) -> StudyDesign:
        relaxed = optimal_design(info.value, tolerance=choice.tolerance, solver=choice.solver)
        counts = data.value.repetitions
        total = np.tensordot(counts, info.value.matrices, axes=1)
        value = named_criterion("D").value(total / counts.sum())
        best = named_criterion("D").value(relaxed.information)
        ratio = float(np.exp((value - best) / len(info.value.names)))
        exact = ExactDesign(
            repetitions=read_only(np.array(counts)),
            efficiency=min(1.0, ratio * efficiency_bound(relaxed.gap)),
            value=value,
            support=read_only(np.arange(len(counts))),
            information=read_only(total),
            names=info.value.names,
        )
        return StudyDesign(relaxed, exact)

    inputs = {"information": info.digest, "data": data.digest, **run.settings("design")}
    return run.stages.run("design", inputs, compute, dataclass_files(StudyDesign))
