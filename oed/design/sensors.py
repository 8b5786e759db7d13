"""Which sensors to buy, and where to measure with them.

An experiment in a position informs by its motors and, independently, by each sensor that was
bought: H_q = H_q0 + sum of H_qs over the chosen sensors s. A choice within the budget is judged by
its best design over the positions. Every choice is tried where there are few; where there are many
sensors are added, dropped and swapped one by one. A relaxation, in which each experiment may use
its own sensors and only their mean cost keeps to the budget, bounds what any choice could reach.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from oed.design.criteria import Criterion, objective
from oed.design.objective import Objective
from oed.design.polytope import Polytope
from oed.design.relaxed import Design, optimal_design
from oed.information_set import InformationSet
from robotmodels.arrays import Array
from robotmodels.errors import InvalidInput, NotIdentifiable, SolverFailed

_MOST_TRIED = 256
_ROUNDS = 60


@dataclass(frozen=True, eq=False)
class Sensor:
    """A sensor that can be bought.

    Attributes
    ----------
    information : what it adds in each candidate position, beside the motors.
    cost : in units of the budget.
    """

    information: InformationSet
    cost: float = 1.0


@dataclass(frozen=True, eq=False)
class SensorDesign:
    """A choice of sensors with its design, certified.

    Attributes
    ----------
    chosen : names of the sensors.
    cost : of all of them.
    design : positions with these sensors.
    efficiency : certified lower bound against every choice within the budget.
    relaxed_efficiency : against the relaxation, in which sensors move from position to position.
    keep : for each chosen sensor the efficiency that would be left without it, below one, and for
        each other one what its purchase would raise it to; each with its own best positions.
    usage : (of the relaxation) share of the experiments that would use each sensor.
    tried : choices judged.
    """

    chosen: tuple[str, ...]
    cost: float
    design: Design
    efficiency: float
    relaxed_efficiency: float
    keep: Mapping[str, float]
    usage: Mapping[str, float]
    tried: int


def optimal_sensors(
    base: InformationSet,
    sensors: Mapping[str, Sensor],
    budget: float,
    criterion: str | Criterion = "D",
    tolerance: float = 1e-6,
) -> SensorDesign:
    """Return the best sensors within the budget, and where to measure with them.

    Parameters
    ----------
    base : information of each candidate position without any of the sensors.
    sensors : what can be bought, by name.
    budget : largest sum of costs.
    criterion : a smooth criterion.
    tolerance : largest certified gap of each choice's design.

    Raises
    ------
    InvalidInput : if sensors do not fit the positions and parameters, a cost or the budget is not
        a number >= 0, or the criterion is not smooth.
    NotIdentifiable : naming the parameters, if no choice within the budget identifies them.
    """
    names, costs, added = _checked(base, sensors, budget)
    wanted = objective(criterion, base.names)
    if not wanted.smooth:
        raise InvalidInput(f"criterion {wanted.name} is not smooth: sensors need one that is")
    everything = InformationSet(base.positions, base.matrices + added.sum(axis=0), base.names)
    optimal_design(everything, wanted, solver="newton", tolerance=tolerance)
    judged: dict[frozenset[int], Design | None] = {}

    def value(choice: frozenset[int]) -> float:
        if choice not in judged:
            judged[choice] = _design(base, added, choice, wanted, tolerance)
        design = judged[choice]
        return -np.inf if design is None else wanted.log_value(design.information)

    best, all_tried = _search(costs, budget, value)
    found = judged[best]
    if found is None:
        raise NotIdentifiable(
            base.unidentifiable(), f"budget: {budget:g} buys no sensors that identify them"
        )
    tried = len(judged)
    own = value(best)
    keep = {names[s]: float(np.exp(value(best ^ {s}) - own)) for s in range(len(names))}
    bound, usage = own, np.zeros(len(names))
    if costs.min() <= budget:
        bound, usage = _relaxed(base, added, costs, budget, wanted, found)
    return SensorDesign(
        chosen=tuple(names[s] for s in sorted(best)),
        cost=float(costs[sorted(best)].sum()),
        design=found,
        efficiency=found.efficiency if all_tried else min(1.0, float(np.exp(own - bound))),
        relaxed_efficiency=min(1.0, float(np.exp(own - bound))),
        keep=keep,
        usage=dict(zip(names, usage.tolist(), strict=True)),
        tried=tried,
    )


def _checked(
    base: InformationSet, sensors: Mapping[str, Sensor], budget: float
) -> tuple[tuple[str, ...], Array, Array]:
    if not sensors:
        raise InvalidInput("sensors: none given; at least one is needed")
    if not (np.isfinite(budget) and budget >= 0):
        raise InvalidInput(f"budget: {budget!r} is not a number >= 0")
    for name, sensor in sensors.items():
        other = sensor.information
        if len(other) != len(base) or other.names != base.names:
            raise InvalidInput(
                f"sensors: {name}: {len(other)} candidates and parameters "
                f"{', '.join(other.names)}; {len(base)} and {', '.join(base.names)} are needed"
            )
        if not (np.isfinite(sensor.cost) and sensor.cost >= 0):
            raise InvalidInput(f"sensors: {name}: cost {sensor.cost!r} is not a number >= 0")
    costs = np.array([sensor.cost for sensor in sensors.values()])
    added = np.stack([sensor.information.matrices for sensor in sensors.values()])
    return tuple(sensors), costs, added


def _design(
    base: InformationSet, added: Array, choice: frozenset[int], wanted: Objective, tolerance: float
) -> Design | None:
    """Return the best design with these sensors; None if it leaves something open."""
    matrices = base.matrices + added[sorted(choice)].sum(axis=0)
    info = InformationSet(base.positions, matrices, base.names)
    try:
        return optimal_design(info, wanted, solver="newton", tolerance=tolerance)
    except NotIdentifiable:
        return None


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


def _relaxed(
    base: InformationSet,
    added: Array,
    costs: Array,
    budget: float,
    wanted: Objective,
    start: Design,
) -> tuple[float, Array]:
    """Return an upper bound on the log value of every choice, and the sensors' shares of use.

    Columns are positions with the sensors used there; at multipliers y of the mean cost the
    dearest one of position q has price tr(W H_q0) + sum_s max(0, tr(W H_qs) - y c_s).
    """
    positions = np.repeat(np.arange(len(base)), 2)
    used = np.zeros((len(positions), len(costs)), dtype=bool)
    used[1::2] = True
    bound, usage = np.inf, np.zeros(len(costs))
    for _ in range(_ROUNDS):
        matrices = base.matrices[positions] + np.einsum(
            "is,siab->iab", used.astype(float), added[:, positions]
        )
        info = InformationSet(positions[:, None].astype(float), matrices, base.names)
        n = len(positions)
        allowed = Polytope(
            np.stack([np.ones(n), used @ costs]),
            np.array([1.0, budget]),
            np.zeros(n),
            np.full(n, np.inf),
            ("experiments", "cost"),
        )
        try:
            design = optimal_design(info, wanted, allowed, solver="newton", tolerance=1e-5)
        except SolverFailed:
            break
        weight = wanted.price(design.witness, design.information.shape)
        y = max(design.multipliers["cost"], 0.0)
        own = np.tensordot(base.matrices, weight)
        extra = np.tensordot(added, weight).T - y * costs
        prices = own + np.maximum(extra, 0.0).sum(axis=1)
        most = float(prices.max()) + y * budget
        bound = min(bound, float(np.log(most) - wanted.log_polar(design.witness)))
        reached = wanted.log_value(design.information)
        usage = np.asarray(design.weights @ used)
        if bound <= reached + 1e-4:
            break
        dearest = np.argsort(-prices)[: 2 * len(base.names)]
        kept = design.support
        positions = np.concatenate([positions[kept], dearest])
        used = np.concatenate([used[kept], extra[dearest] > 0])
    return max(bound, wanted.log_value(start.information)), usage
