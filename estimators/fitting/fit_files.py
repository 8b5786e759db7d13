"""Fits as files: all that `Fit` or `RunFit` holds, but for the model and the data.

HDF5 with ``schema`` "fits/1". Attributes ``residual`` and so on lie in one group ``fit_00000`` per
fit (in five digits, in the order given). Weights are many numbers and mostly shared: they lie once
in ``weights_0``, ``weights_1``, ..., and each fit names the one it uses; fits to runs have none.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np

from estimators.fitting.fit_problem import Measured
from estimators.fitting.least_squares import Fit
from estimators.fitting.priors import Prior
from estimators.fitting.residuals import check_loss, find_residual
from estimators.fitting.run_fit import RunFit
from estimators.fitting.run_problem import SML
from estimators.frf.frf_estimate import FrfEstimate, is_full
from estimators.input_output.run_spectra import RunSpectra
from robotmodels.common.arrays import Array, ComplexArray, IntArray, read_only
from robotmodels.common.atomic_files import atomic_write
from robotmodels.common.errors import InvalidInput
from robotmodels.data_files.array_schema import ArraySchema, Field
from robotmodels.data_files.hdf5_file import Hdf5Group, open_hdf5
from robotmodels.description.parameters import Parameters
from robotmodels.linear.response import Elastic

SCHEMA = "fits/1"
_NAMES = Field(("parameter",), "text")
_WEIGHTS = Field(("", "", "", ""), "complex")
_TEXTS = ("residual", "loss", "message")
_FIT = ArraySchema(
    {
        **dict.fromkeys(_TEXTS, Field((), "text", attribute=True)),
        "weights": Field((), "text", attribute=True, optional=True),
        "status": Field((), "whole", attribute=True),
        "cost": Field(attribute=True, finite=False),  # infinite where no search began
        "evaluations": Field((), "whole", least=0, attribute=True),
        "values": Field(("parameter",)),
        "start": Field(("parameter",)),
        "bounds": Field(("", "parameter"), finite=False),
        "positions": Field(("position", "coordinate")),
        "weighting": Field((), "text", attribute=True, optional=True),
        "prior_names": Field(("prior",), "text", attribute=True, optional=True),
        "prior_values": Field(("prior",), optional=True),
        "prior_std": Field(("prior",), optional=True),
        "prior_correlation": Field(("prior", "prior"), optional=True),
    }
)


def write_fits(path: str | Path, fits: Sequence[Fit | RunFit]) -> None:
    """Write fits of one model to HDF5, replacing the file.

    Fits may differ in residual, weights and positions.

    Raises
    ------
    InvalidInput
        If there is no fit, or they differ in their parameters' names.
    """
    import h5py

    if not fits:
        raise InvalidInput(f"{path}: no fits to write")
    names = fits[0].parameters.names
    if any(one.parameters.names != names for one in fits):
        raise InvalidInput(f"{path}: fits of different parameters cannot share a file")
    weights: list[Array | ComplexArray] = []
    with atomic_write(path) as unfinished, h5py.File(unfinished, "w") as file:
        file.attrs["schema"] = SCHEMA
        file.create_dataset("names", data=list(names), dtype=h5py.string_dtype())
        for i, one in enumerate(fits):
            group = file.create_group(f"fit_{i:05d}")
            _write_fit(group, one)
            if isinstance(one, RunFit):
                continue
            index = _weights_index(one.weights, weights)
            if index == len(weights):
                weights.append(one.weights)
                file[f"weights_{index}"] = one.weights
            group.attrs["weights"] = f"weights_{index}"


@overload
def read_fits(path: str | Path, model: Elastic, estimate: FrfEstimate) -> tuple[Fit, ...]: ...
@overload
def read_fits(path: str | Path, model: Elastic, estimate: RunSpectra) -> tuple[RunFit, ...]: ...
def read_fits(
    path: str | Path, model: Elastic, estimate: Measured
) -> tuple[Fit, ...] | tuple[RunFit, ...]:
    """Read what `write_fits` wrote.

    Parameters
    ----------
    model : Elastic
        Model that was fitted.
    estimate : FrfEstimate or RunSpectra
        Data that it was fitted to; a fit of some positions gets these positions only.

    Raises
    ------
    InvalidInput
        If the file is absent or another one, or belongs to another model or estimate.
    """
    with open_hdf5(path, "fits are") as file:
        file.check_schema(SCHEMA)
        groups, weights = file.numbered("fit_"), tuple[str, ...]()
        if isinstance(estimate, FrfEstimate):
            weights = file.numbered("weights_", digits=1)
        else:
            estimate = estimate.without_images(model)
        contents = file.read(
            ArraySchema({"names": _NAMES, **dict.fromkeys(weights, _WEIGHTS)}), beside=groups
        )
        names = contents["names"]
        if names != model.parameters.names:
            raise InvalidInput(
                f"{path}: fits of {', '.join(names)}; the model's free parameters are "
                f"{', '.join(model.parameters.names)}"
            )
        estimates: dict[bytes, Measured] = {}
        fits = (_read_fit(file.group(g), contents, model, estimate, estimates) for g in groups)
        return tuple(fits)  # type: ignore[return-value]  # alike, as the data are


def _weights_index(weights: Array | ComplexArray, stored: list[Array | ComplexArray]) -> int:
    """Return the index of the weights among the stored ones, the count if they are new."""
    for i, other in enumerate(stored):
        if weights is other or (weights.shape == other.shape and np.array_equal(weights, other)):
            return i
    return len(stored)


def _write_fit(group: Any, one: Fit | RunFit) -> None:
    group.attrs.update(
        residual=one.residual,
        loss=one.loss,
        cost=one.cost,
        status=one.status,
        message=one.message,
        evaluations=one.evaluations,
        weighting=one.weighting,
    )
    group["values"] = one.parameters.values
    group["start"] = one.start
    group["bounds"] = one.bounds
    group["positions"] = one.problem.positions
    if one.prior is not None:
        group.attrs["prior_names"] = list(one.prior.names)
        group["prior_values"], group["prior_std"] = one.prior.values, one.prior.std
        if one.prior.correlation is not None:
            group["prior_correlation"] = one.prior.correlation


def _read_fit(
    group: Hdf5Group,
    shared: dict[str, Any],
    model: Elastic,
    estimate: Measured,
    estimates: dict[bytes, Measured],
) -> Fit | RunFit:
    stored, parameters = group.read(_FIT), model.parameters
    key = stored["positions"].tobytes()
    if key not in estimates:
        indices = _position_indices(group.where, stored["positions"], estimate)
        whole = len(indices) == len(estimate.positions)
        estimates[key] = estimate if whole else estimate.subset(indices)
    data = estimates[key]
    if (stored["residual"] == SML) != isinstance(data, RunSpectra):
        raise InvalidInput(f"{group.where}: a fit by {stored['residual'][:60]!r} of other data")
    try:
        common: dict[str, Any] = {
            "model": model,
            "parameters": Parameters(parameters.names, stored["values"], parameters.units),
            **{name: read_only(stored[name]) for name in ("start", "bounds")},
            **{name: stored[name] for name in ("cost", "status", "message", "evaluations")},
            "prior": _prior(stored),
            "loss": check_loss(stored["loss"]),
            "weighting": stored.get("weighting") or "",
        }
        if isinstance(data, RunSpectra):
            return RunFit(data=data, **common)
        residual = find_residual(stored["residual"]).name
        weights = _read_weights(stored, shared, data)
        return Fit(estimate=data, residual=residual, weights=weights, **common)
    except InvalidInput as error:
        raise InvalidInput(f"{group.where}: {error}") from error


def _read_weights(
    stored: dict[str, Any], shared: dict[str, Any], estimate: FrfEstimate
) -> Array | ComplexArray:
    """Return the weights that a fit names."""
    name, shape = stored.get("weights") or "", estimate.response.shape
    weights = shared.get(name)
    if name == "names" or weights is None:
        raise InvalidInput(f"weights {name[:60]!r} are not in the file")
    try:
        is_full(weights, shape)
    except InvalidInput:
        raise InvalidInput(
            f"weights of shape {weights.shape} do not fit an estimate of shape {shape}"
        ) from None
    return np.asarray(read_only(weights))


def _prior(stored: dict[str, Any]) -> Prior | None:
    """Return the prior of a fit, which has all of its three arrays or none.

    Raises
    ------
    InvalidInput
        Naming one that is missing.
    """
    names = ("prior_names", "prior_values", "prior_std")
    missing = [name for name in names if name not in stored]
    if len(missing) == len(names):
        return None
    if missing:
        raise InvalidInput(f"{missing[0]!r} is missing; a prior has {', '.join(names)}")
    label, value, std = (stored[name] for name in names)
    return Prior(label, value, std, stored.get("prior_correlation"))


def _position_indices(path: str, positions: Array, estimate: Measured) -> IntArray:
    """Return which of the estimate's positions a fit used."""
    if positions.shape == estimate.positions.shape and np.array_equal(
        positions, estimate.positions
    ):
        return np.arange(len(positions))
    if not len(positions):
        raise InvalidInput(f"{path}: positions: none; a fit used one at least")
    indices = []
    for position in positions:
        same = np.flatnonzero(
            [p.shape == position.shape and bool((p == position).all()) for p in estimate.positions]
        )
        if not same.size:
            raise InvalidInput(
                f"{path}: a fit used position [{', '.join(f'{x:.5g}' for x in position)}], which "
                "the estimate does not have"
            )
        indices.append(int(same[0]))
    return np.array(indices)
