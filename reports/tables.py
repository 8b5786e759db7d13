"""Rows of the report's tables, as text."""

from dataclasses import dataclass

import numpy as np

from oed.study import StudyResults, start_number
from reports import text


@dataclass(frozen=True)
class ParameterRow:
    """A parameter: what it is, what came out, how certain it is."""

    name: str
    unit: str
    truth: str
    estimate: str
    std: str
    theorem1: str
    emcee: str
    ratio: str
    z: str
    kind: str


@dataclass(frozen=True)
class PositionRow:
    """A position of the plan: joint angles, weight in the relaxed design, repetitions."""

    number: int
    angles: list[str]
    weight: str
    repetitions: int


@dataclass(frozen=True)
class MotorRow:
    """A motor, its joint's limits, and where the candidates put it."""

    name: str
    joint: str
    limits: tuple[str, str]
    candidates: tuple[str, str]
    points: int


@dataclass(frozen=True)
class ConvergenceRow:
    """How well emcee knows a parameter."""

    name: str
    r_hat: str
    ess: str
    autocorrelation_time: str


@dataclass(frozen=True)
class RunRow:
    """A fit from a perturbed start."""

    residual: str
    start: int
    cost: str
    ratio: str
    evaluations: str
    ending: str


_KINDS = {"stiffness": "Springs", "damping": "Dampers"}


def kind_of(name: str) -> str:
    """Return the group a parameter is listed under."""
    return _KINDS.get(name.rsplit(".", 1)[-1], "Others")


def parameter_rows(results: StudyResults) -> list[ParameterRow]:
    """Return the table of parameters: truth, estimate and both standard deviations."""
    fitted, sampled = results.fit.parameters, results.posterior.uncertainty().std
    rows = []
    for i, name in enumerate(fitted.names):
        value, relative = float(fitted.values[i]), float(results.theorem1.std[i])
        factor, unit = text.scaled_unit(value, fitted.units[i])
        decimals = text.decimals_for(relative * value / factor)
        rows.append(
            ParameterRow(
                name=name,
                unit=unit,
                truth=text.significant(results.truth[i] / factor, 4),
                estimate=text.fixed(value / factor, decimals),
                std=text.fixed(relative * value / factor, decimals),
                theorem1=text.percent(relative),
                emcee=text.percent(float(sampled[i])),
                ratio=text.fixed(relative / float(sampled[i]), 2),
                z=text.fixed(float(results.z_scores[i]), 1),
                kind=kind_of(name),
            )
        )
    return rows


def prismatic(results: StudyResults) -> list[bool]:
    """Return whether each motor's joint is prismatic."""
    robot = results.robot
    return [joint in robot.elements.prismatic for joint in robot.motor_joints]


def motor_rows(results: StudyResults) -> list[MotorRow]:
    """Return the table of motors: limits of the joints, and range of the candidates."""
    robot, positions, straight = results.robot, results.information.positions, prismatic(results)
    limits = [text.places(side, straight) for side in robot.position_limits.T]
    ends = [text.places(side, straight) for side in (positions.min(axis=0), positions.max(axis=0))]
    return [
        MotorRow(
            name=name,
            joint=joint,
            limits=(limits[0][i], limits[1][i]),
            candidates=(ends[0][i], ends[1][i]),
            points=len(np.unique(positions[:, i])),
        )
        for i, (name, joint) in enumerate(zip(robot.motor_names, robot.motor_joints, strict=True))
    ]


def position_rows(results: StudyResults) -> list[PositionRow]:
    """Return the table of the plan's positions."""
    return [
        PositionRow(
            number=number,
            angles=text.places(results.information.positions[i], prismatic(results)),
            weight=text.fixed(w, 4) if (w := float(results.design.weights[i])) else "–",
            repetitions=int(results.exact.repetitions[i]),
        )
        for number, i in enumerate(results.used, start=1)
    ]


def convergence_rows(results: StudyResults) -> list[ConvergenceRow]:
    """Return the table of emcee's convergence."""
    posterior = results.posterior
    return [
        ConvergenceRow(
            name=name,
            r_hat=text.fixed(float(r_hat), 3) if np.isfinite(r_hat) else "–",
            ess=text.count(round(float(ess))) if np.isfinite(ess) else "–",
            autocorrelation_time=text.significant(float(tau), 3),
        )
        for name, r_hat, ess, tau in zip(
            posterior.names,
            posterior.r_hat,
            posterior.ess,
            posterior.autocorrelation_time,
            strict=True,
        )
    ]


def run_rows(results: StudyResults) -> list[RunRow]:
    """Return every fit from every start, in the order of residuals and costs."""
    return [
        RunRow(
            residual=text.residual_label(residual),
            start=start_number(results.starts, run) + 1,
            cost=text.significant(run.cost, 6),
            ratio=text.significant(run.cost / best_cost(results, residual), 5),
            evaluations=text.count(run.evaluations),
            ending="converged" if run.converged else run.message,
        )
        for residual, search in results.searches.items()
        for run in search.runs
    ]


def best_cost(results: StudyResults, residual: str) -> float:
    """Return the best cost known of a residual; for NLS, the chosen fit's where it is lower."""
    best = results.searches[residual].runs[0].cost
    return min(best, results.fit.cost) if residual == results.fit.residual else best


def reached(results: StudyResults) -> list[tuple[str, int, int]]:
    """Return, per residual, how many starts ended at its best cost, and of how many."""
    return [
        (
            text.residual_label(residual),
            search.reached(best_cost(results, residual)),
            len(search.runs),
        )
        for residual, search in results.searches.items()
    ]


def distances(results: StudyResults) -> list[tuple[str, str]]:
    """Return, per residual but NLS, how far its estimate lies at most, in standard deviations."""
    chosen = results.fit.parameters.values
    rows = []
    for residual, search in results.searches.items():
        if residual != results.fit.residual:
            away = np.abs(np.log(search.result.parameters.values / chosen)) / results.theorem1.std
            rows.append((text.residual_label(residual), text.fixed(float(away.max()), 1)))
    return rows
