"""How far a fit can be trusted: recommended intervals, the verdict and its evidence."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from estimators.fitting.residuals import loss_factors
from estimators.frf.repeated_visits import visits_of
from estimators.trust.directed_tests import Directions
from estimators.trust.intervals import VERDICTS, Verdict
from estimators.trust.line_scatter import Scatter
from estimators.trust.linearised_fit import Lines
from estimators.trust.rule import Evidence, gather_evidence, judge, variance_scale
from estimators.trust.trust import LEVEL, Trust
from robotmodels.common.arrays import Array, ComplexArray, read_only
from robotmodels.common.errors import IdentificationError
from robotmodels.description.robot_file import Choice
from robotmodels.elastic.extra_elements import extra_elements
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.linear.response import Elastic, frequency_response, sensitivity

if TYPE_CHECKING:
    from estimators.fitting.fitted_model import FittedModel

_MOST = 500.0  # logarithm of an interval that tells nothing


def fit_trust(fit: "FittedModel") -> Trust:
    """Return the recommended intervals and the verdict, by the rule of `estimators.trust.rule`."""
    problem, values = fit.problem, fit.parameters.values
    at = problem.derived(values)
    directions = model_directions(
        problem.model, problem.positions, problem.omega, values, at, problem.changes(values, at)
    )
    evidence = gather_evidence(
        fit.linearise(),
        directions,
        fit.misfit,
        converged=fit.converged,
        has_degrees_of_freedom=problem.has_degrees_of_freedom,
    )
    slope, square = loss_factors(problem.loss)
    scatter = evidence.scatter.scaled(variance_scale(evidence) * square / slope**2)
    return judged_trust(problem.name, values, problem.bounds, evidence, scatter)


def judged_trust(
    residual: str, values: Array, bounds: Array, evidence: Evidence, scatter: Scatter
) -> Trust:
    """Return intervals and verdicts by the rule, from evidence and variances of ln theta.

    Parameters
    ----------
    residual : str
        Name of the residual.
    values : ndarray, (p,), SI
        Fitted.
    bounds : ndarray, (2, p), SI
        Bounds of the search.
    evidence : Evidence
        See `gather_evidence`.
    scatter : Scatter
        Variances of ln theta.
    """
    verdicts, ends = _ends(values, bounds, scatter, judge(evidence))
    if not evidence.has_degrees_of_freedom:
        unknown = np.full_like(scatter.degrees_of_freedom, np.nan)
        scatter = replace(scatter, degrees_of_freedom=unknown)
    correlation = evidence.correlation
    return Trust(
        names=evidence.fit.names,
        values=values,
        scatter=scatter,
        ends=read_only(ends),
        method=_method(residual, evidence),
        verdicts=tuple(str(v) for v in verdicts),
        reasons=tuple(v.reason for v in verdicts),
        size=evidence.size,
        whiteness=correlation.probability,
        lag_one=float(correlation.coefficients[1:2].sum()),
        tests=evidence.tests,
    )


def _method(residual: str, evidence: Evidence) -> str:
    """Return where the standard deviations come from."""
    estimated = np.isfinite(evidence.fit.degrees_of_freedom).any()
    parts = ["scatter of the lines over blocks" if estimated else "Theorem 1, stated noise"]
    if not evidence.has_degrees_of_freedom:
        parts = ["Theorem 1, noise of unknown degrees of freedom"]
    if not evidence.correlation.white:
        parts.append("correlated along lines")
    if evidence.too_large:
        parts.append("scaled by the residuals")
    name = residual.upper() if residual in ("nls", "lls") else residual
    return f"{name}, {', '.join(parts)}"


def _ends(
    values: Array, bounds: Array, scatter: Scatter, verdicts: tuple[Verdict, ...]
) -> tuple[list[Verdict], Array]:
    """Return verdicts and ends (p, 2); one-sided, in the values themselves, at a bound of the fit.

    The logarithm of a damper at its lower bound tells nothing: its interval is that of the value,
    from zero to where noise would have pulled it from.
    """
    std = np.sqrt(scatter.variance)
    both, one = scatter.quantile(LEVEL), scatter.quantile(2 * LEVEL - 1)
    at_low, at_high = np.isclose(values, bounds, rtol=1e-6, atol=0)
    ends, judged = np.full((len(values), 2), np.nan), list(verdicts)
    for i, verdict in enumerate(verdicts):
        bounded = VERDICTS.index(verdict) >= VERDICTS.index("not identifiable")
        if bounded and at_low[i]:
            judged[i] = Verdict(
                "not identifiable", "at its lower bound; only an upper end is known"
            )
            ends[i, 1] = values[i] * (1 + one[i] * std[i])
        elif bounded and at_high[i]:
            judged[i] = Verdict("not identifiable", "at its upper bound; only a lower end is known")
            ends[i, 0] = values[i] * np.exp(-one[i] * std[i])
        elif verdict.gives_interval and np.isfinite(std[i]):
            ends[i] = values[i] * np.exp(np.array([-1, 1]) * min(both[i] * std[i], _MOST))
    return judged, np.where(np.isfinite(ends), ends, np.nan)


_GEAR_STEP = 1e-4


def model_directions(
    model: Elastic,
    positions: Array,
    omega: Array,
    values: Array,
    at: tuple[ComplexArray, ComplexArray],
    changes: Callable[[ComplexArray], Lines],
) -> Directions:
    """Return the directions that are tested at a fit.

    A delay common to all outputs; the gain of every motor's torque; every number of a robot file
    that is fixed (springs, dampers, motor inertia and friction, payload, places of cuts) and every
    gear ratio; each parameter in one position alone; each parameter in the lower half of the lines.

    Parameters
    ----------
    model : Elastic
        Model that was fitted.
    positions : ndarray, (Q, n), rad
        Positions.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    values : ndarray, (p,), SI
        Fitted.
    at : tuple
        FRF of the model at the fit, (Q, F, m, n), and its derivatives with respect to ln theta, (Q,
        F, m, n, p).
    changes : callable
        Turns changes (Q, F, m, n, r) of the FRF into those of the modelled values, (Q, F, k, r).
    """
    response, jacobian = at
    names, units, columns = [], [], []
    for name, unit, column in model_columns(model, positions, omega, values, response):
        names.append(name)
        units.append(unit)
        columns.append(column)
    parameters = model.parameters.names
    visits = visits_of(positions)
    visits = visits if len(visits) > 1 else []
    half = len(omega) // 2 if len(omega) > 3 else 0
    local = [f"{name} in position {q + 1}" for q in range(len(visits)) for name in parameters]
    if half:
        local += [f"{name} below {omega[half] / (2 * np.pi):.3g} Hz" for name in parameters]
    stacked = np.stack(columns, axis=-1)
    return Directions(
        (*names, *local),
        (*units, *["relative"] * len(local)),
        changes(stacked),
        changes(jacobian),
        tuple(visits),
        half,
    )


def model_columns(
    model: Elastic,
    positions: Array,
    omega: Array,
    values: Array,
    response: ComplexArray,
) -> Iterator[tuple[str, str, ComplexArray]]:
    """Yield name, unit and change of the FRF (Q, F, m, n) of each direction."""
    yield "delay", "s", -1j * omega[:, None, None] * response
    inputs = getattr(
        model, "motor_names", tuple(f"input {j + 1}" for j in range(response.shape[-1]))
    )
    for j, motor in enumerate(inputs):
        column = np.zeros_like(response)
        column[..., j] = response[..., j]
        yield f"gain of {motor}", "relative", column
    if isinstance(model, ElasticRobot):
        yield from _fixed_numbers(model, positions, omega, values, response)


def _fixed_numbers(
    robot: ElasticRobot, positions: Array, omega: Array, values: Array, response: ComplexArray
) -> Iterator[tuple[str, str, ComplexArray]]:
    """Yield the directions of the numbers of a robot file that are not free."""
    for i, motor in enumerate(robot.file.motors):
        motors = list(robot.file.motors)
        motors[i] = motor.model_copy(update={"gear_ratio": motor.gear_ratio * (1 + _GEAR_STEP)})
        other = ElasticRobot(robot.file.model_copy(update={"motors": motors}), robot.folder)
        try:
            moved = frequency_response(other, positions, omega, values)
        except IdentificationError:
            continue
        yield f"gear ratio of {motor.name}", "relative", (moved - response) / _GEAR_STEP
    whole = _all_free(robot)
    elements = dict(zip(robot.elements.names, robot.elements.at(values), strict=True))
    wider = whole.parameters
    theta = np.array([elements.get(n, v) for n, v in zip(wider.names, wider.values, strict=True)])
    _, J = sensitivity(whole, positions, omega, theta, equilibrium_shift=True)
    for i, name in enumerate(wider.names):
        if name not in robot.parameters.names and acts(J[..., i], response):
            yield name, "relative", J[..., i]


def acts(column: ComplexArray, response: ComplexArray) -> bool:
    """Whether a change per unit is more than rounding, unlike that of a mass on an axis."""
    return bool(np.abs(column).max() > _ROUNDING * np.abs(response).max())


_ROUNDING = 1e-10  # of FRFs and their differences, per unit
_CHANNELS = (".torque_gain", ".torque_delay", ".torque_lag", ".gain", ".delay", ".lag")


def _all_free(robot: ElasticRobot) -> ElasticRobot:
    """Return the robot with every number free that can be a parameter."""
    possible = extra_elements(robot.file)
    extra, cuts = list[str](), set[object]()
    for name, (value, _) in possible.items():
        if not value > 0 or name == "delay" or name.endswith(_CHANNELS):
            continue
        if name.endswith(".at"):
            spring = next(s for s in robot.file.springs if f"{s.name}.at" == name)
            cut = (spring.link, spring.at)
            if cut in cuts:
                continue
            cuts.add(cut)
        extra.append(name)
    return ElasticRobot(
        robot.file.model_copy(update={"parameters": Choice(extra=extra)}), robot.folder
    )
