"""FRFs and posteriors as labelled arrays: xarray's Dataset, ArviZ's DataTree."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from estimators.fitting.least_squares import Fit
from estimators.frf.frf_estimate import FrfEstimate, is_full
from estimators.sampling.log_posterior import posterior_density
from estimators.sampling.posterior import Posterior
from robotmodels.common.arrays import Array, check_count, check_kind, check_memory
from robotmodels.common.errors import InvalidInput
from robotmodels.common.extras import install

if TYPE_CHECKING:
    from xarray import Dataset, DataTree

_LINES = ("position", "frequency")
_ELEMENTS = (*_LINES, "output", "input")


def frf_dataset(
    estimate: FrfEstimate,
    outputs: Sequence[str] | None = None,
    inputs: Sequence[str] | None = None,
) -> "Dataset":
    """Return FRFs as a Dataset: `response`, `variance` of its errors, and `angles` of positions.

    Parameters
    ----------
    estimate : FrfEstimate
        FRFs of Q positions, F frequencies, m outputs and n inputs.
    outputs, inputs : sequence of str, optional
        m and n names, as `ElasticRobot.output_names` and `motor_names`; numbers from 1 by default.

    Raises
    ------
    InvalidInput
        If xarray is not installed, or the names are of another number.
    """
    check_kind(estimate, FrfEstimate, "frf_dataset: estimate")
    try:
        import xarray
    except ImportError:
        raise _not_installed("frf_dataset") from None
    coordinates, arrays = _labels(estimate, outputs, inputs), _arrays(estimate)
    names = {name: coordinates[name] for name in _ELEMENTS}
    frequency = xarray.Variable("frequency", names.pop("frequency"), {"units": "Hz"})
    response = (_ELEMENTS, arrays["response"], {"units": "rad/s^2/(N m)", "to": "motor shafts"})
    variance = (_ELEMENTS, arrays["variance"], {"units": "(rad/s^2/(N m))^2"})
    angles = (("position", "motor"), arrays["angles"], {"units": "rad"})
    freedom = ("position", arrays["degrees_of_freedom"], {"units": "complex numbers"})
    return xarray.Dataset(
        {
            "response": response,
            "variance": variance,
            "angles": angles,
            "degrees_of_freedom": freedom,
        },
        {**names, "frequency": frequency, "motor": coordinates["motor"]},
    )


def posterior_tree(fit: Fit, posterior: Posterior, thin: int = 1) -> "DataTree":
    """Return a posterior as the DataTree that ArviZ summarises, compares and plots.

    Groups are ``posterior``: `theta` [SI] by parameter, a chain for each ensemble, its walkers one
    after the other, since only ensembles are independent; ``log_likelihood``: of the lines of each
    position; ``observed_data``: real and imaginary parts of the FRFs; ``constant_data``: variances
    of their errors, angles of positions, weights of the fit where they are no matrices.

    Parameters
    ----------
    fit : Fit
        The fit whose parameters were sampled.
    posterior : Posterior
        Draws, see `sample_posterior`.
    thin : int, optional
        Every so many snapshots of the walkers are taken.

    Raises
    ------
    InvalidInput
        If ArviZ is not installed, the draws are of other parameters, or memory is too small.
    """
    check_kind(fit, Fit, "posterior_tree: fit")
    check_kind(posterior, Posterior, "posterior_tree: posterior")
    try:
        import arviz_base
    except ImportError:
        raise _not_installed("posterior_tree") from None
    if posterior.names != fit.parameters.names:
        raise InvalidInput(
            f"posterior_tree: draws of {posterior.names}; the fit has {fit.parameters.names}"
        )
    theta, estimate, model = _thinned(posterior, thin), fit.estimate, fit.model
    lines = (len(estimate.positions), len(estimate.omega))
    check_memory(
        24.0 * theta[..., 0].size * np.prod(lines), "posterior_tree: a larger `thin` needs less; it"
    )
    density = posterior_density(fit, noise=posterior.noise.kind, scale=posterior.noise.scale)
    likelihood = density.line_log_likelihood(theta.reshape(-1, theta.shape[-1]))
    arrays = _arrays(estimate)
    response = arrays.pop("response")
    if not is_full(fit.weights, response.shape):
        arrays["weights"] = np.asarray(fit.weights)
    tree: Any = arviz_base.from_dict(
        {
            "posterior": {"theta": theta},
            "log_likelihood": {"response": likelihood.reshape(*theta.shape[:2], *lines)},
            "observed_data": {"real": response.real, "imaginary": response.imag},
            "constant_data": arrays,
        },
        coords={
            "parameter": list(posterior.names),
            **_labels(
                estimate,
                getattr(model, "output_names", None),
                getattr(model, "motor_names", None),
            ),
        },
        dims={
            "theta": ["parameter"],
            "response": list(_LINES),
            **{key: list(_ELEMENTS) for key in ("real", "imaginary", "variance", "weights")},
            "angles": ["position", "motor"],
            "degrees_of_freedom": ["position"],
        },
    )
    return tree


def _thinned(posterior: Posterior, thin: int) -> Array:
    """Return theta of an ensemble's walkers one after the other, (ensembles, draws, p)."""
    check_count(thin, "thin")
    chains = np.moveaxis(posterior.chains[:, ::thin], 2, 1)  # ensembles, walkers, snapshots, p
    return np.exp(chains.reshape(len(chains), -1, chains.shape[-1]))


def _arrays(estimate: FrfEstimate) -> dict[str, Any]:
    """Return an estimate's arrays by name; of full covariances the diagonals."""
    shape = estimate.response.shape
    variance = estimate.covariance
    if is_full(variance, shape):
        diagonal = np.diagonal(variance, axis1=-2, axis2=-1).real
        variance = np.swapaxes(diagonal.reshape(*shape[:2], shape[3], shape[2]), 2, 3)
    return {
        "response": estimate.response,
        "variance": variance,
        "angles": estimate.positions,
        "degrees_of_freedom": np.asarray(estimate.degrees_of_freedom),
    }


def _labels(
    estimate: FrfEstimate, outputs: Sequence[str] | None, inputs: Sequence[str] | None
) -> dict[str, Any]:
    """Return the coordinates of all axes."""
    m, n = estimate.response.shape[2:]
    labels: dict[str, Any] = {
        "position": np.arange(len(estimate.positions)),
        "frequency": estimate.omega / (2 * np.pi),
        "motor": np.arange(1, estimate.positions.shape[1] + 1),
    }
    for axis, size, names in (("output", m, outputs), ("input", n, inputs)):
        labels[axis] = list(names) if names is not None else [str(i + 1) for i in range(size)]
        if len(labels[axis]) != size:
            raise InvalidInput(f"{axis}s: {len(labels[axis])} names; the FRFs have {size}")
    if inputs is not None and len(inputs) == estimate.positions.shape[1]:
        labels["motor"] = list(inputs)
    return labels


def _not_installed(function: str) -> InvalidInput:
    return InvalidInput(
        f"{function}: arviz-base and xarray are not installed; {install('arviz')} brings them"
    )
