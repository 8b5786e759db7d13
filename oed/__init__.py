"""What to measure: candidate positions, their information, and optimal designs.

Names are loaded when used, so that ``import oed`` stays fast.
"""

from typing import TYPE_CHECKING

from robotmodels.common.lazy_exports import loaded_when_used

if TYPE_CHECKING:
    from oed.candidates.grids import candidate_positions, sobol_positions
    from oed.candidates.position_files import read_positions
    from oed.candidates.screening import Removal, ScreenedCandidates, screened_candidates
    from oed.candidates.sources import Workcell, gathered_candidates
    from oed.candidates.task_space import TaskBox, TaskPositions, task_space_positions
    from oed.criteria.criteria import (
        AsCriterion,
        CCriterion,
        Criterion,
        DsCriterion,
        ICriterion,
        MixtureCriterion,
    )
    from oed.criteria.matrix_means import MatrixMean
    from oed.criteria.objective import Objective, Term
    from oed.criteria.prediction_variance import (
        log_frf_gradients,
        log_resonance_gradients,
        prediction_matrix,
    )
    from oed.criteria.robust_criteria import AverageCriterion, MaximinCriterion
    from oed.design.certificate import efficiency_bound, optimality_gap
    from oed.design.constraints import Constraints, Group
    from oed.design.cvxpy_solver import Cvxpy
    from oed.design.design import Design
    from oed.design.interior_point import Newton
    from oed.design.optimal_design import optimal_design
    from oed.design.problem import DesignSolver, ScaledProblem, SolverAnswer
    from oed.design.robust_design import RobustDesign, robust_design
    from oed.design.sensors import Sensor, SensorDesign, optimal_sensors
    from oed.design.spectrum import SpectrumDesign, optimal_spectrum
    from oed.design.spectrum_polytope import LineLimit
    from oed.exact.best_plans import BestPlans, best_plans
    from oed.exact.exact_design import ExactDesign, exact_design
    from oed.exact.local_ascent import Region
    from oed.exact.off_grid import RefinedDesign, refined_design, refined_over
    from oed.exact.plan_score import Addition, Score, score
    from oed.exact.sequential import (
        ExperimentCurve,
        Needed,
        NextExperiments,
        experiment_curve,
        experiments_needed,
        measured_information,
        next_experiments,
    )
    from oed.experiment.amplitude_scaling import Binding, Limits, Scaling, scale
    from oed.experiment.draw_plan import crest_factor, experiment_plan, reduced_crest
    from oed.experiment.experiment_plan import ExperimentPlan
    from oed.experiment.moves import Move, MoveLimits, move
    from oed.experiment.multisine import Multisine, band_multisine, fourier_matrix, random_phases
    from oed.experiment.plan_export import export_csv, export_mat
    from oed.experiment.predicted_peaks import Peaks, predicted_peaks
    from oed.experiment.run_experiment import Plant, SimulatedPlant, run_plan
    from oed.experiment.visiting_order import VisitingOrder, visiting_order
    from oed.information_sets.candidates import InformationSamples
    from oed.information_sets.compute import information
    from oed.information_sets.information_set import InformationSet
    from oed.information_sets.per_line import line_information, speed_cost
    from oed.information_sets.per_sensor import sensor_information
    from oed.information_sets.stored_information import StoredInformation
    from oed.plan_comparison.baseline_plans import even_plan, grid_plan, random_plan
    from oed.plan_comparison.compare_plans import compare_plans
    from oed.plan_comparison.plan_comparison import PlanComparison, PlanTrial

_HOMES = {
    "Addition": "exact.plan_score",
    "AsCriterion": "criteria.criteria",
    "AverageCriterion": "criteria.robust_criteria",
    "BestPlans": "exact.best_plans",
    "Binding": "experiment.amplitude_scaling",
    "CCriterion": "criteria.criteria",
    "Constraints": "design.constraints",
    "Criterion": "criteria.criteria",
    "Cvxpy": "design.cvxpy_solver",
    "Design": "design.design",
    "DesignSolver": "design.problem",
    "DsCriterion": "criteria.criteria",
    "ExactDesign": "exact.exact_design",
    "ExperimentCurve": "exact.sequential",
    "ExperimentPlan": "experiment.experiment_plan",
    "Group": "design.constraints",
    "ICriterion": "criteria.criteria",
    "InformationSamples": "information_sets.candidates",
    "InformationSet": "information_sets.information_set",
    "Limits": "experiment.amplitude_scaling",
    "LineLimit": "design.spectrum_polytope",
    "MatrixMean": "criteria.matrix_means",
    "MaximinCriterion": "criteria.robust_criteria",
    "MixtureCriterion": "criteria.criteria",
    "Move": "experiment.moves",
    "MoveLimits": "experiment.moves",
    "Multisine": "experiment.multisine",
    "Needed": "exact.sequential",
    "Newton": "design.interior_point",
    "NextExperiments": "exact.sequential",
    "Objective": "criteria.objective",
    "Peaks": "experiment.predicted_peaks",
    "PlanComparison": "plan_comparison.plan_comparison",
    "PlanTrial": "plan_comparison.plan_comparison",
    "Plant": "experiment.run_experiment",
    "RefinedDesign": "exact.off_grid",
    "Region": "exact.local_ascent",
    "Removal": "candidates.screening",
    "RobustDesign": "design.robust_design",
    "ScaledProblem": "design.problem",
    "Scaling": "experiment.amplitude_scaling",
    "Score": "exact.plan_score",
    "ScreenedCandidates": "candidates.screening",
    "Sensor": "design.sensors",
    "SensorDesign": "design.sensors",
    "SimulatedPlant": "experiment.run_experiment",
    "SolverAnswer": "design.problem",
    "SpectrumDesign": "design.spectrum",
    "StoredInformation": "information_sets.stored_information",
    "TaskBox": "candidates.task_space",
    "TaskPositions": "candidates.task_space",
    "Term": "criteria.objective",
    "VisitingOrder": "experiment.visiting_order",
    "Workcell": "candidates.sources",
    "band_multisine": "experiment.multisine",
    "best_plans": "exact.best_plans",
    "candidate_positions": "candidates.grids",
    "compare_plans": "plan_comparison.compare_plans",
    "crest_factor": "experiment.draw_plan",
    "efficiency_bound": "design.certificate",
    "even_plan": "plan_comparison.baseline_plans",
    "exact_design": "exact.exact_design",
    "experiment_curve": "exact.sequential",
    "experiment_plan": "experiment.draw_plan",
    "experiments_needed": "exact.sequential",
    "export_csv": "experiment.plan_export",
    "export_mat": "experiment.plan_export",
    "fourier_matrix": "experiment.multisine",
    "gathered_candidates": "candidates.sources",
    "grid_plan": "plan_comparison.baseline_plans",
    "information": "information_sets.compute",
    "line_information": "information_sets.per_line",
    "log_frf_gradients": "criteria.prediction_variance",
    "log_resonance_gradients": "criteria.prediction_variance",
    "measured_information": "exact.sequential",
    "move": "experiment.moves",
    "next_experiments": "exact.sequential",
    "optimal_design": "design.optimal_design",
    "optimal_sensors": "design.sensors",
    "optimal_spectrum": "design.spectrum",
    "optimality_gap": "design.certificate",
    "predicted_peaks": "experiment.predicted_peaks",
    "prediction_matrix": "criteria.prediction_variance",
    "random_phases": "experiment.multisine",
    "random_plan": "plan_comparison.baseline_plans",
    "read_positions": "candidates.position_files",
    "reduced_crest": "experiment.draw_plan",
    "refined_design": "exact.off_grid",
    "refined_over": "exact.off_grid",
    "robust_design": "design.robust_design",
    "run_plan": "experiment.run_experiment",
    "scale": "experiment.amplitude_scaling",
    "score": "exact.plan_score",
    "screened_candidates": "candidates.screening",
    "sensor_information": "information_sets.per_sensor",
    "sobol_positions": "candidates.grids",
    "speed_cost": "information_sets.per_line",
    "task_space_positions": "candidates.task_space",
    "visiting_order": "experiment.visiting_order",
}

__all__ = [
    "Addition",
    "AsCriterion",
    "AverageCriterion",
    "BestPlans",
    "Binding",
    "CCriterion",
    "Constraints",
    "Criterion",
    "Cvxpy",
    "Design",
    "DesignSolver",
    "DsCriterion",
    "ExactDesign",
    "ExperimentCurve",
    "ExperimentPlan",
    "Group",
    "ICriterion",
    "InformationSamples",
    "InformationSet",
    "Limits",
    "LineLimit",
    "MatrixMean",
    "MaximinCriterion",
    "MixtureCriterion",
    "Move",
    "MoveLimits",
    "Multisine",
    "Needed",
    "Newton",
    "NextExperiments",
    "Objective",
    "Peaks",
    "PlanComparison",
    "PlanTrial",
    "Plant",
    "RefinedDesign",
    "Region",
    "Removal",
    "RobustDesign",
    "ScaledProblem",
    "Scaling",
    "Score",
    "ScreenedCandidates",
    "Sensor",
    "SensorDesign",
    "SimulatedPlant",
    "SolverAnswer",
    "SpectrumDesign",
    "StoredInformation",
    "TaskBox",
    "TaskPositions",
    "Term",
    "VisitingOrder",
    "Workcell",
    "band_multisine",
    "best_plans",
    "candidate_positions",
    "compare_plans",
    "crest_factor",
    "efficiency_bound",
    "even_plan",
    "exact_design",
    "experiment_curve",
    "experiment_plan",
    "experiments_needed",
    "export_csv",
    "export_mat",
    "fourier_matrix",
    "gathered_candidates",
    "grid_plan",
    "information",
    "line_information",
    "log_frf_gradients",
    "log_resonance_gradients",
    "measured_information",
    "move",
    "next_experiments",
    "optimal_design",
    "optimal_sensors",
    "optimal_spectrum",
    "optimality_gap",
    "predicted_peaks",
    "prediction_matrix",
    "random_phases",
    "random_plan",
    "read_positions",
    "reduced_crest",
    "refined_design",
    "refined_over",
    "robust_design",
    "run_plan",
    "scale",
    "score",
    "screened_candidates",
    "sensor_information",
    "sobol_positions",
    "speed_cost",
    "task_space_positions",
    "visiting_order",
]


__getattr__, __dir__ = loaded_when_used(__name__, _HOMES)
