"""The stages of a study up to its plan: candidates, information, design."""

from dataclasses import dataclass
from pathlib import Path

from oed.candidates.screening import ScreenedCandidates
from oed.design.relaxed import Design, optimal_design
from oed.information_set import InformationSet, information
from oed.plans.exact import ExactDesign, exact_design
from oed.study.fingerprint import file_digest
from oed.study.run import Run
from oed.study.stage_files import INFORMATION, dataclass_files
from oed.study.stages import Report, Stage


@dataclass(frozen=True, eq=False)
class Plan:
    """Where to measure: the relaxed optimum, and whole experiments."""

    design: Design
    exact: ExactDesign


def candidates(run: Run) -> Stage[ScreenedCandidates]:
    """Return the candidate positions that the robot can take, and why others are left out."""
    choice = run.study.candidates
    assert choice is not None  # the schema asks for them unless data were measured

    def compute(folder: Path, report: Report | None) -> ScreenedCandidates:
        return choice.gathered(run.robot, report)

    inputs = {
        "robot": run.robot_digest,
        "files": [file_digest(file) for file in choice.files],
        "candidates": choice.model_dump(mode="json", exclude={"files"}),
    }
    return run.stages.run("candidates", inputs, compute, dataclass_files(ScreenedCandidates))


def candidate_information(run: Run, found: Stage[ScreenedCandidates]) -> Stage[InformationSet]:
    """Return the information of an experiment in each candidate."""
    frequencies, noise = run.study.frequencies, run.study.noise
    assert frequencies is not None
    assert noise is not None

    def compute(folder: Path, report: Report | None) -> InformationSet:
        return information(
            run.robot,
            found.value.positions,
            omega=frequencies.omega(),
            noise=noise.law(),
            executor=run.executor,
            progress=report,
        )

    inputs = {
        "robot": run.robot_digest,
        "candidates": found.digest,
        **run.settings("frequencies", "noise"),
    }
    return run.stages.run("information", inputs, compute, INFORMATION)


def plan(run: Run, info: Stage[InformationSet]) -> Stage[Plan]:
    """Return the design and the plan of whole experiments."""
    choice = run.study.design

    def compute(folder: Path, report: Report | None) -> Plan:
        design = optimal_design(
            info.value,
            choice.wanted(),
            choice.constraints(),
            tolerance=choice.tolerance,
            solver=choice.solver,
        )
        exact = exact_design(
            info.value,
            choice.experiments,
            design,
            criterion=choice.wanted(),
            constraints=choice.constraints(),
        )
        return Plan(design, exact)

    inputs = {"information": info.digest, **run.settings("design")}
    return run.stages.run("design", inputs, compute, dataclass_files(Plan))
