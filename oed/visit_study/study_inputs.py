"""What a study of visits says of positions and parameters, checked."""

import numpy as np

from oed.campaign.planning import Planner
from oed.experiment.loop_settings import per_motor
from oed.study.settings.candidates_settings import CandidatesChoice
from oed.study.stages.design_inputs import parameter_samples
from oed.visit_study.study_file import VisitStudy
from robotmodels import ElasticRobot
from robotmodels.common.errors import InvalidInput
from robotmodels.description.friction import shaft_friction
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


def within_torques(study: VisitStudy, robot: ElasticRobot) -> CandidatesChoice:
    """Return the candidates' settings, without those in which the limits leave torque no room."""
    choice, limits, motors = study.candidates, study.limits, tuple(robot.motor_names)
    if limits.torque is None or choice.torque is not None:
        return choice
    friction = study.imperfections.friction * shaft_friction(robot.file)
    room = per_motor("limits.torque", limits.torque, motors) - friction
    if not (room > 0).all():
        i = int(room.argmin())
        raise InvalidInput(
            f"limits.torque: friction alone takes {friction[i]:.4g} N m of motor {motors[i]!r}, "
            f"whose limit is {room[i] + friction[i]:.4g} N m; no excitation is left"
        )
    return choice.model_copy(update={"torque": tuple(room.tolist())})


def parameter_robots(study: VisitStudy, planner: Planner) -> tuple[Elastic, ...]:
    """Return the robot, or one for each sample of theta of a robust design."""
    robust, robot = study.design.robust, planner.robot
    if robust is None:
        return (robot,)
    rng = np.random.default_rng(study.seed)
    values = parameter_samples(robust, robot, planner.positions, rng)
    return (robot, *(WithParameters(robot, one) for one in values[1:]))
