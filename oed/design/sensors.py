"""Which sensors to buy, and where to measure with them.

An experiment in a position informs by its motors and, independently, by each sensor that was
bought: H_q = H_q0 + sum of H_qs over the bought sensors s. A choice within the budget is judged by
its best design over the positions. Every choice is tried where there are few; where there are many
sensors are added, dropped and swapped one by one. A relaxation, in which each experiment may use
other sensors and only their mean cost keeps to the budget, bounds what any choice could reach.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from oed.criteria.criteria import Criterion, objective_of
from oed.design.design import Design
from oed.design.sensor_relaxation import SensorProblem, relaxed_choice
from oed.information_sets.candidates import check_candidates
from oed.information_sets.information_set import InformationSet
from robotmodels.common.arrays import Array, check_above_zero
from robotmodels.common.deprecation import renamed_attributes
from robotmodels.common.errors import InvalidInput, NotIdentifiable
from robotmodels.common.printing import ReprHtml

_MOST_TRIED = 256


@dataclass(frozen=True, eq=False)
class Sensor:
    """A sensor that can be bought.

    Attributes
    ----------
    information : InformationSet
        What it adds in each candidate position, beside the motors.
    cost : float
        Cost in units of the budget.
    """

    information: InformationSet
    cost: float = 1.0


@renamed_attributes("0.2", chosen="sensors", keep="relative_efficiency")
@dataclass(frozen=True, eq=False)
class SensorDesign(ReprHtml):
    """A choice of sensors with its design, certified.

    Attributes
    ----------
    sensors : tuple of str
        Names of the bought sensors.
    cost : float
        Cost of all of them.
    design : Design
        Positions with these sensors.
    efficiency : float
        Certified lower bound against every choice within the budget.
    relaxed_efficiency : float
        Against the relaxation, in which sensors move from position to position.
    relative_efficiency : mapping of str to float
        Efficiency relative to this choice: of each bought sensor without it, below one, of each
        other sensor with it added; each with the best positions for it.
    usage : mapping of str to float
        Of the relaxation: share of the experiments that would use each sensor.
    tried : int
        Choices judged.
    """

    sensors: tuple[str, ...]
    cost: float
    design: Design
    efficiency: float
    relaxed_efficiency: float
    relative_efficiency: Mapping[str, float]
    usage: Mapping[str, float]
    tried: int

    def __str__(self) -> str:
        lines = [
            f"{', '.join(self.sensors) or 'no sensors'} for {self.cost:g}, {self.tried} choices "
            f"judged by {self.design.criterion}, efficiency >= {self.efficiency:.4f}"
        ]
        for name, factor in self.relative_efficiency.items():
            what = "without it" if name in self.sensors else "with it"
            lines.append(f"  {name:<12} {what} {factor:.3f} of the efficiency")
        return "\n".join(lines)


def optimal_sensors(
    base: InformationSet,
    sensors: Mapping[str, Sensor],
    budget: float,
    criterion: str | Criterion = "D",
    tolerance: float = 1e-6,
    prior: Array | None = None,
) -> SensorDesign:
    """Return the best sensors within the budget, and where to measure with them.

    Parameters
    ----------
    base : InformationSet
        Information of each candidate position without any of the sensors.
    sensors : mapping of str to Sensor
        What can be bought, by name.
    budget : float
        Largest sum of costs.
    criterion : str or Criterion
        As in `optimal_design`; one that is not smooth, such as E, takes cvxpy and longer.
    tolerance : float
        Largest certified gap of each choice's design.
    prior : ndarray, (p, p), optional
        Information of experiments there are already, in units of the shares.

    Raises
    ------
    InvalidInput
        If sensors do not fit the positions and parameters, a cost or the budget is not a number >=
        0, or the prior does not fit.
    NotIdentifiable
        Naming the parameters, if no choice within the budget identifies them.
    SolverFailed
        As `optimal_design`.
    """
    names, costs, added = _checked(base, sensors, budget)
    problem = SensorProblem(base, added, costs, budget, objective_of(criterion, base.names), prior)
    # All sensors together: names the parameters that no choice can identify.
    problem.design(np.ones(len(names), dtype=bool), tolerance)
    evaluated = _EvaluatedChoices(problem, tolerance)
    best, all_tried = _search(costs, budget, evaluated.value)
    design = evaluated.design(best)
    if design is None:
        raise NotIdentifiable(
            base.unidentifiable(), f"budget: no set of sensors within {budget:g} identifies them"
        )
    tried, value = len(evaluated.designs), evaluated.value(best)
    relative_efficiency = {
        name: float(np.exp(evaluated.value(best ^ {s}) - value)) for s, name in enumerate(names)
    }
    bound, usage = value, np.zeros(len(names))
    if costs.min() <= budget:
        bound, usage = relaxed_choice(problem, value)
    relaxed = min(1.0, float(np.exp(value - bound)))
    return SensorDesign(
        sensors=tuple(names[s] for s in sorted(best)),
        cost=float(costs[sorted(best)].sum()),
        design=design,
        efficiency=design.efficiency if all_tried else relaxed,
        relaxed_efficiency=relaxed,
        relative_efficiency=relative_efficiency,
        usage=dict(zip(names, usage.tolist(), strict=True)),
        tried=tried,
    )


def _checked(
    base: InformationSet, sensors: Mapping[str, Sensor], budget: float
) -> tuple[tuple[str, ...], Array, Array]:
    check_candidates(base, "base")
    if not sensors:
        raise InvalidInput("sensors: none given; at least one is needed")
    check_above_zero(budget, "budget", zero=True)
    for name, sensor in sensors.items():
        other = sensor.information
        check_candidates(other, f"sensors: {name}: information")
        if len(other) != len(base) or other.names != base.names:
            raise InvalidInput(
                f"sensors: {name}: {len(other)} candidates and parameters "
                f"{', '.join(other.names)}; {len(base)} and {', '.join(base.names)} are needed"
            )
        check_above_zero(sensor.cost, f"sensors: {name}: cost", zero=True)
    costs = np.array([sensor.cost for sensor in sensors.values()])
    added = np.stack([sensor.information.matrices for sensor in sensors.values()])
    return tuple(sensors), costs, added


class _EvaluatedChoices:
    """Choices of sensors with their best designs, each computed once; None if not identifiable."""

    def __init__(self, problem: SensorProblem, tolerance: float) -> None:
        self.problem, self.tolerance = problem, tolerance
        self.designs: dict[frozenset[int], Design | None] = {}

    def design(self, choice: frozenset[int]) -> Design | None:
        if choice not in self.designs:
            used = np.zeros(len(self.problem.costs), dtype=bool)
            used[sorted(choice)] = True
            try:
                self.designs[choice] = self.problem.design(used, self.tolerance)
            except NotIdentifiable:
                self.designs[choice] = None
        return self.designs[choice]

    def value(self, choice: frozenset[int]) -> float:
        """Return the log value of the best design with these sensors."""
        design = self.design(choice)
        return -np.inf if design is None else self.problem.objective.log_value(design.information)


def _search(
    costs: Array, budget: float, value: Callable[[frozenset[int]], float]
) -> tuple[frozenset[int], bool]:
    """Return the best choice, and whether all were tried or single changes only."""
    count = len(costs)
    room = budget * (1 + 1e-12)

    def affordable(choice: frozenset[int]) -> bool:
        return float(costs[sorted(choice)].sum()) <= room

    if 2**count <= 16 * _MOST_TRIED:
        every = [frozenset(c) for k in range(count + 1) for c in combinations(range(count), k)]
        # More sensors never inform less: a choice that leaves room for another one is no best.
        full = [
            c
            for c in every
            if affordable(c) and not any(affordable(c | {s}) for s in range(count) if s not in c)
        ]
        if len(full) <= _MOST_TRIED:
            return max(full, key=value), True
    present: frozenset[int] = frozenset()
    while True:
        others = [s for s in range(count) if s not in present]
        changes = [present | {s} for s in others]
        changes += [present - {out} | {s} for out in present for s in others]
        changes = [c for c in changes if affordable(c)]
        better = max(changes, key=value, default=present)
        if len(better) <= len(present) and value(better) <= value(present) + 1e-9:
            return present, False
        present = better
