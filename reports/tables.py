"""Rows of the report's tables, as text."""

from dataclasses import dataclass

import numpy as np

from oed.study import Multistart, StudyResults
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


def position_rows(results: StudyResults) -> list[PositionRow]:
    """Return the table of the plan's positions."""
    return [
        PositionRow(
            number=number,
            angles=text.degrees(results.information.positions[i]),
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
    rows = []
    for residual, runs in results.fits.items():
        best = best_cost(results, residual)
        label = residual.replace("_", " ").upper()
        rows += [
            RunRow(
                residual=label,
                start=start + 1,
                cost=text.significant(run.cost, 6),
                ratio=text.fixed(run.cost / best, 4),
                evaluations=text.count(run.evaluations),
                ending="converged" if run.converged else run.message,
            )
            for run, start in zip(runs.fits, runs.starts, strict=True)
        ]
        rows += [RunRow(label, start + 1, "–", "–", "–", why) for start, why in runs.failures]
    return rows


def best_cost(results: StudyResults, residual: str) -> float:
    """Return the best cost known of a residual; for NLS, the chosen fit's where it is lower."""
    costs = [run.cost for run in results.fits[residual].fits]
    if residual == results.fit.residual:
        costs.append(results.fit.cost)
    return float(min(costs, default=float("nan")))


def reached(results: StudyResults) -> list[tuple[str, int, int]]:
    """Return, per residual, how many starts ended at its best cost, and of how many."""

    def of(residual: str, runs: Multistart) -> tuple[str, int, int]:
        label = residual.replace("_", " ").upper()
        return label, runs.reached(best_cost(results, residual)), len(results.starts)

    return [of(residual, runs) for residual, runs in results.fits.items()]
