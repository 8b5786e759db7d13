"""What data say about elastic robots: FRFs, fits, covariances, posteriors.

Names are loaded when used, so that ``import estimators`` stays fast.
"""

from typing import TYPE_CHECKING

from robotmodels.lazy_names import loaded_when_used

if TYPE_CHECKING:
    from estimators.chains.damper_fit import DamperFit, fit_dampers
    from estimators.chains.identification import (
        ChainIdentification,
        chains_from_frf,
        identify_chains,
    )
    from estimators.chains.prediction import predict_masses
    from estimators.fisher_information import information
    from estimators.fitting.chain_start import chain_start_values
    from estimators.fitting.fit_files import read_fits, write_fits
    from estimators.fitting.least_squares import Fit, fit, likelihood_fit, reweighted
    from estimators.fitting.multistart import EarlyStop, multistart, perturbed_starts
    from estimators.fitting.priors import Prior
    from estimators.fitting.residuals import lls, lls_magnitude, nls
    from estimators.fitting.start_values import StartValues, physics_start
    from estimators.fitting.weights import combined_weights, optimal_weights, user_weights
    from estimators.frf.compare import (
        Comparison,
        Loop,
        compare_methods,
        designed_loop,
        measured_loop,
    )
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
    from estimators.trust.intervals import VERDICTS, Interval, Verdict
    from estimators.trust.residual_analysis import ResidualAnalysis, residual_analysis
    from estimators.trust.trust import Trust
    from estimators.uncertainty.additions import best_additions
    from estimators.uncertainty.convergence import Target
    from estimators.uncertainty.covariance import Uncertainty, covariance
    from estimators.uncertainty.cross_check import CrossCheck, cross_check
    from estimators.uncertainty.design_outcome import DesignOutcome, compare_with_design
    from estimators.uncertainty.identifiability import (
        Identifiability,
        fit_information,
        identifiability,
    )
    from estimators.uncertainty.importance import ImportanceSample, importance_sample
    from estimators.uncertainty.monte_carlo import MonteCarlo, monte_carlo
    from estimators.uncertainty.posterior import Posterior, sample_posterior
    from estimators.uncertainty.prediction import (
        FrfBand,
        ModeBand,
        WorkspaceMap,
        predict_frf,
        predict_modes,
        workspace_map,
    )
    from estimators.uncertainty.profile import Profile, profile_likelihood
    from estimators.uncertainty.simulated_run import FrfExperiment
    from estimators.uncertainty.validation import Validation, validate

_HOMES = {
    "ChainIdentification": "chains.identification",
    "Comparison": "frf.compare",
    "CrossCheck": "uncertainty.cross_check",
    "DamperFit": "chains.damper_fit",
    "DesignOutcome": "uncertainty.design_outcome",
    "Distortion": "frf.distortion",
    "EarlyStop": "fitting.multistart",
    "Fit": "fitting.least_squares",
    "FrfBand": "uncertainty.prediction",
    "FrfEstimate": "frf.estimate",
    "FrfExperiment": "uncertainty.simulated_run",
    "Identifiability": "uncertainty.identifiability",
    "ImportanceSample": "uncertainty.importance",
    "Interval": "trust.intervals",
    "Loop": "frf.compare",
    "ModeBand": "uncertainty.prediction",
    "MonteCarlo": "uncertainty.monte_carlo",
    "Posterior": "uncertainty.posterior",
    "Prior": "fitting.priors",
    "Profile": "uncertainty.profile",
    "ResidualAnalysis": "trust.residual_analysis",
    "RigidLimit": "frf.rigid_limit",
    "Settling": "frf.stationarity",
    "StartValues": "fitting.start_values",
    "Target": "uncertainty.convergence",
    "Trust": "trust.trust",
    "Uncertainty": "uncertainty.covariance",
    "VERDICTS": "trust.intervals",
    "Validation": "uncertainty.validation",
    "Verdict": "trust.intervals",
    "WorkspaceMap": "uncertainty.prediction",
    "best_additions": "uncertainty.additions",
    "chain_start_values": "fitting.chain_start",
    "check_rigid_limit": "frf.rigid_limit",
    "combined_weights": "fitting.weights",
    "compare_methods": "frf.compare",
    "compare_with_design": "uncertainty.design_outcome",
    "covariance": "uncertainty.covariance",
    "cross_check": "uncertainty.cross_check",
    "designed_loop": "frf.compare",
    "distortion": "frf.distortion",
    "estimate_frf": "frf.nonparametric",
    "fit": "fitting.least_squares",
    "fit_dampers": "chains.damper_fit",
    "fit_information": "uncertainty.identifiability",
    "identifiability": "uncertainty.identifiability",
    "chains_from_frf": "chains.identification",
    "identify_chains": "chains.identification",
    "importance_sample": "uncertainty.importance",
    "information": "fisher_information",
    "likelihood_fit": "fitting.least_squares",
    "lls": "fitting.residuals",
    "lls_magnitude": "fitting.residuals",
    "local_frf": "frf.local_model",
    "measured_loop": "frf.compare",
    "monte_carlo": "uncertainty.monte_carlo",
    "multistart": "fitting.multistart",
    "nls": "fitting.residuals",
    "optimal_weights": "fitting.weights",
    "perturbed_starts": "fitting.multistart",
    "physics_start": "fitting.start_values",
    "predict_frf": "uncertainty.prediction",
    "predict_masses": "chains.prediction",
    "predict_modes": "uncertainty.prediction",
    "profile_likelihood": "uncertainty.profile",
    "read_distortion": "frf.exchange",
    "read_fits": "fitting.fit_files",
    "read_frf": "frf.exchange",
    "read_records": "frf.exchange",
    "residual_analysis": "trust.residual_analysis",
    "reweighted": "fitting.least_squares",
    "sample_posterior": "uncertainty.posterior",
    "settling": "frf.stationarity",
    "simulate_frf": "frf.estimate",
    "user_weights": "fitting.weights",
    "validate": "uncertainty.validation",
    "workspace_map": "uncertainty.prediction",
    "write_distortion": "frf.exchange",
    "write_fits": "fitting.fit_files",
    "write_frf": "frf.exchange",
    "write_records": "frf.exchange",
}

__all__ = [
    "VERDICTS",
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
    "Interval",
    "Loop",
    "ModeBand",
    "MonteCarlo",
    "Posterior",
    "Prior",
    "Profile",
    "ResidualAnalysis",
    "RigidLimit",
    "Settling",
    "StartValues",
    "Target",
    "Trust",
    "Uncertainty",
    "Validation",
    "Verdict",
    "WorkspaceMap",
    "best_additions",
    "chain_start_values",
    "chains_from_frf",
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
    "likelihood_fit",
    "lls",
    "lls_magnitude",
    "local_frf",
    "measured_loop",
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

__getattr__, __dir__ = loaded_when_used(__name__, _HOMES)
