"""What a study leaves behind for other programs: three JSON files and the information matrices.

SI units and radians, except frequencies [Hz]; covariances are for ln theta. Nothing in these
files depends on the clock or on where they lie: the same seed gives the same files.

``design.json``
    ``candidates``: how many; ``relaxed``: ``criterion``, ``support`` (candidate indices into
    information.h5), their ``weights``, ``value``, certified ``gap``; ``exact``: ``experiments``
    and ``efficiency`` (certified lower bound against the relaxed optimum); ``positions``: the
    positions to measure in, each with ``candidate``, ``position`` [rad, in the order of
    ``motors``], ``weight``, ``repetitions``.
``fit.json``
    ``parameters``: name, unit, ``truth``, ``estimate``; ``residual``, ``weights``, ``cost``,
    ``origin`` of the chosen fit; ``residuals``: what each residual came to: ``estimate``,
    ``cost``, ``converged``; ``starts``: per residual, the runs with ``start`` number and
    ``values``, ``weights``, ``cost`` (null where the search could not begin), ``converged``,
    ``evaluations``, ``message``, best first.
``uncertainty.json``
    ``theorem1`` and ``emcee``: relative ``std`` and ``correlation``; ``convergence``: ``r_hat``,
    ``ess``, ``autocorrelation_time`` [steps], ``acceptance``, ``converged``, ``message``;
    ``z``: (ln estimate - ln truth) / std of Theorem 1.
``information.h5``
    ``positions`` (Q, n), ``matrices`` (Q, p, p), ``names``.
"""

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oed.study import Search, StudyResults, start_number
from robotmodels.arrays import Array
from robotmodels.errors import InvalidInput


@contextmanager
def staged_folder(folder: Path) -> Iterator[Path]:
    """Give a folder to write in; its files move to `folder`, one by one whole, if all went well.

    Raises
    ------
    InvalidInput : if `folder` cannot be written to.
    """
    absent = [p for p in (folder, *folder.parents) if not p.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        stage = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=folder))
    except OSError as error:
        raise InvalidInput(f"output: {folder} cannot be written to ({error.strerror})") from None
    try:
        yield stage
        for file in sorted(stage.iterdir()):
            os.replace(file, folder / file.name)
    finally:
        shutil.rmtree(stage)
        for path in absent:  # deepest first: take away what was made in vain
            if not any(path.iterdir()):
                path.rmdir()


def write_results(results: StudyResults, folder: Path) -> None:
    """Write design.json, fit.json, uncertainty.json and information.h5 into `folder`."""
    for name, document in (
        ("design", design_document(results)),
        ("fit", fit_document(results)),
        ("uncertainty", uncertainty_document(results)),
    ):
        text = json.dumps(document, indent=1, allow_nan=False) + "\n"
        (folder / f"{name}.json").write_text(text, encoding="utf-8")
    results.information.save(folder / "information.h5")


def design_document(results: StudyResults) -> dict[str, Any]:
    """Return the content of design.json."""
    design, exact = results.design, results.exact
    support = np.flatnonzero(design.weights)
    return {
        **_header("design/1", results),
        "motors": list(results.robot.motor_names),
        "parameters": list(results.robot.parameters.names),
        "frequencies_hz": _numbers(results.omega / (2 * np.pi)),
        "noise": results.study.noise.model_dump(),
        "candidates": len(design.weights),
        "relaxed": {
            "criterion": design.criterion,
            "support": support.tolist(),
            "weights": _numbers(design.weights[support]),
            "value": float(design.value),
            "gap": float(design.gap),
        },
        "exact": {
            "experiments": int(exact.repetitions.sum()),
            "efficiency": float(exact.efficiency),
        },
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


def fit_document(results: StudyResults) -> dict[str, Any]:
    """Return the content of fit.json."""
    fit = results.fit
    fitted = fit.parameters
    rows = zip(fitted.names, fitted.units, results.truth, fitted.values, strict=True)
    return {
        **_header("fit/1", results),
        "residual": fit.residual,
        "weights": "optimal",
        "cost": float(fit.cost),
        "origin": results.fit_origin,
        "parameters": [
            {"name": name, "unit": unit, "truth": float(truth), "estimate": float(estimate)}
            for name, unit, truth, estimate in rows
        ],
        "residuals": {
            residual: {
                "estimate": _numbers(search.result.parameters.values),
                "cost": float(search.result.cost),
                "converged": search.result.converged,
            }
            for residual, search in results.searches.items()
        },
        "starts": {
            residual: _runs(search, results.starts) for residual, search in results.searches.items()
        },
    }


def _runs(search: Search, starts: Array) -> list[dict[str, Any]]:
    return [
        {
            "start": start_number(starts, run),
            "values": _numbers(run.start),
            "weights": search.weights,
            "cost": float(run.cost) if np.isfinite(run.cost) else None,
            "converged": run.converged,
            "evaluations": run.evaluations,
            "message": run.message,
        }
        for run in search.runs
    ]


def uncertainty_document(results: StudyResults) -> dict[str, Any]:
    """Return the content of uncertainty.json."""
    posterior, sampled = results.posterior, results.posterior.uncertainty()
    return {
        **_header("uncertainty/1", results),
        "parameters": list(results.theorem1.names),
        "theorem1": {
            "std": _numbers(results.theorem1.std),
            "correlation": _numbers(results.theorem1.correlation),
        },
        "emcee": {"std": _numbers(sampled.std), "correlation": _numbers(sampled.correlation)},
        "convergence": {
            "r_hat": _numbers(posterior.r_hat),
            "ess": _numbers(posterior.ess),
            "autocorrelation_time": _numbers(posterior.autocorrelation_time),
            "acceptance": float(np.mean(posterior.acceptance)),
            "converged": bool(posterior.converged),
            "message": posterior.message,
        },
        "z": _numbers(results.z_scores),
    }


def _header(schema: str, results: StudyResults) -> dict[str, Any]:
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
    return [float(value) if np.isfinite(value) else None for value in array]
