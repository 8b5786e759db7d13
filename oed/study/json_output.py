"""Results of a study for other programs: three JSON files beside its stages.

SI units and radians, except frequencies [Hz]; covariances are for ln theta. Nothing in these
files depends on the clock or on where they lie: the same seed gives the same files.

``design.json``
    ``candidates``: how many; ``relaxed``: ``criterion``, ``support`` (indices of candidates in
    ``stages/information/information.h5``), their ``weights``, ``value``, certified ``gap``;
    ``exact``: ``experiments`` (visits to a position), their ``runs``, and ``efficiency``
    (certified lower bound against the relaxed optimum); ``predicted``: relative ``std`` by the
    plan's own information (null where a parameter is undetermined) and ``weak`` combinations in
    words; ``positions``: the positions to measure in,
    each with ``candidate``, ``position`` [rad, in the order of ``motors``], ``weight``,
    ``repetitions`` (experiments in it), in the order of visits; where the study asks for them,
    ``springs`` to tell apart, see `estimators.StructurePower`, ``order``: ``candidates`` in that
    order, ``seconds`` of all moves, from the start and back to
    it, and ``robust``: efficiencies at each sample of theta of the design and of the ``nominal``
    one.
``fit.json``
    ``parameters``: name, unit, ``truth`` (null where it is unknown), ``estimate``;
    ``residual``, ``cost``, ``origin`` of the selected fit; ``trust``: ``verdict`` (one of
    `estimators.VERDICTS`) and ``reason``, ``intervals`` (``name``, ``value``, ``std``, ``low`` and
    ``high`` in SI units, null where there is none, ``method``, ``dof``, ``verdict``, ``reason``),
    ``residuals`` (``ratio`` to what noise explains, its ``dof``, ``probability``, ``whiteness`` and
    ``lag_one``), ``directions`` tested for errors of the model; ``estimators``: what each estimator
    came to: ``residual``, ``weights``, ``positions`` (how many), ``estimate``, ``cost``,
    ``converged``; ``starts``: per estimator, the searches with ``start`` number and ``values``,
    ``cost`` (null where the search could not begin), ``converged``, ``evaluations``, ``message``,
    best first.
``uncertainty.json``
    ``theorem1`` and ``emcee``: relative ``std`` and ``correlation``, and the ``method`` of the
    first; ``trust``: as in fit.json, refined by posterior and profiles; ``convergence``:
    ``r_hat``, ``ess``,
    ``autocorrelation_time`` [steps], ``acceptance``, ``converged``, ``message``;
    ``z``: (ln estimate - ln truth) / std of Theorem 1, null without a true value.
    ``failures``: stages that could not be computed, with the reason; what they would give is null.
    ``plans``: of plans compared, ``positions``, ``relative_efficiency`` (``predicted`` by
    information, ``simulated``, its 95 % ``interval``), ``predicted`` and ``simulated`` relative
    std; null where parameters are undetermined.
``stages/``
    what each stage computed, see `oed.study.stage_cache`; among it
    ``information/information.h5`` with
    ``positions`` (Q, n), ``matrices`` (Q, p, p) and ``names``, ``fit-NAME/runs.h5`` (see
    `estimators.read_fits`) and ``posterior/posterior.h5``, the chains (see `emcee.backends`).
"""

from pathlib import Path
from typing import Any

import numpy as np

from estimators.sampling.posterior import Posterior
from estimators.uncertainty.covariance import Uncertainty
from oed.plan_comparison.plan_comparison import PlanComparison, SimulatedPlan
from oed.study.parts import DesignedPlan
from oed.study.results import FittedStudy, PlannedStudy, StudyResults
from oed.study.stages.fit import Search, start_number
from oed.study.summary import PlanSummary
from robotmodels.common.arrays import Array
from robotmodels.common.plain_data import write_json


def write_results(results: PlannedStudy, folder: Path) -> None:
    """Write design.json, fit.json and uncertainty.json into `folder`, as far as there are."""
    documents = {"design": design_document(results)}
    if isinstance(results, FittedStudy):
        documents["fit"] = fit_document(results)
    if isinstance(results, StudyResults):
        documents["uncertainty"] = uncertainty_document(results)
    for name, document in documents.items():
        write_json(folder / f"{name}.json", document)


def design_document(results: PlannedStudy) -> dict[str, Any]:
    """Return the content of design.json."""
    plan, summary = results.plan, results.plan_summary
    design, exact = plan.design, plan.exact
    support = np.flatnonzero(design.weights)
    noise = results.study.noise
    return {
        **_header("design/1", results),
        "motors": results.robot.motor_names,
        "parameters": results.robot.parameters.names,
        "frequencies_hz": plan.omega / (2 * np.pi),
        "noise": None if noise is None else noise.model_dump(),
        "candidates": summary.candidates,
        "relaxed": {
            "criterion": design.criterion,
            "support": support,
            "weights": design.weights[support],
            "value": design.value,
            "gap": summary.gap,
        },
        "exact": {
            "experiments": summary.experiments,
            "runs": summary.runs,
            "efficiency": summary.efficiency,
        },
        "predicted": predicted_document(summary),
        **(_choices(plan) if isinstance(plan, DesignedPlan) else {}),
        "positions": [
            {
                "candidate": i,
                "position": plan.information.positions[i],
                "weight": design.weights[i],
                "repetitions": exact.repetitions[i],
            }
            for i in plan.used
        ],
    }


def predicted_document(summary: PlanSummary) -> dict[str, Any]:
    """Return the standard deviations predicted by a plan's information."""
    return {"std": [one.std for one in summary.predicted], "weak": summary.weak}


def _choices(plan: DesignedPlan) -> dict[str, Any]:
    """Return what a plan has where the study asks for it: robustness, an order of visits."""
    document: dict[str, Any] = {}
    if plan.robust is not None:
        document["robust"] = {
            "efficiency": plan.robust.efficiency,
            "nominal": plan.robust.nominal_efficiency,
        }
    if plan.powers:
        document["springs"] = [vars(power) for power in plan.powers]
    if plan.order is not None:
        document["order"] = {"candidates": plan.used, "seconds": plan.order.duration}
    return document


def fit_document(results: FittedStudy) -> dict[str, Any]:
    """Return the content of fit.json."""
    fits = results.fits
    best = fits.result
    rows = zip(
        best.parameters.names,
        best.parameters.units,
        results.truth,
        best.parameters.values,
        strict=True,
    )
    return {
        **_header("fit/1", results),
        "residual": best.residual,
        "cost": best.cost,
        "origin": fits.origin,
        "trust": results.trust.document(),
        "parameters": [
            {
                "name": name,
                "unit": unit,
                "truth": truth,
                "estimate": estimate,
                "at_bound": best.at_bounds.get(name),
            }
            for name, unit, truth, estimate in rows
        ],
        "estimators": {
            name: {
                "residual": search.estimator.residual,
                "weights": search.weights,
                "positions": len(search.positions),
                "estimate": search.result.parameters.values,
                "cost": search.result.cost,
                "converged": search.result.converged,
            }
            for name, search in fits.searches.items()
        },
        "starts": {name: _runs(search, fits.starts) for name, search in fits.searches.items()},
    }


def _runs(search: Search, starts: Array) -> list[dict[str, Any]]:
    return [
        {
            "start": start_number(starts, run),
            "values": run.start,
            "cost": run.cost,
            "converged": run.converged,
            "evaluations": run.evaluations,
            "message": run.message,
        }
        for run in search.runs
    ]


def uncertainty_document(results: StudyResults) -> dict[str, Any]:
    """Return the content of uncertainty.json."""
    theorem1, posterior = results.uncertainty.theorem1, results.uncertainty.posterior
    comparison = results.comparison
    return {
        **_header("uncertainty/1", results),
        "parameters": results.fits.result.parameters.names,
        "theorem1": None if theorem1 is None else {"method": theorem1.method, **_spread(theorem1)},
        "emcee": None if posterior is None else _spread(posterior.uncertainty()),
        "convergence": None if posterior is None else _convergence(posterior),
        "z": results.z_scores,
        "trust": results.trust.document(),
        **({} if comparison is None else {"plans": _plans(comparison)}),
        "failures": results.run.reasons,
    }


def _spread(uncertainty: Uncertainty) -> dict[str, Any]:
    return {"std": uncertainty.std, "correlation": uncertainty.correlation}


def _convergence(posterior: Posterior) -> dict[str, Any]:
    return {
        "r_hat": posterior.r_hat,
        "ess": posterior.ess,
        "autocorrelation_time": posterior.autocorrelation_time,
        "acceptance": np.mean(posterior.acceptance),
        "converged": posterior.converged,
        "message": posterior.message,
    }


def _plans(comparison: PlanComparison) -> dict[str, Any]:
    return {
        trial.name: {
            "positions": len(trial.support),
            "relative_efficiency": {
                "predicted": comparison.predicted[k],
                "simulated": comparison.simulated[k],
                "interval": comparison.interval[k],
            },
            "predicted": trial.predicted.std if isinstance(trial, SimulatedPlan) else None,
            "simulated": trial.std if isinstance(trial, SimulatedPlan) else None,
        }
        for k, trial in enumerate(comparison.plans)
    }


def _header(schema: str, results: PlannedStudy) -> dict[str, Any]:
    return {
        "schema": schema,
        "robot": results.robot.name,
        "seed": results.study.seed,
        "versions": results.run.versions,
    }
