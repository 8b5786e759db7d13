"""Runs whose noise and friction are those beside a fit."""

import warnings
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estimators.fitting.least_squares import fit
from estimators.fitting.multistart import multistart
from estimators.fitting.priors import Prior
from estimators.fitting.run_fit import RunFit
from estimators.fitting.run_problem import run_problem
from estimators.input_output.coulomb import CoulombPart
from estimators.input_output.run_spectra import RunSpectra, run_spectra
from robotmodels.common.arrays import Array
from robotmodels.common.errors import IdentificationWarning
from robotmodels.common.progress import Progress
from robotmodels.linear.response import Elastic, frequency_response
from robotmodels.records.records import Records

Noise = str | tuple[ArrayLike, ArrayLike]
"""Where the noise is seen, or what it is, see `run_spectra`."""

_UNSETTLED = "runs: noise and friction"
_MOST = 6
_COARSE = 1e-5
"""Relative change of costs at which fits in between end."""
_SETTLED = 1e-2
"""Relative change of values, of which a hundredth is left in friction's course."""
_NEAR = 0.1
"""Relative change of values from which friction is predicted where motors stop."""


def settled_runs(
    model: Elastic,
    records: Records | Sequence[Records],
    noise: Noise = "auto",
    *,
    friction: bool = True,
    start: Array | None = None,
    prior: Prior | None = None,
    **choice: Any,
) -> RunSpectra:
    """Return spectra of runs with noise and friction estimated from a fit's residuals.

    Friction moves motors at lines that were not excited too, by the FRF that fits tell, and its
    course in turns takes a model, see `friction_shares`. So runs are read by the guesses, fitted,
    and read again by the fit, until values change by less than a hundredth.

    Parameters
    ----------
    model : Elastic
        Robot.
    records : Records or sequence of Records
        Runs; parts may differ in their periods.
    noise : str or tuple
        As in `run_spectra`.
    friction : bool
        Whether levels of Coulomb friction are estimated along.
    start : ndarray, (p,), SI, optional
        Where to start; by default the model's values.
    prior : Prior, optional
        As of `fit`.
    choice : dict
        Other arguments of `run_spectra`.

    Raises
    ------
    InvalidInput, SolverFailed
        As `run_spectra` and `fit`.
    """
    values = model.parameters.values if start is None else start
    data = runs_at(model, records, values, noise, friction=friction, near=False, **choice)
    if data.coulomb is None and not data.silent:
        return data
    near = data.coulomb is None
    # Near first, with friction of the levels there are, which is compiled; then both together.
    result = fit(model, replace(data, coulomb=None), start=values, prior=prior)
    for _ in range(_MOST):
        change = np.abs(np.log(result.parameters.values / values)).max()
        values, settled = result.parameters.values, near and change <= _SETTLED
        near = near or change <= _NEAR
        data = runs_at(model, records, values, noise, friction=friction, near=near, **choice)
        if settled:
            return data
        result = fit(model, data, start=values, prior=prior, tolerance=_COARSE)
    warnings.warn(
        f"{_UNSETTLED} still change values by {change:.2g} after {_MOST} fits; start "
        "nearer, or measure more",
        IdentificationWarning,
        stacklevel=2,
    )
    return data


def settled_fit(
    model: Elastic,
    records: Records | Sequence[Records],
    starts: Array | Sequence[Array],
    noise: Noise = "auto",
    *,
    weights: str | None = None,
    prior: Prior | None = None,
    few: int | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    **choice: Any,
) -> tuple[RunFit, tuple[RunFit, ...]]:
    """Return the fit to runs that settle about the best of searches from many starts.

    They settle about the model's values first, which are guesses; searches from all `starts` take
    the friction of these levels; about the best of them the runs settle again.

    Parameters
    ----------
    model : Elastic
        Robot with the guesses.
    records : Records or sequence of Records
        Runs, as of `settled_runs`.
    starts : ndarray, (N, p), SI
        Where searches begin.
    noise : str or tuple
        As in `run_spectra`.
    weights : str, optional
        As of `fit`.
    prior : Prior, optional
        As of `fit`.
    few : int, optional
        Parts of a sequence of records at most, spread evenly, that searches take; by default all.
    executor : Executor, optional
        As of `multistart`.
    progress : Progress, optional
        As of `multistart`.
    choice : dict
        Other arguments of `settled_runs`.

    Returns
    -------
    fit : RunFit
        Its data are the settled runs.
    searches : tuple of RunFit
        Searches from all starts, the least cost first.

    Raises
    ------
    InvalidInput, SolverFailed
        As `run_spectra` and `fit`.
    """
    some = records
    if few is not None and not isinstance(records, Records):
        spread = np.linspace(0, len(records) - 1, min(few, len(records)))
        some = [records[i] for i in spread.round().astype(int)]
    with warnings.catch_warnings():  # by guesses runs need not settle
        warnings.filterwarnings("ignore", _UNSETTLED, IdentificationWarning)
        data = settled_runs(model, some, noise, prior=prior, **choice)
    searches = multistart(
        model,
        replace(data, coulomb=None),  # which is compiled
        starts,
        weights=weights,
        executor=executor,
        progress=progress,
        prior=prior,
    )
    best = searches[0].parameters.values
    data = settled_runs(model, records, noise, start=best, prior=prior, **choice)
    return fit(model, data, weights=weights, start=best, prior=prior), searches


def runs_at(
    model: Elastic,
    records: Records | Sequence[Records],
    values: Array,
    noise: Noise = "auto",
    *,
    friction: bool = True,
    near: bool = True,
    **choice: Any,
) -> RunSpectra:
    """Return spectra of runs with noise and friction estimated at the parameters `values` (p,).

    `near` is as in `run_spectra`; other parameters, and errors, as of `settled_runs`.
    """
    parts = [records] if isinstance(records, Records) else records
    rubbing = model if friction else None
    data = RunSpectra.join(
        [
            run_spectra(part, noise, friction=rubbing, values=values, near=near, **choice)
            for part in parts
        ]
    )
    if data.coulomb is not None:
        part = run_problem(model, data).errors(values).eliminated
        assert isinstance(part, CoulombPart)
        data = data.at_coulomb(part.levels)
    if not data.silent:
        return data
    at = frequency_response(model, data.positions, data.omega, values)
    covariance, freedom = data.covariance.copy(), data.degrees_of_freedom.copy()
    shared = data.shared_draws.copy()
    for q, silent in enumerate(data.silent):
        if silent is not None:
            here = frequency_response(model, data.positions[q : q + 1], silent.omega, values)[0]
            covariance[q], freedom[q], shared[q] = silent.covariance_beside(data.omega, at[q], here)
    return replace(data, covariance=covariance, degrees_of_freedom=freedom, shared_draws=shared)
