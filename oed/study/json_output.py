"""What a study leaves behind for other programs: three JSON files beside its stages.

SI units and radians, except frequencies [Hz]; covariances are for ln theta. Nothing in these
files depends on the clock or on where they lie: the same seed gives the same files.

``design.json``
    ``candidates``: how many; ``relaxed``: ``criterion``, ``support`` (indices of candidates in
    ``stages/information/information.h5``), their ``weights``, ``value``, certified ``gap``;
    ``exact``: ``experiments`` (visits to a position), their ``runs``, and ``efficiency``
    (certified lower bound against the relaxed optimum); ``promised``: relative ``std`` by the
    plan's own information (null where a parameter is left open) and ``weak`` combinations in
    words; ``positions``: the positions to measure in,
    each with ``candidate``, ``position`` [rad, in the order of ``motors``], ``weight``,
    ``repetitions`` (visits), in the order of visits; where the study asks for them, ``order``:
    ``candidates`` in that order, ``seconds`` of all moves, from the start and back to it, and
    ``robust``: efficiencies at each sample of theta of the design and of the ``nominal`` one.
``fit.json``
    ``parameters``: name, unit, ``truth`` (null where it is not known), ``estimate``;
    ``residual``, ``cost``, ``origin`` of the chosen fit; ``trust``: ``verdict`` (one of
    `estimators.VERDICTS`) and ``reason``, ``intervals`` (``name``, ``value``, ``std``, ``low`` and
    ``high`` in SI units, null where there is none, ``method``, ``dof``, ``verdict``, ``reason``),
    ``residuals`` (``ratio`` to what noise explains, its ``dof``, ``probability``, ``whiteness`` and
    ``lag_one``), ``directions`` tested for errors of the model; ``estimators``: what each estimator
    came to: ``residual``, ``weights``, ``positions`` (how many), ``estimate``, ``cost``,
    ``converged``; ``starts``: per estimator, the runs with ``start`` number and ``values``,
    ``cost`` (null where the search could not begin), ``converged``, ``evaluations``, ``message``,
    best first.
``uncertainty.json``
    ``theorem1`` and ``emcee``: relative ``std`` and ``correlation``, and the ``method`` of the
    first; ``trust``: as in fit.json, refined by posterior and profiles; ``convergence``:
    ``r_hat``, ``ess``,
    ``autocorrelation_time`` [steps], ``acceptance``, ``converged``, ``message``;
    ``z``: (ln estimate - ln truth) / std of Theorem 1, null where no truth is known.
    ``failures``: stages that could not be computed, with the reason; what they would give is null.
    ``plans``: of plans compared, ``positions``, ``worth`` promised and found with its 95 %
    ``interval``, ``promised`` and ``found`` relative std; null where parameters are left open.
``stages/``
    what each stage computed, see `oed.study.stages.stage_cache`; among it
    ``information/information.h5`` with
    ``positions`` (Q, n), ``matrices`` (Q, p, p) and ``names``, ``fit-NAME/runs.h5`` (see
    `estimators.read_fits`) and ``posterior/posterior.h5``, the chains (see `emcee.backends`).
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.sampling.posterior import Posterior
from estimators.uncertainty.covariance import Uncertainty
from oed.plan_comparison.plan_comparison import PlanComparison
from oed.study.results import FittedStudy, PlannedStudy, StudyResults
from oed.study.stages.context import frequency_grid
from oed.study.stages.fit_stages import Search, start_number
from robotmodels.common.arrays import Array
from robotmodels.common.atomic_files import write_text


def write_results(results: PlannedStudy, folder: Path) -> None:
    """Write design.json, fit.json and uncertainty.json into `folder`, as far as there are."""
    documents = {"design": design_document(results)}
    if isinstance(results, FittedStudy):
        documents["fit"] = fit_document(results)
    if isinstance(results, StudyResults):
        documents["uncertainty"] = uncertainty_document(results)
    for name, document in documents.items():
        text = json.dumps(document, indent=1, allow_nan=False) + "\n"
        write_text(folder / f"{name}.json", text)


def design_document(results: PlannedStudy) -> dict[str, Any]:
    """Return the content of design.json."""
    design, exact = results.design, results.exact
    support = np.flatnonzero(design.weights)
    study = results.study
    omega = results.omega if study.frequencies is None else frequency_grid(study.frequencies)
    return {
        **_header("design/1", results),
        "motors": list(results.robot.motor_names),
        "parameters": list(results.robot.parameters.names),
        "frequencies_hz": _numbers(omega / (2 * np.pi)),
        "noise": None if study.noise is None else study.noise.model_dump(),
        "candidates": len(design.weights),
        "relaxed": {
            "criterion": design.criterion,
            "support": support.tolist(),
            "weights": _numbers(design.weights[support]),
            "value": float(design.value),
            "gap": float(design.gap),
        },
        "exact": {
            "experiments": results.visits,
            "runs": results.visits * results.runs_per_visit,
            "efficiency": float(exact.efficiency),
        },
        "promised": promised_document(results),
        **_extras(results),
        "positions": [
            {
                "candidate": int(i),
                "position": _numbers(results.information.positions[i]),
                "weight": float(design.weights[i]),
                "repetitions": int(exact.repetitions[i]),
            }
            for i in results.used
        ],
    }


def promised_document(results: PlannedStudy) -> dict[str, Any]:
    """Return what the plan's information promises before anyone measures."""
    promise = results.promise
    return {"std": _numbers(promise.std), "weak": list(promise.weak())}


def _extras(results: PlannedStudy) -> dict[str, Any]:
    """Return what a plan has besides, where the study asks for it."""
    found: dict[str, Any] = {}
    if results.robust is not None:
        found["robust"] = {
            "efficiency": _numbers(results.robust.efficiency),
            "nominal": _numbers(results.robust.nominal_efficiency),
        }
    if results.order is not None:
        found["order"] = {
            "candidates": results.used.tolist(),
            "seconds": float(results.order.duration),
        }
    return found


def fit_document(results: FittedStudy) -> dict[str, Any]:
    """Return the content of fit.json."""
    fit = results.fit
    fitted = fit.parameters
    rows = zip(fitted.names, fitted.units, results.truth, fitted.values, strict=True)
    bounds = fit.at_bounds
    return {
        **_header("fit/1", results),
        "residual": fit.residual,
        "cost": float(fit.cost),
        "origin": results.fit_origin,
        "trust": results.trust.document(),
        "parameters": [
            {
                "name": name,
                "unit": unit,
                "truth": _number(truth),
                "estimate": float(estimate),
                "at_bound": bounds.get(name),
            }
            for name, unit, truth, estimate in rows
        ],
        "estimators": {
            name: {
                "residual": search.estimator.residual,
                "weights": search.weights,
                "positions": len(search.result.estimate.positions),
                "estimate": _numbers(search.result.parameters.values),
                "cost": float(search.result.cost),
                "converged": search.result.converged,
            }
            for name, search in results.searches.items()
        },
        "starts": {
            name: _runs(search, results.starts) for name, search in results.searches.items()
        },
    }


def _runs(search: Search, starts: Array) -> list[dict[str, Any]]:
    return [
        {
            "start": start_number(starts, run),
            "values": _numbers(run.start),
            "cost": _number(run.cost),
            "converged": run.converged,
            "evaluations": run.evaluations,
            "message": run.message,
        }
        for run in search.runs
    ]


def uncertainty_document(results: StudyResults) -> dict[str, Any]:
    """Return the content of uncertainty.json."""
    theorem1, posterior = results.theorem1, results.posterior
    return {
        **_header("uncertainty/1", results),
        "parameters": list(results.fit.parameters.names),
        "theorem1": None
        if theorem1 is None
        else {
            "method": theorem1.method,
            "std": _numbers(theorem1.std),
            "correlation": _numbers(theorem1.correlation),
        },
        "emcee": None if posterior is None else _sampled(posterior.uncertainty()),
        "convergence": None if posterior is None else _convergence(posterior),
        "z": _numbers(results.z_scores),
        "trust": results.trust.document(),
        **({} if results.comparison is None else {"plans": _plans(results.comparison)}),
        "failures": {one.name: one.reason for one in results.failures},
    }


def _sampled(uncertainty: Uncertainty) -> dict[str, Any]:
    return {
        "std": _numbers(uncertainty.std),
        "correlation": _numbers(uncertainty.correlation),
    }


def _convergence(posterior: Posterior) -> dict[str, Any]:
    return {
        "r_hat": _numbers(posterior.r_hat),
        "ess": _numbers(posterior.ess),
        "autocorrelation_time": _numbers(posterior.autocorrelation_time),
        "acceptance": float(np.mean(posterior.acceptance)),
        "converged": bool(posterior.converged),
        "message": posterior.message,
    }


def _plans(found: PlanComparison) -> dict[str, Any]:
    return {
        trial.name: {
            "positions": len(trial.support),
            "worth": {
                "promised": float(found.promised[k]),
                "found": float(found.simulated[k]),
                "interval": _numbers(found.interval[k]),
            },
            "promised": None if trial.promised is None else _numbers(trial.promised.std),
            "found": None if trial.simulation is None else _numbers(trial.std),
        }
        for k, trial in enumerate(found.plans)
    }


def _header(schema: str, results: PlannedStudy) -> dict[str, Any]:
    return {
        "schema": schema,
        "robot": results.robot.name,
        "seed": results.study.seed,
        "versions": results.versions,
    }


def _numbers(array: NDArray[Any]) -> Any:
    """Return nested lists of plain numbers, with null where there is none."""
    if array.ndim > 1:
        return [_numbers(row) for row in array]
    return [_number(value) for value in array]


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
