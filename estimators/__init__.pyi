from .chain_dampers.damper_fit import DamperFit as DamperFit, fit_dampers as fit_dampers
from .chains.identification import (
    chains_from_frf as chains_from_frf,
    identify_chains as identify_chains,
)
from .chains.identified_chains import (
    ChainIdentification as ChainIdentification,
    predict_masses as predict_masses,
)
from .chains.inverse_eigenvalue import (
    LanczosStep as LanczosStep,
    coupled_inertia as coupled_inertia,
    lanczos_chain as lanczos_chain,
    lanczos_step as lanczos_step,
    without_first_mass as without_first_mass,
)
from .chains.pole_zero_spectra import first_components as first_components
from .chains.start_values_from_chains import chain_start_values as chain_start_values
from .chains.stepwise import StepwiseChain as StepwiseChain, stepwise_chain as stepwise_chain
from .deflection.assumptions import (
    DeflectionAssumptions as DeflectionAssumptions,
    SystematicTerm as SystematicTerm,
    systematic_terms as systematic_terms,
)
from .deflection.fit_deflection import (
    DeflectionFit as DeflectionFit,
    fit_deflection as fit_deflection,
)
from .fitting.fit_files import read_fits as read_fits, write_fits as write_fits
from .fitting.fitted_model import FittedModel as FittedModel
from .fitting.fitted_robot import robot_prior as robot_prior
from .fitting.least_squares import (
    Fit as Fit,
    fit as fit,
    likelihood_fit as likelihood_fit,
    reweighted as reweighted,
)
from .fitting.multistart import (
    EarlyStop as EarlyStop,
    multistart as multistart,
    perturbed_starts as perturbed_starts,
)
from .fitting.priors import Prior as Prior
from .fitting.residuals import lls as lls, lls_magnitude as lls_magnitude, nls as nls
from .fitting.run_fit import RunFit as RunFit
from .fitting.sandwich import information as information
from .fitting.settled_runs import (
    runs_at as runs_at,
    settled_fit as settled_fit,
    settled_runs as settled_runs,
)
from .fitting.start_values import StartValues as StartValues, physics_start as physics_start
from .fitting.weights import (
    combined_weights as combined_weights,
    optimal_weights as optimal_weights,
    user_weights as user_weights,
)
from .frf.distortion import Distortion as Distortion, distortion as distortion
from .frf.estimate_frf import estimate_frf as estimate_frf
from .frf.excitation import Excitation as Excitation, excitation as excitation
from .frf.file_formats import (
    read_distortion as read_distortion,
    read_frf as read_frf,
    read_records as read_records,
    write_distortion as write_distortion,
    write_frf as write_frf,
    write_records as write_records,
)
from .frf.frf_estimate import FrfEstimate as FrfEstimate, simulate_frf as simulate_frf
from .frf.local_rational_model import local_frf as local_frf
from .frf.method_comparison import (
    Loop as Loop,
    MethodComparison as MethodComparison,
    compare_methods as compare_methods,
    designed_loop as designed_loop,
    measured_loop as measured_loop,
)
from .frf.record_checks import Settling as Settling, settling as settling
from .frf.rigid_body_check import RigidLimit as RigidLimit, check_rigid_limit as check_rigid_limit
from .frf.torque_loop import TorqueLoop as TorqueLoop, torque_loop as torque_loop
from .input_output.run_frf import check_rigid_runs as check_rigid_runs
from .input_output.run_spectra import RunSpectra as RunSpectra, run_spectra as run_spectra
from .sampling.convergence import StoppingCriterion as StoppingCriterion
from .sampling.exported_draws import export_draws as export_draws
from .sampling.importance_sampling import (
    ImportanceSample as ImportanceSample,
    importance_sample as importance_sample,
)
from .sampling.labelled_data import frf_dataset as frf_dataset, posterior_tree as posterior_tree
from .sampling.posterior import Posterior as Posterior, sample_posterior as sample_posterior
from .sampling.profile_likelihood import (
    Profile as Profile,
    profile_likelihood as profile_likelihood,
)
from .structure.choose_structure import (
    StructureChoice as StructureChoice,
    StructureStep as StructureStep,
    choose_structure as choose_structure,
)
from .structure.power import (
    StructurePower as StructurePower,
    structure_power as structure_power,
)
from .structure.score_table import Score as Score, ScoreTable as ScoreTable
from .structure.score_tests import score_tests as score_tests
from .trust.intervals import VERDICTS as VERDICTS, Interval as Interval, Verdict as Verdict
from .trust.trust import Trust as Trust
from .uncertainty.covariance import Uncertainty as Uncertainty, covariance as covariance
from .uncertainty.identifiability import (
    Identifiability as Identifiability,
    fit_information as fit_information,
    identifiability as identifiability,
)
from .uncertainty.next_measurements import (
    DesignOutcome as DesignOutcome,
    best_additions as best_additions,
    compare_with_design as compare_with_design,
)
from .uncertainty.recommended import recommended_uncertainty as recommended_uncertainty
from .uncertainty.residual_analysis import (
    ResidualAnalysis as ResidualAnalysis,
    residual_analysis as residual_analysis,
)
from .validation.cross_check import CrossCheck as CrossCheck, cross_check as cross_check
from .validation.held_out_positions import Validation as Validation, validate as validate
from .validation.margin_bands import (
    MarginBand as MarginBand,
    Suggestion as Suggestion,
    predict_margins as predict_margins,
    suggestions as suggestions,
)
from .validation.monte_carlo import MonteCarlo as MonteCarlo, monte_carlo as monte_carlo
from .validation.predict import (
    Prediction as Prediction,
    predict as predict,
)
from .validation.prediction import (
    FrfBand as FrfBand,
    ModeBand as ModeBand,
    WorkspaceMap as WorkspaceMap,
    predict_frf as predict_frf,
    predict_modes as predict_modes,
    workspace_map as workspace_map,
)
from .validation.quantities import (
    DampingRatios as DampingRatios,
    Quantity as Quantity,
    Resonances as Resonances,
    ToolCompliance as ToolCompliance,
    ToolResponse as ToolResponse,
    log_gradients as log_gradients,
)
from .validation.simulated_experiment import FrfExperiment as FrfExperiment
