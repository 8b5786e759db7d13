"""The largest amplitudes of excitation whose peaks stay inside limits.

Beside the holding torque and the position itself all predicted peaks are proportional to the
amplitude, so that the largest amplitude is a quotient, not a search.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from oed.experiment.experiment_plan import ExperimentPlan
from oed.experiment.predicted_peaks import Peaks, PlannedLoop
from robotmodels.common.arrays import Array, read_only
from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import Progress
from robotmodels.linear.response import Elastic
from robotmodels.simulation.controller import Controller

_QUANTITIES = ("torque", "speed", "position")
# Limits of which no input alone takes this part (squared) of what another limit leaves it.
_NEGLIGIBLE = 1e-4
_UNITS = {"torque": "N m", "speed": "rad/s", "position": "rad"}


@dataclass(frozen=True, eq=False)
class Limits:
    """What may not be exceeded; None for no limit.

    Attributes
    ----------
    torque : ndarray or None, (n,), N m
        Motor shaft, holding the arm against gravity included.
    speed : ndarray or None, (n,), rad/s
        Motor shaft.
    positions : ndarray or None, (n, 2)
        Motor angle over gear ratio, [rad] or [m].
    """

    torque: Array | None = None
    speed: Array | None = None
    positions: Array | None = None


@dataclass(frozen=True)
class Binding:
    """The limit that a visit meets first as its amplitude grows.

    Attributes
    ----------
    visit, position : int
        Their indices.
    motor : str
        Its name.
    quantity : str
        Torque, speed or position.
    limit : float
        Its value, signed [N m, rad/s or rad].
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
        return (
            f"{self.quantity} of motor {self.motor!r} in position {self.position + 1} "
            f"meets its limit {self.limit:.4g} {_UNITS[self.quantity]}"
        )


@dataclass(frozen=True, eq=False)
class Scaling:
    """A plan inside its limits, and what keeps it from more.

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
    noise add is not in them, leave a margin for it.

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
    bounds = _bounds(limits, plan.motors)
    loop = PlannedLoop.of(plan, robot, controller, holding)
    room = (1 - margin) * _room(plan, loop.operating_point, bounds, friction)
    passes = 1 + len(plan.motors) if balance else 1
    done = _counter(passes * len(plan.visits), progress)
    if balance:
        plan = _balanced(plan, loop, room, done)
    swing = loop.swing(plan, plan.multisine.amplitudes, done=done)
    allowed = _allowed(swing, room)  # (V, 3, n, 2)
    each = allowed.reshape(len(allowed), -1).min(axis=1)
    factors = each if per_visit else np.full(len(each), each.min())
    bindings = tuple(_binding(plan, v, allowed[v] / factors[v], bounds) for v in range(len(each)))
    peaks = Peaks(read_only(loop.operating_point), read_only(swing * factors[:, None, None, None]))
    return Scaling(plan.rescaled(factors), peaks, bindings)


def _bounds(limits: Limits, motors: Sequence[str]) -> Array:
    """Return lower and upper bounds of torque, speed and position, (3, n, 2)."""
    n = len(motors)
    bounds = np.broadcast_to([-np.inf, np.inf], (3, n, 2)).copy()
    for k, name in enumerate(("torque", "speed", "positions")):
        value = getattr(limits, name)
        if value is None:
            continue
        limit = np.asarray(value, dtype=float)
        shape = (n, 2) if name == "positions" else (n,)
        if limit.shape != shape:
            raise InvalidInput(f"limits.{name}: shape {limit.shape}; {shape} is needed")
        bounds[k] = limit if name == "positions" else np.stack([-limit, limit], axis=-1)
        for motor, (low, high) in zip(motors, bounds[k], strict=True):
            if not low < high:
                values = f"[{low:g}, {high:g}]" if name == "positions" else f"{high:g}"
                right = "low < high" if name == "positions" else "a positive number"
                raise InvalidInput(f"limits.{name} of motor {motor!r}: {values}; {right} is needed")
    if not np.isfinite(bounds).any():
        raise InvalidInput("limits: none given; any amplitude would do")
    return bounds


def _room(
    plan: ExperimentPlan, operating_point: Array, bounds: Array, friction: Array | None = None
) -> Array:
    """Return distances (V, 3, n, 2) from operating point to both bounds, less friction."""
    lost = np.zeros(bounds.shape)
    lost[0] = 0.0 if friction is None else np.outer(friction, [1.0, -1.0])
    free = bounds + lost
    room = np.abs(free - operating_point[..., None])
    inside = (free[..., 0] < operating_point) & (operating_point < free[..., 1])
    if not inside.all():
        visit, k, motor = np.argwhere(~inside)[0]
        low, high = bounds[k, motor]
        name = f"position {plan.visits[visit] + 1}: motor {plan.motors[motor]!r}"
        if k == 0:
            needed, rubbing = abs(operating_point[visit, k, motor]), lost[k, motor, 0]
            beside = f" and {rubbing:.4g} N m against friction" if rubbing else ""
            raise InvalidInput(
                f"limits.torque: {name} needs {needed:.4g} N m to hold the arm alone{beside}, "
                f"which leaves nothing of its limit {high:.4g} N m"
            )
        raise InvalidInput(
            f"limits.positions: {name} at {operating_point[visit, k, motor]:.4g} is not inside its "
            f"limits [{low:.4g}, {high:.4g}], which leaves no room to move"
        )
    return np.asarray(room)


def _allowed(swing: Array, room: Array) -> Array:
    """Return by which factors deviations may grow until they fill the room, same shape."""
    reach = np.maximum(np.stack([-swing[..., 0], swing[..., 1]], axis=-1), np.finfo(float).tiny)
    return np.asarray(room / reach)


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
        used.append(1 / _allowed(loop.swing(plan, alone, blocks=1, done=done), room).ravel())
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
        quantity=_QUANTITIES[k],
        limit=float(bounds[k, motor, side]),
        factor=float(allowed.min()),
    )
