"""FRFs of runs that are as many as inputs: what signs and units of records are checked by."""

import numpy as np

from estimators.frf.frf_estimate import FrfEstimate
from estimators.frf.rigid_body_check import check_rigid_limit
from estimators.input_output.likelihood import RunLikelihood
from estimators.input_output.run_spectra import RunSpectra
from robotmodels.linear.response import Elastic

_CONDITION = 1e6
"""Of the inputs' power at a line, from which on some inputs are combinations of others."""


def frf_of_runs(data: RunSpectra) -> FrfEstimate | None:
    """Return G = Y U^H (U U^H)^-1 with its variances; None where runs do not tell all inputs.

    Errors Y - G U of covariance Sigma give cov vec(G) = (U U^H)^-T x Sigma, whose diagonal is kept.
    """
    likelihood = RunLikelihood(data, row_wise=False)
    outputs, inputs = likelihood.columns
    adjoint = np.conj(np.swapaxes(inputs, -1, -2))
    power = inputs @ adjoint
    if inputs.shape[-1] < inputs.shape[-2] or (np.linalg.cond(power) > _CONDITION).any():
        return None
    inverse = np.linalg.inv(power)
    response = outputs @ adjoint @ inverse
    m, root = outputs.shape[-2], likelihood.noise_root
    errors = root[..., :m, :] - response @ root[..., m:, :]
    of_outputs = (np.abs(errors) ** 2).sum(axis=-1)
    of_inputs = np.diagonal(inverse, axis1=-2, axis2=-1).real
    return FrfEstimate(
        data.positions,
        data.omega,
        response,
        of_outputs[..., :, None] * of_inputs[..., None, :],
        np.ones(len(data.positions), dtype=np.int64),
        degrees_of_freedom=data.degrees_of_freedom,
    )


def check_rigid_runs(data: RunSpectra, model: Elastic) -> None:
    """Warn of signs, units and numberings that the robot contradicts, where runs show FRFs.

    See `estimators.check_rigid_limit`.
    """
    estimate = frf_of_runs(data)
    if estimate is not None:
        check_rigid_limit(estimate, model)
