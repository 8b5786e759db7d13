"""What data say about elastic robots: FRFs, fits, covariances, posteriors.

Public names that need emcee or iminuit are imported when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from estimators.chains.damper_fit import DamperFit, fit_dampers

# Functions that share their module's name must be bound here: importing the module later would
# otherwise put the module in their place.
from estimators.chains.identification import ChainIdentification, identify_chains
from estimators.chains.prediction import predict_masses
from estimators.fitting.chain_start import chain_start_values
from estimators.fitting.fit_files import read_fits, write_fits
from estimators.fitting.least_squares import Fit, fit, reweighted
from estimators.fitting.multistart import EarlyStop, multistart, perturbed_starts
from estimators.fitting.priors import Prior
from estimators.fitting.residual_analysis import ResidualAnalysis, residual_analysis
from estimators.fitting.residuals import lls, lls_magnitude, nls
from estimators.fitting.start_values import physics_start
from estimators.fitting.weights import combined_weights, optimal_weights, user_weights
from estimators.frf.compare import Comparison, Loop, compare_methods, designed_loop, measured_loop
from estimators.frf.distortion import Distortion, distortion
from estimators.frf.estimate import FrfEstimate, simulate_frf
from estimators.frf.exchange import (
    read_distortion,
    read_frf,
    read_records,
    write_distortion,
    write_frf,
    write_records,
)
from estimators.frf.local_model import local_frf
from estimators.frf.nonparametric import estimate_frf
from estimators.frf.rigid_limit import RigidLimit, check_rigid_limit
from estimators.frf.stationarity import Settling, settling
from estimators.information import information
from estimators.uncertainty.convergence import Target
from estimators.uncertainty.covariance import Uncertainty, covariance
from estimators.uncertainty.cross_check import CrossCheck, cross_check
from estimators.uncertainty.design_outcome import DesignOutcome, compare_with_design
from estimators.uncertainty.identifiability import (
    Identifiability,
    best_additions,
    fit_information,
    identifiability,
)
from estimators.uncertainty.misfit import Misfit, misfit
from estimators.uncertainty.monte_carlo import FrfExperiment, MonteCarlo, monte_carlo
from estimators.uncertainty.prediction import (
    FrfBand,
    ModeBand,
    WorkspaceMap,
    predict_frf,
    predict_modes,
    workspace_map,
)
from estimators.uncertainty.validation import Validation, validate

if TYPE_CHECKING:
    from estimators.uncertainty.importance import ImportanceSample, importance_sample
    from estimators.uncertainty.posterior import Posterior, sample_posterior
    from estimators.uncertainty.profile import Profile, profile_likelihood

__all__ = [
    "ChainIdentification",
    "Comparison",
    "CrossCheck",
    "DamperFit",
    "DesignOutcome",
    "Distortion",
    "EarlyStop",
    "Fit",
    "FrfBand",
    "FrfEstimate",
    "FrfExperiment",
    "Identifiability",
    "ImportanceSample",
    "Loop",
    "Misfit",
    "ModeBand",
    "MonteCarlo",
    "Posterior",
    "Prior",
    "Profile",
    "ResidualAnalysis",
    "RigidLimit",
    "Settling",
    "Target",
    "Uncertainty",
    "Validation",
    "WorkspaceMap",
    "best_additions",
    "chain_start_values",
    "check_rigid_limit",
    "combined_weights",
    "compare_methods",
    "compare_with_design",
    "covariance",
    "cross_check",
    "designed_loop",
    "distortion",
    "estimate_frf",
    "fit",
    "fit_dampers",
    "fit_information",
    "identifiability",
    "identify_chains",
    "importance_sample",
    "information",
    "lls",
    "lls_magnitude",
    "local_frf",
    "measured_loop",
    "misfit",
    "monte_carlo",
    "multistart",
    "nls",
    "optimal_weights",
    "perturbed_starts",
    "physics_start",
    "predict_frf",
    "predict_masses",
    "predict_modes",
    "profile_likelihood",
    "read_distortion",
    "read_fits",
    "read_frf",
    "read_records",
    "residual_analysis",
    "reweighted",
    "sample_posterior",
    "settling",
    "simulate_frf",
    "user_weights",
    "validate",
    "workspace_map",
    "write_distortion",
    "write_fits",
    "write_frf",
    "write_records",
]

_LATER = {
    "ImportanceSample": "estimators.uncertainty.importance",
    "Posterior": "estimators.uncertainty.posterior",
    "Profile": "estimators.uncertainty.profile",
    "importance_sample": "estimators.uncertainty.importance",
    "profile_likelihood": "estimators.uncertainty.profile",
    "sample_posterior": "estimators.uncertainty.posterior",
}


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'estimators' has no attribute {name!r}")
    return getattr(import_module(_LATER[name]), name)


def __dir__() -> list[str]:
    return __all__
