"""What a study says before it fits: too few frequencies, combinations that the plan leaves weak.

Said by logging, which is silent unless a program listens, as the command line does.
"""

import logging

from estimators.uncertainty.identifiability import Identifiability
from oed.study.stages.run import Run
from robotmodels.common.arrays import Array

_LOG = logging.getLogger(__name__)
_LOG.addHandler(logging.NullHandler())
_MOST_NAMED = 3


def warn_of_few_frequencies(run: Run, omega: Array, columns: int) -> None:
    """Warn where the real data of a position are fewer than the free parameters.

    Each output has as many `columns` as there are inputs of FRFs, or runs.
    """
    robot = run.robot
    responses = len(robot.output_names) * columns
    data, parameters = 2 * len(omega) * responses, len(robot.parameters)
    if data < parameters:
        _LOG.warning(
            "frequencies: %d of %d responses are %d real data in each position, fewer than the %d "
            "free parameters, which only several different positions can distinguish; take more "
            "frequencies, or free fewer parameters",
            len(omega), responses, data, parameters,
        )  # fmt: skip


def warn_of_weak_combinations(predicted: Identifiability) -> None:
    """Warn of the combinations of parameters that the plan, were all measured, leaves uncertain."""
    weak = predicted.weak()
    for combination in weak[:_MOST_NAMED]:
        _LOG.warning("the plan is weak: %s", combination)
    if weak:
        _LOG.warning(
            "a plan gets stronger by more frequencies, another band, more experiments or positions"
        )
