"""Which outputs of a study's robot are worth their price, over the study's candidates."""

from collections.abc import Mapping
from concurrent.futures import Executor

import numpy as np

from oed.design.sensors import Sensor, SensorDesign, optimal_sensors
from oed.information_sets.line_information import sensor_information
from oed.study.settings.study_file import Study
from oed.study.stages.candidates import candidates
from oed.study.stages.design_inputs import criterion_of
from oed.study.stages.run import SimulatedRun, open_run
from robotmodels.common.errors import InvalidInput, check_word
from robotmodels.common.progress import StageProgress


def choose_sensors(
    study: Study,
    prices: Mapping[str, float],
    budget: float,
    progress: StageProgress | None = None,
    executor: Executor | None = None,
) -> SensorDesign:
    """Return the best outputs beside motors' encoders within a budget, by the study's criterion.

    Parameters
    ----------
    prices : mapping of str to float
        By names of outputs; one unit of the budget where none is given.
    budget : float
        Largest sum of prices.

    Raises
    ------
    InvalidInput
        If the study's data are measured, or the robot has no output of a name or none to buy; and
        as `optimal_sensors`.
    """
    with open_run(study, progress, executor) as run:
        if not isinstance(run, SimulatedRun):
            raise InvalidInput("data: sensors are chosen for candidates; leave the records out")
        positions = np.asarray(candidates(run).value.positions)
        criterion = criterion_of(study.design, run.robot)
        base, added = sensor_information(run.robot, positions, run.omega, run.noise)
    for name in prices:
        check_word("price of", name, added, "is no output of the robot beside motors' encoders")
    sensors = {name: Sensor(info, prices.get(name, 1.0)) for name, info in added.items()}
    return optimal_sensors(base, sensors, budget, criterion)
