"""What data say about elastic robots: FRFs, fits, covariances, posteriors.

Names are loaded when used, so that ``import estimators`` stays fast.
"""

from typing import TYPE_CHECKING

from robotmodels.common.lazy_exports import loaded_when_used

if TYPE_CHECKING:
    from estimators.chain_dampers.damper_fit import DamperFit, fit_dampers
    from estimators.chains.identification import chains_from_frf, identify_chains
    from estimators.chains.identified_chains import ChainIdentification, predict_masses
    from estimators.chains.start_values_from_chains import chain_start_values
    from estimators.fitting.fit_files import read_fits, write_fits
    from estimators.fitting.least_squares import Fit, fit, likelihood_fit, reweighted
    from estimators.fitting.multistart import EarlyStop, multistart, perturbed_starts
    from estimators.fitting.priors import Prior
    from estimators.fitting.residuals import lls, lls_magnitude, nls
    from estimators.fitting.start_values import StartValues, physics_start
    from estimators.fitting.weights import combined_weights, optimal_weights, user_weights
    from estimators.frf.distortion import Distortion, distortion
    from estimators.frf.estimate_frf import estimate_frf
    from estimators.frf.file_formats import (
        read_distortion,
        read_frf,
        read_records,
        write_distortion,
        write_frf,
        write_records,
    )
    from estimators.frf.frf_estimate import FrfEstimate, simulate_frf
    from estimators.frf.local_rational_model import local_frf
    from estimators.frf.method_comparison import (
        Comparison,
        Loop,
        compare_methods,
        designed_loop,
        measured_loop,
    )
    from estimators.frf.record_checks import Settling, settling
    from estimators.frf.rigid_body_check import RigidLimit, check_rigid_limit
    from estimators.sampling.convergence import Target
    from estimators.sampling.importance_sampling import ImportanceSample, importance_sample
    from estimators.sampling.posterior import Posterior, sample_posterior
    from estimators.sampling.profile_likelihood import Profile, profile_likelihood
    from estimators.trust.intervals import VERDICTS, Interval, Verdict
    from estimators.trust.trust import Trust
    from estimators.uncertainty.covariance import Uncertainty, covariance
    from estimators.uncertainty.identifiability import (
        Identifiability,
        fit_information,
        identifiability,
    )
    from estimators.uncertainty.next_measurements import (
        DesignOutcome,
        best_additions,
        compare_with_design,
    )
    from estimators.uncertainty.residual_analysis import ResidualAnalysis, residual_analysis
    from estimators.uncertainty.sandwich import information
    from estimators.validation.cross_check import CrossCheck, cross_check
    from estimators.validation.held_out_positions import Validation, validate
    from estimators.validation.monte_carlo import MonteCarlo, monte_carlo
    from estimators.validation.prediction import (
        FrfBand,
        ModeBand,
        WorkspaceMap,
        predict_frf,
        predict_modes,
        workspace_map,
    )
    from estimators.validation.simulated_experiment import FrfExperiment

_HOMES = {
    "ChainIdentification": "chains.identified_chains",
    "Comparison": "frf.method_comparison",
    "CrossCheck": "validation.cross_check",
    "DamperFit": "chain_dampers.damper_fit",
    "DesignOutcome": "uncertainty.next_measurements",
    "Distortion": "frf.distortion",
    "EarlyStop": "fitting.multistart",
    "Fit": "fitting.least_squares",
    "FrfBand": "validation.prediction",
    "FrfEstimate": "frf.frf_estimate",
    "FrfExperiment": "validation.simulated_experiment",
    "Identifiability": "uncertainty.identifiability",
    "ImportanceSample": "sampling.importance_sampling",
    "Interval": "trust.intervals",
    "Loop": "frf.method_comparison",
    "ModeBand": "validation.prediction",
    "MonteCarlo": "validation.monte_carlo",
    "Posterior": "sampling.posterior",
    "Prior": "fitting.priors",
    "Profile": "sampling.profile_likelihood",
    "ResidualAnalysis": "uncertainty.residual_analysis",
    "RigidLimit": "frf.rigid_body_check",
    "Settling": "frf.record_checks",
    "StartValues": "fitting.start_values",
    "Target": "sampling.convergence",
    "Trust": "trust.trust",
    "Uncertainty": "uncertainty.covariance",
    "VERDICTS": "trust.intervals",
    "Validation": "validation.held_out_positions",
    "Verdict": "trust.intervals",
    "WorkspaceMap": "validation.prediction",
    "best_additions": "uncertainty.next_measurements",
    "chain_start_values": "chains.start_values_from_chains",
    "check_rigid_limit": "frf.rigid_body_check",
    "combined_weights": "fitting.weights",
    "compare_methods": "frf.method_comparison",
    "compare_with_design": "uncertainty.next_measurements",
    "covariance": "uncertainty.covariance",
    "cross_check": "validation.cross_check",
    "designed_loop": "frf.method_comparison",
    "distortion": "frf.distortion",
    "estimate_frf": "frf.estimate_frf",
    "fit": "fitting.least_squares",
    "fit_dampers": "chain_dampers.damper_fit",
    "fit_information": "uncertainty.identifiability",
    "identifiability": "uncertainty.identifiability",
    "chains_from_frf": "chains.identification",
    "identify_chains": "chains.identification",
    "importance_sample": "sampling.importance_sampling",
    "information": "uncertainty.sandwich",
    "likelihood_fit": "fitting.least_squares",
    "lls": "fitting.residuals",
    "lls_magnitude": "fitting.residuals",
    "local_frf": "frf.local_rational_model",
    "measured_loop": "frf.method_comparison",
    "monte_carlo": "validation.monte_carlo",
    "multistart": "fitting.multistart",
    "nls": "fitting.residuals",
    "optimal_weights": "fitting.weights",
    "perturbed_starts": "fitting.multistart",
    "physics_start": "fitting.start_values",
    "predict_frf": "validation.prediction",
    "predict_masses": "chains.identified_chains",
    "predict_modes": "validation.prediction",
    "profile_likelihood": "sampling.profile_likelihood",
    "read_distortion": "frf.file_formats",
    "read_fits": "fitting.fit_files",
    "read_frf": "frf.file_formats",
    "read_records": "frf.file_formats",
    "residual_analysis": "uncertainty.residual_analysis",
    "reweighted": "fitting.least_squares",
    "sample_posterior": "sampling.posterior",
    "settling": "frf.record_checks",
    "simulate_frf": "frf.frf_estimate",
    "user_weights": "fitting.weights",
    "validate": "validation.held_out_positions",
    "workspace_map": "validation.prediction",
    "write_distortion": "frf.file_formats",
    "write_fits": "fitting.fit_files",
    "write_frf": "frf.file_formats",
    "write_records": "frf.file_formats",
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
