"""What was measured as a plan: the stages that stand for a design where data come from files."""

from pathlib import Path

import numpy as np

import estimators
from oed.criteria.criteria import named_criterion
from oed.design.certificate import efficiency_bound
from oed.design.optimal_design import optimal_design
from oed.exact.exact_design import ExactDesign
from oed.information_sets.information_set import InformationSet
from oed.study.stages.context import Run
from oed.study.stages.data_stages import Data
from oed.study.stages.design_stages import Plan
from oed.study.stages.serialisation import INFORMATION, dataclass_files
from oed.study.stages.stage_cache import Stage
from robotmodels import sensitivity
from robotmodels.common.arrays import read_only
from robotmodels.common.progress import Progress


def measured_information(run: Run, data: Stage[Data]) -> Stage[InformationSet]:
    """Return the information of one experiment in each measured position, at the robot's values."""

    def compute(folder: Path, report: Progress | None) -> InformationSet:
        estimate = data.value.estimate
        _, slopes = sensitivity(run.robot, estimate.positions, estimate.omega)
        matrices = estimators.information(slopes, 1 / estimate.variance)
        repetitions = estimate.repetitions[:, None, None]
        names = run.robot.parameters.names
        return InformationSet(estimate.positions, matrices / repetitions, names)

    inputs = {"robot": run.robot_digest, "data": data.digest}
    return run.stages.run("information", inputs, compute, INFORMATION)


def measured_plan(run: Run, info: Stage[InformationSet], data: Stage[Data]) -> Stage[Plan]:
    """Return what was measured as a plan, beside the optimum over the positions measured."""
    choice = run.study.design

    def compute(folder: Path, report: Progress | None) -> Plan:
        design = optimal_design(info.value, tolerance=choice.tolerance, solver=choice.solver)
        counts = data.value.estimate.repetitions
        total = np.tensordot(counts, info.value.matrices, axes=1)
        value = named_criterion("D").value(total / counts.sum())
        best = named_criterion("D").value(design.information)
        ratio = float(np.exp((value - best) / len(info.value.names)))
        exact = ExactDesign(
            repetitions=read_only(np.array(counts)),
            efficiency=min(1.0, ratio * efficiency_bound(design.gap)),
            value=value,
            support=read_only(np.arange(len(counts))),
            information=read_only(total),
            names=info.value.names,
        )
        return Plan(design, exact)

    inputs = {"information": info.digest, "data": data.digest, **run.settings("design")}
    return run.stages.run("design", inputs, compute, dataclass_files(Plan))
