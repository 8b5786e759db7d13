"""The stages of a study up to its plan: candidates, information, design."""

from dataclasses import dataclass
from pathlib import Path

from oed.candidates import candidate_positions
from oed.exact import ExactDesign, exact_design
from oed.information_set import InformationSet, information
from oed.relaxed import Design, optimal_design
from oed.stage_files import ARRAY, INFORMATION, dataclass_files
from oed.stages import Report, Stage
from oed.study_run import Run
from robotmodels.arrays import Array


@dataclass(frozen=True, eq=False)
class Plan:
    """Where to measure: the relaxed optimum, and whole experiments."""

    design: Design
    exact: ExactDesign


def candidates(run: Run) -> Stage[Array]:
    """Return the candidate positions, (Q, n)."""
    choice = run.study.candidates
    assert choice is not None  # the schema asks for them unless data were measured

    def compute(folder: Path, report: Report | None) -> Array:
        return candidate_positions(run.robot, choice.per_joint, choice.limits)

    inputs = {"robot": run.robot_digest, **run.settings("candidates")}
    return run.stages.run("candidates", inputs, compute, ARRAY)


def candidate_information(run: Run, positions: Stage[Array]) -> Stage[InformationSet]:
    """Return the information of an experiment in each candidate."""
    frequencies, noise = run.study.frequencies, run.study.noise
    assert frequencies is not None
    assert noise is not None

    def compute(folder: Path, report: Report | None) -> InformationSet:
        return information(
            run.robot,
            positions.value,
            omega=frequencies.omega(),
            noise=noise.law(),
            executor=run.executor,
            progress=report,
        )

    inputs = {
        "robot": run.robot_digest,
        "candidates": positions.digest,
        **run.settings("frequencies", "noise"),
    }
    return run.stages.run("information", inputs, compute, INFORMATION)


def plan(run: Run, info: Stage[InformationSet]) -> Stage[Plan]:
    """Return the design and the plan of whole experiments."""
    choice = run.study.design

    def compute(folder: Path, report: Report | None) -> Plan:
        design = optimal_design(info.value, choice.criterion, tolerance=choice.tolerance)
        return Plan(design, exact_design(info.value, choice.experiments, design=design))

    inputs = {"information": info.digest, **run.settings("design")}
    return run.stages.run("design", inputs, compute, dataclass_files(Plan))
