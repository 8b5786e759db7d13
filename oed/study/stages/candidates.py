"""The stage ``candidates``: feasible positions, and the reasons for removing others."""

from concurrent.futures import Executor
from pathlib import Path

import numpy as np

from oed.candidates.screening import ScreenedCandidates, reasons
from oed.candidates.sources import Workcell, gathered_candidates
from oed.candidates.task_space import TaskBox
from oed.study.settings.candidates_settings import CandidatesChoice
from oed.study.stage_cache import Stage, dataclass_files
from oed.study.stages.run import SimulatedRun
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.common.fingerprints import file_digest
from robotmodels.common.progress import Progress
from robotmodels.library.robot_digest import mesh_digests


def candidates(run: SimulatedRun) -> Stage[ScreenedCandidates]:
    """Return the feasible candidate positions, and the reasons for removing others."""
    choice = run.candidates

    def compute(folder: Path, report: Progress | None) -> ScreenedCandidates:
        return gather(choice, run.robot, report, run.executor)

    inputs = {
        "robot": run.robot_digest,
        "files": [file_digest(file) for file in choice.files],
        "meshes": mesh_digests(run.robot) if compares_shapes(choice) else {},
        "candidates": choice.model_dump(mode="json", exclude={"files"}),
    }
    return run.stages.run("candidates", inputs, compute, dataclass_files(ScreenedCandidates))


def refusals(
    settings: CandidatesChoice, robot: ElasticRobot, screened: ScreenedCandidates, most: int = 100
) -> tuple[Array, list[str]]:
    """Return some of the positions that `robot` cannot take, (R, n), and why, evenly chosen."""
    everywhere = gather(settings, robot, obstructed=False).positions
    accepted = {position.tobytes() for position in screened.positions}
    refused = np.array([p for p in everywhere if p.tobytes() not in accepted])
    shown = refused[:: max(-(-len(refused) // most), 1)].reshape(-1, len(robot.motor_names))
    cell = workcell(settings)
    surroundings = cell.surroundings(robot)
    words = [reasons(robot, p, surroundings, torque_limits=cell.torque_limits) for p in shown]
    return shown, ["; ".join(one) for one in words]


def gather(
    settings: CandidatesChoice,
    robot: ElasticRobot,
    progress: Progress | None = None,
    executor: Executor | None = None,
    *,
    obstructed: bool = True,
) -> ScreenedCandidates:
    """Return the candidates that `robot` can take, with nothing in its way if not `obstructed`.

    Raises
    ------
    InvalidInput
        As `oed.candidates.sources.gathered_candidates`, naming the key of the study file.
    """
    try:
        return gathered_candidates(
            robot,
            per_joint=settings.per_joint,
            limits=settings.limits,
            sobol=settings.sobol or 0,
            boxes=[TaskBox(**box.model_dump()) for box in settings.boxes],
            files=settings.files,
            listed=settings.positions,
            workcell=workcell(settings) if obstructed else Workcell(self_collision=False),
            progress=progress,
            executor=executor,
        )
    except InvalidInput as error:
        # Of arguments that are this section's keys; files are named by their paths.
        message = str(error).replace("torque_limits", "torque", 1)
        section = "candidates." if message.startswith(tuple(CandidatesChoice.model_fields)) else ""
        raise InvalidInput(section + message) from error


def workcell(settings: CandidatesChoice) -> Workcell:
    """Return what keeps a robot from a position."""
    return Workcell(
        floor=settings.floor,
        obstacles=settings.things,
        self_collision=settings.compares_links,
        link_radius=settings.link_radius,
        margin=settings.margin,
        ignored=settings.ignored,
        torque_limits=settings.torque,
    )


def compares_shapes(settings: CandidatesChoice) -> bool:
    """Return whether collisions are checked, with the shapes and meshes of the URDF."""
    return settings.compares_links or settings.has_surroundings
