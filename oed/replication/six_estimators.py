"""The study of [WM] section 6: six estimators judged by one cost.

Every model of every estimator is judged by the LLS cost with user-defined weights over
all positions (their figure 3), and by the one with optimal weights (figure 4). The models of each
estimator are then sorted by the first.
"""

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np

from estimators.fitting.fixed_equilibrium_search import can_compile, cost_kernel
from estimators.fitting.frf_problem import FrfProblem, frf_problem
from estimators.fitting.multistart import order_of_costs
from estimators.frf.frf_estimate import FrfEstimate
from oed.study.settings.study_file import ESTIMATORS
from oed.study.stages.fit import Search, start_number
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.common.errors import IdentificationError
from robotmodels.common.progress import Progress, tell

REFERENCE = "LLS15U"
"""Its best model normalises costs and parameters."""

REASONABLE_COST = 1.5
"""[WM] section 6: models usually miss important resonances above this normalised cost."""
REASONABLE_RANGE = (0.5, 2.0)
"""[WM] section 6: springs relative to the best model's."""
BEST_COST, BEST_COUNT = 1.05, 31
"""[WM] Table 1: the best 31 models, those with a normalised cost below 1.05."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """All models of all estimators (E, N), those of each estimator sorted by `user`.

    Attributes
    ----------
    estimators : tuple of str
        E names.
    parameters : tuple of str
        p names.
    start : ndarray of int, (E, N)
        Number of the start, from 0.
    user, optimal : ndarray, (E, N)
        LLS costs with user-defined and with optimal weights over all positions, infinite for models
        without an FRF.
    values : ndarray, (E, N, p)
        Values [SI].
    converged : ndarray, (E, N)
        Whether the search ended in a minimum of its cost.
    """

    estimators: tuple[str, ...]
    parameters: tuple[str, ...]
    start: IntArray
    user: Array
    optimal: Array
    values: Array
    converged: Array

    def of(self, name: str) -> int:
        """Return the row of an estimator."""
        return self.estimators.index(name)

    @property
    def user_normalised(self) -> Array:
        """Costs of figure 3: over that of the best LLS15U model."""
        return np.asarray(self.user / self.user[self.of(REFERENCE), 0])

    @property
    def optimal_normalised(self) -> Array:
        """Costs of figure 4: over the least of the LLS15O models."""
        return np.asarray(self.optimal / self.optimal[self.of("LLS15O")].min())

    @property
    def best(self) -> Array:
        """Parameters of the best LLS15U model, (p,) [SI]."""
        return np.asarray(self.values[self.of(REFERENCE), 0])

    @property
    def relative(self) -> Array:
        """Parameters over those of the best LLS15U model, (E, N, p)."""
        return np.asarray(self.values / self.best)

    @property
    def reasonable_by_cost(self) -> Array:
        """Which models have a reasonable cost, (E, N)."""
        return np.asarray(self.user_normalised < REASONABLE_COST)

    def reasonable_by_springs(self, left_out: tuple[str, ...] = ()) -> Array:
        """Which models have all springs in the reasonable range, (E, N), but for those named."""
        springs = [
            i
            for i, name in enumerate(self.parameters)
            if name.endswith(".stiffness") and name not in left_out
        ]
        low, high = REASONABLE_RANGE
        ratios = self.relative[:, :, springs]
        return np.asarray(((ratios >= low) & (ratios <= high)).all(axis=2))


def evaluate(
    robot: ElasticRobot,
    estimate: FrfEstimate,
    searches: Mapping[str, Search],
    weights: tuple[Array, str | Array | ComplexArray],
    starts: Array,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Evaluation:
    """Judge all models of the six estimators.

    Parameters
    ----------
    robot : ElasticRobot
        Model of the study.
    estimate : FrfEstimate
        Data of all positions.
    searches : mapping of str to Search
        Searches of at least the six estimators, from the same starts.
    weights : tuple of (ndarray, str or ndarray)
        User-defined weights (Q, F, m, n) of figure 3, and optimal ones of figure 4.
    starts : ndarray, (N, p)
        SI.
    """
    problems = tuple(frf_problem(robot, estimate, "lls", weight) for weight in weights)
    fits = [run for name in ESTIMATORS for run in searches[name].runs]
    judge = partial(_costs, problems)
    values = [fit.parameters.values for fit in fits]
    costs = np.empty((len(fits), 2))
    judged = (
        map(judge, values) if executor is None else executor.map(judge, values, chunksize=_TOGETHER)
    )
    for i, pair in enumerate(judged):
        costs[i] = pair
        tell(progress, i + 1, len(fits))
    shape = (len(ESTIMATORS), len(starts))
    order = np.array([order_of_costs(row) for row in costs[:, 0].reshape(shape)])

    def arranged(per_fit: Array | IntArray) -> Array:
        return np.asarray(np.take_along_axis(per_fit.reshape(shape), order, axis=1))

    every = np.array(values).reshape(*shape, -1)
    return Evaluation(
        ESTIMATORS,
        robot.parameters.names,
        arranged(np.array([start_number(starts, fit) for fit in fits])).astype(np.int64),
        arranged(costs[:, 0]),
        arranged(costs[:, 1]),
        np.take_along_axis(every, order[..., None], axis=1),
        arranged(np.array([fit.converged for fit in fits])),
    )


_TOGETHER = 25  # models that a process judges at a time: preparing the data costs as much as some


def _costs(problems: tuple[FrfProblem, ...], values: Array) -> tuple[float, ...]:
    """Return the costs of one model in problems of the same data."""
    model, estimate = problems[0].model, problems[0].data
    try:
        network = model.network(estimate.positions, values)
        if can_compile(problems[0], network):
            return tuple(float(cost_kernel(one, network)(values)[0]) for one in problems)
        response = network.frequency_response(estimate.omega)
    except (IdentificationError, np.linalg.LinAlgError):
        return (np.inf,) * len(problems)
    costs = []
    for one in problems:
        error = one.kind.error(estimate.response, response, one.used)
        costs.append(float(np.sum(one.weights * np.abs(error) ** 2)))
    return tuple(costs)
