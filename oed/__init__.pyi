from .campaign.campaign import Campaign as Campaign
from .campaign.simulated import simulate_visits as simulate_visits
from .campaign.status import CampaignStatus as CampaignStatus
from .campaign.visits import Visit as Visit
from .candidates.grids import (
    candidate_positions as candidate_positions,
    sobol_positions as sobol_positions,
)
from .candidates.screening import (
    Removal as Removal,
    ScreenedCandidates as ScreenedCandidates,
    screened_candidates as screened_candidates,
)
from .candidates.sources import (
    Workcell as Workcell,
    gathered_candidates as gathered_candidates,
    read_positions as read_positions,
)
from .candidates.task_space import (
    TaskBox as TaskBox,
    TaskPositions as TaskPositions,
    task_space_positions as task_space_positions,
)
from .criteria.criteria import (
    AsCriterion as AsCriterion,
    CCriterion as CCriterion,
    Criterion as Criterion,
    DsCriterion as DsCriterion,
    ICriterion as ICriterion,
    MixtureCriterion as MixtureCriterion,
)
from .criteria.matrix_means import MatrixMean as MatrixMean
from .criteria.objective import Objective as Objective, Term as Term
from .criteria.prediction_variance import (
    log_frf_gradients as log_frf_gradients,
    log_resonance_gradients as log_resonance_gradients,
    prediction_matrix as prediction_matrix,
    purpose_criterion as purpose_criterion,
)
from .criteria.robust_criteria import (
    AverageCriterion as AverageCriterion,
    MaximinCriterion as MaximinCriterion,
)
from .criteria.targets import TargetCriterion as TargetCriterion
from .design.certificate import (
    efficiency_bound as efficiency_bound,
    optimality_gap as optimality_gap,
)
from .design.constraints import Constraints as Constraints, Group as Group
from .design.cvxpy_solver import Cvxpy as Cvxpy
from .design.design import Design as Design
from .design.fastest_design import (
    FastestDesign as FastestDesign,
    fastest_design as fastest_design,
)
from .design.interior_point import Newton as Newton
from .design.optimal_design import optimal_design as optimal_design
from .design.optimal_spectra import (
    SpectraDesign as SpectraDesign,
    optimal_spectra as optimal_spectra,
)
from .design.problem import (
    DesignSolver as DesignSolver,
    ScaledProblem as ScaledProblem,
    SolverAnswer as SolverAnswer,
)
from .design.robust_design import RobustDesign as RobustDesign, robust_design as robust_design
from .design.sensors import (
    Sensor as Sensor,
    SensorDesign as SensorDesign,
    optimal_sensors as optimal_sensors,
)
from .design.spectrum import SpectrumDesign as SpectrumDesign, optimal_spectrum as optimal_spectrum
from .design.spectrum_polytope import LineLimit as LineLimit
from .exact.best_plans import BestPlans as BestPlans, best_plans as best_plans
from .exact.design_dataset import design_dataset as design_dataset
from .exact.exact_design import ExactDesign as ExactDesign, exact_design as exact_design
from .exact.local_ascent import Region as Region
from .exact.off_grid import (
    RefinedDesign as RefinedDesign,
    refined_design as refined_design,
    refined_over as refined_over,
)
from .exact.plan_score import Addition as Addition, Score as Score, score as score
from .exact.sequential import (
    ExperimentCurve as ExperimentCurve,
    NextExperiments as NextExperiments,
    RequiredExperiments as RequiredExperiments,
    experiment_curve as experiment_curve,
    experiments_needed as experiments_needed,
    measured_information as measured_information,
    next_experiments as next_experiments,
)
from .exact.visit_plan import (
    TimeCurve as TimeCurve,
    VisitPlan as VisitPlan,
    fastest_visit_plan as fastest_visit_plan,
    time_curve as time_curve,
    visit_plan as visit_plan,
)
from .experiment.amplitude_scaling import (
    Binding as Binding,
    Scaling as Scaling,
    scale as scale,
)
from .experiment.draw_plan import (
    experiment_plan as experiment_plan,
    reduced_crest as reduced_crest,
)
from .experiment.experiment_plan import ExperimentPlan as ExperimentPlan
from .experiment.limits import Limits as Limits
from .experiment.moves import Move as Move, MoveLimits as MoveLimits, move as move
from .experiment.multisine import (
    Multisine as Multisine,
    band_multisine as band_multisine,
    crest_factor as crest_factor,
    fourier_matrix as fourier_matrix,
    random_phases as random_phases,
)
from .experiment.plan_export import (
    export_csv as export_csv,
    export_mat as export_mat,
    export_trajectory as export_trajectory,
)
from .experiment.predicted_peaks import Peaks as Peaks, predicted_peaks as predicted_peaks
from .experiment.run_experiment import (
    Plant as Plant,
    SimulatedPlant as SimulatedPlant,
    run_plan as run_plan,
)
from .experiment.visiting_order import (
    VisitingOrder as VisitingOrder,
    visiting_order as visiting_order,
)
from .information_sets.candidates import InformationSamples as InformationSamples
from .information_sets.compute import information as information
from .information_sets.excitations import (
    Excitation as Excitation,
    Orthogonal as Orthogonal,
    RandomPhase as RandomPhase,
    SingleMotor as SingleMotor,
    UserSpectrum as UserSpectrum,
    VisitTiming as VisitTiming,
    Zippered as Zippered,
)
from .information_sets.experiment_candidates import (
    ExperimentCandidates as ExperimentCandidates,
    experiment_candidates as experiment_candidates,
)
from .information_sets.information_set import InformationSet as InformationSet
from .information_sets.line_information import (
    line_information as line_information,
    sensor_information as sensor_information,
    speed_cost as speed_cost,
)
from .information_sets.stored_information import StoredInformation as StoredInformation
from .plan_comparison.baseline_plans import (
    even_plan as even_plan,
    grid_plan as grid_plan,
    random_plan as random_plan,
)
from .plan_comparison.compare_plans import compare_plans as compare_plans
from .plan_comparison.plan_comparison import (
    PlanComparison as PlanComparison,
    SimulatedPlan as SimulatedPlan,
    UnidentifiedPlan as UnidentifiedPlan,
)
