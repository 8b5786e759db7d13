"""What a study of visits says of positions and parameters, checked."""

from functools import partial

import numpy as np

from oed.campaign.swing_room import with_room
from oed.campaign.visit_plan import usable_positions
from oed.campaign.visit_planner import VisitPlanner
from oed.experiment.workcell_settings import surroundings_of
from oed.study.stages.candidates import gather
from oed.study.stages.design_inputs import parameter_samples
from oed.visit_study.study_file import VisitStudy
from robotmodels import ElasticRobot
from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import StageProgress
from robotmodels.linear.derived_models import WithParameters
from robotmodels.linear.response import Elastic


def check_known(study: VisitStudy, robot: ElasticRobot) -> None:
    """Refuse spectra that would be designed at values that no fit has confirmed."""
    design = study.design
    if design.spectra == "flat" or design.robust is not None:
        return
    fitted = robot.file.fitted.relative_std if robot.file.fitted else {}
    unknown = [name for name in robot.parameters.names if name not in fitted]
    if unknown:
        more = f" and {len(unknown) - 1} more" if len(unknown) > 1 else ""
        raise InvalidInput(
            f"design.spectra: {design.spectra}: the robot file has no fitted value of {unknown[0]}"
            f"{more}, and spectra designed at guesses and kept lose most of their gain; "
            "plan flat ones first and fit, or say robust, which averages over samples"
        )


def planner_of(
    study: VisitStudy, robot: ElasticRobot, progress: StageProgress | None = None
) -> VisitPlanner:
    """Return the planner of visits to the candidates that have room for them.

    Raises
    ------
    InvalidInput
        Naming what leaves no candidate.
    """
    choice = study.candidates
    around = surroundings_of(choice, robot)
    if not robot.network(robot.position_limits.mean(axis=1)[None]).only_motors:
        raise InvalidInput(
            f"noise: it is that of motors' motion, and robot {robot.name!r} measures other "
            "outputs; plan visits with a robot file without them"
        )
    screened = gather(choice, robot, progress and partial(progress, "candidates"))
    roomy = with_room(screened, study, robot, around).positions
    return VisitPlanner(
        settings=study,
        robot=robot,
        positions=usable_positions(study, robot, roomy),
        surroundings=around,
        stage=0,
        at=None,
    )


def parameter_robots(study: VisitStudy, planner: VisitPlanner) -> tuple[Elastic, ...]:
    """Return the robot, or one for each sample of theta of a robust design."""
    robust, robot = study.design.robust, planner.robot
    if robust is None:
        return (robot,)
    rng = np.random.default_rng(study.seed)
    values = parameter_samples(robust, robot, planner.positions, rng)
    return (robot, *(WithParameters(robot, one) for one in values[1:]))
