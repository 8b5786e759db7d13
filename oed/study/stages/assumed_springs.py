"""Springs that a study's plan is to tell apart, and what its data will tell of them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from estimators import FrfEstimate, StructurePower, fit, structure_power
from estimators.fitting.fitted_model import FittedModel
from oed.study.settings.design_settings import DesignChoice
from oed.study.stage_cache import Stage, dataclass_files
from oed.study.stages.run import SimulatedRun, Visits
from robotmodels import ElasticRobot, frequency_response, load_robot
from robotmodels.common.errors import InvalidInput, naming
from robotmodels.common.progress import Progress
from robotmodels.description.robot_file import Spring
from robotmodels.elastic.possible_springs import possible_springs, spring_position


@dataclass(frozen=True)
class AssumedSprings:
    """Power of the data to identify springs that the robot may have.

    Attributes
    ----------
    powers : tuple of StructurePower
        Of each spring.
    """

    powers: tuple[StructurePower, ...]


def alternatives(choice: DesignChoice, robot: ElasticRobot) -> tuple[tuple[Spring, ...], ...]:
    """Return the alternatives to tell apart: a spring, or all that a structure file adds.

    Raises
    ------
    InvalidInput
        If a structure file is of another robot, lacks a spring of the study's, or adds none.
    """
    return tuple(
        (each,) if isinstance(each, Spring) else _added(robot, each) for each in choice.distinguish
    )


def _named(
    choice: DesignChoice, robot: ElasticRobot
) -> Iterator[tuple[Spring | str, tuple[Spring, ...]]]:
    """Return each entry of `distinguish` with its springs."""
    return zip(choice.distinguish, alternatives(choice, robot), strict=True)


def _file_name(entry: Spring | str) -> str:
    """Return the name of a structure file; nothing of a spring."""
    return "" if isinstance(entry, Spring) else Path(entry).name


def all_assumed(choice: DesignChoice, robot: ElasticRobot) -> tuple[Spring, ...]:
    """Return the springs of all alternatives, each once; errors: see `alternatives`."""
    springs = [spring for each in alternatives(choice, robot) for spring in each]
    return tuple({spring_position(spring): spring for spring in reversed(springs)}.values())[::-1]


def _added(robot: ElasticRobot, file: str) -> tuple[Spring, ...]:
    """Return the springs of a structure file that the robot has not."""
    with naming("design.distinguish"):
        other = load_robot(file)
    if other.motor_names != robot.motor_names:
        raise InvalidInput(f"design.distinguish: {file}: motors of another robot than the study's")
    springs, present = other.file.springs, {spring_position(s): s for s in robot.file.springs}
    missing = present.keys() - {spring_position(spring) for spring in springs}
    if missing:
        name = next(spring.name for where, spring in present.items() if where in missing)
        raise InvalidInput(
            f"design.distinguish: {file}: no spring {name!r}; a structure has all springs of the "
            "study's robot and further ones"
        )
    added = tuple(spring for spring in springs if spring_position(spring) not in present)
    if not added:
        raise InvalidInput(f"design.distinguish: {file}: no spring that the study's robot has not")
    return added


def assumed_springs(
    run: SimulatedRun, visits: Visits, share: float
) -> Stage[AssumedSprings] | None:
    """Return what the plan's data will tell of springs to tell apart; None where there are none.

    Parameters
    ----------
    visits : Visits
        The plan.
    share : float
        Part of the information of a run for each motor that a visit has.
    """
    if not run.study.design.distinguish:
        return None

    def compute(folder: Path, report: Progress | None) -> AssumedSprings:
        response = frequency_response(run.robot, visits.positions, run.omega)
        counts = visits.repetitions[:, None, None, None]
        variance = run.noise.variance(response) / (share * counts)
        exact = FrfEstimate(visits.positions, run.omega, response, variance, visits.repetitions)
        plan = fit(run.robot, exact, "nls", "optimal", max_evaluations=1)
        return AssumedSprings(powers_of_alternatives(run.study.design, run.robot, plan))

    inputs = {
        "robot": run.robot_digest,
        "share": share,
        "springs": [
            (_file_name(each), [spring.model_dump(mode="json") for spring in springs])
            for each, springs in _named(run.study.design, run.robot)
        ],
        **visits.key,
        **run.settings("frequencies", "noise"),
    }
    return run.stages.run("assumed-springs", inputs, compute, dataclass_files(AssumedSprings))


def powers_of_alternatives(
    choice: DesignChoice, robot: ElasticRobot, plan: FittedModel, level: float = 0.01
) -> tuple[StructurePower, ...]:
    """Return what data like those of a fit tell of each alternative, each by itself.

    Springs of a structure file have its name in brackets.
    """
    assumed = all_assumed(choice, robot)
    present = {spring_position(spring) for spring in assumed}
    others = [s for s in possible_springs(robot) if spring_position(s) not in present]
    alternatives = [*assumed, *others]
    powers = list[StructurePower]()
    with naming("design.distinguish"):
        for each, springs in _named(choice, robot):
            file = f" ({name})" if (name := _file_name(each)) else ""
            for power in structure_power(plan, springs, alternatives, level=level):
                powers.append(replace(power, name=f"{power.name}{file}"))
    return tuple(powers)
