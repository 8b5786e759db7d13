"""The stage ``candidates``: the positions that the robot can take, and why others are left out."""

from pathlib import Path

from oed.candidates.screening import ScreenedCandidates
from oed.study.stage_cache import Stage, dataclass_files
from oed.study.stages.design_inputs import compares_shapes, gather
from oed.study.stages.run import SimulatedRun
from robotmodels.common.fingerprints import file_digest
from robotmodels.common.progress import Progress
from robotmodels.library.robot_digest import mesh_digests


def candidates(run: SimulatedRun) -> Stage[ScreenedCandidates]:
    """Return the candidate positions that the robot can take, and why others are left out."""
    choice = run.candidates

    def compute(folder: Path, report: Progress | None) -> ScreenedCandidates:
        return gather(choice, run.robot, report)

    inputs = {
        "robot": run.robot_digest,
        "files": [file_digest(file) for file in choice.files],
        "meshes": mesh_digests(run.robot) if compares_shapes(choice) else {},
        "candidates": choice.model_dump(mode="json", exclude={"files"}),
    }
    return run.stages.run("candidates", inputs, compute, dataclass_files(ScreenedCandidates))
