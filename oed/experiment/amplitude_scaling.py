"""The largest amplitudes of excitation whose peaks stay inside limits.

Beside the holding torque and the position itself all predicted peaks are proportional to the
amplitude, so that the largest amplitude is a quotient, not a search.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from oed.experiment.experiment_plan import ExperimentPlan
from oed.experiment.limits import UNITS, Limits, beside_carrier, room
from oed.experiment.predicted_peaks import Peaks, PlannedLoop, carrier_extremes
from robotmodels.common.arrays import Array, read_only
from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import Progress
from robotmodels.linear.response import Elastic
from robotmodels.simulation.controller import Controller

# Limits of which no input alone takes this part (squared) of what another limit leaves it.
_NEGLIGIBLE = 1e-4


@dataclass(frozen=True)
class Binding:
    """The active limit of a visit: the first that it meets as its amplitude grows.

    Attributes
    ----------
    visit, position : int
        Their indices.
    motor : str
        Its name.
    quantity : str
        One of `oed.experiment.limits.UNITS`.
    limit : float
        Its value, signed, in the unit of the quantity.
    factor : float
        Factor by which the amplitude may grow until then.
    """

    visit: int
    position: int
    motor: str
    quantity: str
    limit: float
    factor: float

    def __str__(self) -> str:
        where = "around" if self.quantity == "swing" else "in"
        return (
            f"{self.quantity} of motor {self.motor!r} {where} position {self.position + 1} "
            f"meets its limit {self.limit:.4g} {UNITS[self.quantity]}"
        )


@dataclass(frozen=True, eq=False)
class Scaling:
    """A plan with the largest amplitudes inside its limits, and the active limits.

    Attributes
    ----------
    plan : ExperimentPlan
        The scaled plan.
    peaks : Peaks
        Predicted for it.
    bindings : tuple of Binding
        The limit that each visit would meet first if its amplitude grew, (V,).
    """

    plan: ExperimentPlan
    peaks: Peaks
    bindings: tuple[Binding, ...]

    @property
    def binding(self) -> Binding:
        """The limit that is met first."""
        return min(self.bindings, key=lambda b: b.factor)


def scale(
    plan: ExperimentPlan,
    robot: Elastic,
    controller: Controller,
    limits: Limits,
    *,
    balance: bool = False,
    per_visit: bool = False,
    margin: float = 0.0,
    holding: Array | None = None,
    friction: Array | None = None,
    progress: Progress | None = None,
) -> Scaling:
    """Return the plan with the largest amplitudes that the limits allow in every visit.

    The peaks are those of the linear model from the first sample on; what stick-slip, backlash and
    noise add is not in them, leave a margin for it. What a carrier takes of the room is taken off.

    Parameters
    ----------
    plan : ExperimentPlan
        Plan to be scaled.
    robot : Elastic
        Robot that will run it.
    controller : Controller
        Controller of its motors.
    limits : Limits
        Limits to be met.
    balance : bool
        Choose the ratios of the inputs' amplitudes, see `fair_amplitudes`; otherwise they stay.
    per_visit : bool
        One factor for each visit instead of one for all.
    margin : float, dimensionless
        Part of the distance from operating point to limit that is not used.
    holding : ndarray, (Q, n), N m, optional
        Motor torques that hold the arm; by default the robot's.
    friction : ndarray, (n,), N m, optional
        Coulomb friction at the motor shafts, which the torque overcomes beside; by default none.
    progress : Progress, optional
        Called with the number of simulated visits and their total.

    Raises
    ------
    InvalidInput
        Naming position, motor and quantity, if the operating point is not inside a limit: of the
        torque that holds the arm, or of the position; if there is no limit, or one has a wrong
        shape or sign.
    NoEquilibrium
        If the springs cannot carry the robot's weight in a position.
    """
    if not 0 <= margin < 1:
        raise InvalidInput(f"margin: {margin!r}; a number from 0 to below 1 is needed")
    bounds = limits.bounds(plan.motors)
    loop = PlannedLoop.of(plan, robot, controller, holding)
    slow = carrier_extremes(plan, robot, controller, holding)
    free = _free(plan, bounds, loop.operating_point, friction, margin, slow)
    passes = 1 + len(plan.motors) if balance else 1
    done = _counter(passes * len(plan.visits), progress)
    if balance:
        plan = _balanced(plan, loop, free, done)
    extremes = loop.extremes(plan, plan.multisine.amplitudes, done=done)
    allowed = _allowed(extremes, free)  # (V, quantities, n, 2)
    each = allowed.reshape(len(allowed), -1).min(axis=1)
    factors = each if per_visit else np.full(len(each), each.min())
    bindings = tuple(_binding(plan, v, allowed[v] / factors[v], bounds) for v in range(len(each)))
    swing = (slow + extremes * factors[:, None, None, None])[:, :3]
    peaks = Peaks(read_only(loop.operating_point), read_only(swing))
    return Scaling(plan.rescaled(factors), peaks, bindings)


def _free(
    plan: ExperimentPlan,
    bounds: Array,
    operating_point: Array,
    friction: Array | None,
    margin: float,
    slow: Array,
) -> Array:
    """Return the room (V, quantities, n, 2) of the excitation, beside a carrier's peaks."""
    visits = [f"position {q + 1}" for q in plan.visits]
    rub = np.zeros(len(plan.motors)) if friction is None else friction
    free = (1 - margin) * room(bounds, operating_point, rub, plan.motors, visits)
    return beside_carrier(free, np.stack([-slow[..., 0], slow[..., 1]], -1), plan.motors, visits)


def _allowed(extremes: Array, room: Array) -> Array:
    """Return by which factors deviations may grow until they fill the room, same shape."""
    reach = np.stack([-extremes[..., 0], extremes[..., 1]], axis=-1)
    some = reach > 1e-300 * room  # commands of one motor leave others at rest
    return np.asarray(np.divide(room, reach, out=np.full(room.shape, np.inf), where=some))


def _counter(total: int, progress: Progress | None) -> Callable[[], object] | None:
    """Return a function that counts its calls and reports each."""
    if progress is None:
        return None
    count = itertools.count(1)
    return lambda: progress(next(count), total)


def _balanced(
    plan: ExperimentPlan, loop: PlannedLoop, room: Array, done: Callable[[], object] | None
) -> ExperimentPlan:
    """Return the plan with the inputs' amplitudes in fair ratios."""
    amplitudes = plan.multisine.amplitudes
    used = []
    for motor in range(len(plan.motors)):
        alone = np.where(np.arange(len(plan.motors)) == motor, amplitudes, 0.0)
        # One block shows how the inputs compare; the common factor then heeds all of them.
        used.append(1 / _allowed(loop.extremes(plan, alone, blocks=1, done=done), room).ravel())
    factors = fair_amplitudes(np.stack(used, axis=1))
    return replace(plan, multisine=plan.multisine.with_amplitudes(amplitudes * factors))


def fair_amplitudes(used: Array) -> Array:
    """Return the factors of the inputs with the largest product that the limits have room for.

    Every motor moves the others too. Random phases add up in the mean square, so that factors f fit
    where sum_j (used_ij f_j)^2 <= 1 in each row; the information grows with the logarithms of f.

    Parameters
    ----------
    used : ndarray, (rows, n)
        Part of each limit that each input takes alone; each takes a part of some limit.

    Returns
    -------
    ndarray, (n,)
        Factors.
    """
    # In units of what each input may have alone; y = 2 ln f.
    alone = used.max(axis=0)
    parts = (used / alone) ** 2
    parts = parts[parts.max(axis=1) > _NEGLIGIBLE]
    n = len(alone)
    from scipy.optimize import minimize  # takes a tenth of a second to load

    solution = minimize(
        lambda y: -y.sum(),
        np.full(n, -np.log(n)),
        jac=lambda y: -np.ones(n),
        method="SLSQP",
        constraints={
            "type": "ineq",
            "fun": lambda y: -np.log(parts @ np.exp(y)),
            "jac": lambda y: -parts * np.exp(y) / (parts @ np.exp(y))[:, None],
        },
        bounds=[(-np.log(1e3 * n), 0.0)] * n,
        options={"ftol": 1e-6},
    )
    y = np.nan_to_num(solution.x, nan=-np.log(n))
    return np.asarray(np.exp(y / 2) / alone)


def _binding(plan: ExperimentPlan, visit: int, allowed: Array, bounds: Array) -> Binding:
    k, motor, side = (int(i) for i in np.unravel_index(allowed.argmin(), allowed.shape))
    return Binding(
        visit=visit,
        position=int(plan.visits[visit]),
        motor=plan.motors[motor],
        quantity=list(UNITS)[k],
        limit=float(bounds[k, motor, side]),
        factor=float(allowed.min()),
    )
