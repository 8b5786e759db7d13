"""What to measure: candidate positions, their information, and optimal designs.

Names are loaded when used, so that ``import oed`` stays fast.
"""

from typing import TYPE_CHECKING

from robotmodels.lazy_names import loaded_when_used

if TYPE_CHECKING:
    from oed.candidate_information import information
    from oed.candidates.grids import candidate_positions, sobol_positions
    from oed.candidates.position_files import read_positions
    from oed.candidates.screening import Removal, ScreenedCandidates, screened_candidates
    from oed.candidates.sources import Workcell, gathered_candidates
    from oed.candidates.task_space import TaskBox, TaskPositions, task_space_positions
    from oed.design.certificate import efficiency_bound, optimality_gap
    from oed.design.constraints import Constraints, Group
    from oed.design.criteria import (
        AsCriterion,
        CCriterion,
        DsCriterion,
        ICriterion,
        MixtureCriterion,
    )
    from oed.design.predictions import log_frf_gradients, log_resonance_gradients, prediction_matrix
    from oed.design.relaxed import Design, optimal_design
    from oed.design.robust import (
        AverageCriterion,
        InformationSamples,
        MaximinCriterion,
        RobustDesign,
        robust_design,
    )
    from oed.design.sensor_rows import sensor_information
    from oed.design.sensors import Sensor, SensorDesign, optimal_sensors
    from oed.design.spectra import LineLimit
    from oed.design.spectrum import SpectrumDesign, optimal_spectrum
    from oed.design.spectrum_lines import line_information, speed_cost
    from oed.experiment.crest import crest_factor, reduced_crest
    from oed.experiment.moves import Move, MoveLimits, move
    from oed.experiment.multisine import Multisine, band_multisine, fourier_matrix, random_phases
    from oed.experiment.peaks import Peaks, predicted_peaks
    from oed.experiment.plan import ExperimentPlan, experiment_plan
    from oed.experiment.plan_export import export_csv, export_mat
    from oed.experiment.scaling import Binding, Limits, Scaling, scale
    from oed.information_set import InformationSet
    from oed.plans.branch_and_bound import BestPlans, best_plans
    from oed.plans.climbing import Region
    from oed.plans.exact import ExactDesign, exact_design
    from oed.plans.order import VisitingOrder, visiting_order
    from oed.plans.refine import RefinedDesign, refined_design, refined_over
    from oed.plans.scoring import Addition, Score, score
    from oed.plans.sequential import (
        ExperimentCurve,
        Needed,
        NextExperiments,
        experiment_curve,
        experiments_needed,
        measured_information,
        next_experiments,
    )
    from oed.store import StoredInformation
    from oed.trials.comparison import compare_plans
    from oed.trials.outcome import PlanComparison, PlanTrial
    from oed.trials.rivals import even_plan, grid_plan, random_plan

_HOMES = {
    "Addition": "plans.scoring",
    "AsCriterion": "design.criteria",
    "AverageCriterion": "design.robust",
    "BestPlans": "plans.branch_and_bound",
    "Binding": "experiment.scaling",
    "CCriterion": "design.criteria",
    "Constraints": "design.constraints",
    "Design": "design.relaxed",
    "DsCriterion": "design.criteria",
    "ExactDesign": "plans.exact",
    "ExperimentCurve": "plans.sequential",
    "ExperimentPlan": "experiment.plan",
    "Group": "design.constraints",
    "ICriterion": "design.criteria",
    "InformationSamples": "design.robust",
    "InformationSet": "information_set",
    "Limits": "experiment.scaling",
    "LineLimit": "design.spectra",
    "MaximinCriterion": "design.robust",
    "MixtureCriterion": "design.criteria",
    "Move": "experiment.moves",
    "MoveLimits": "experiment.moves",
    "Multisine": "experiment.multisine",
    "Needed": "plans.sequential",
    "NextExperiments": "plans.sequential",
    "Peaks": "experiment.peaks",
    "PlanComparison": "trials.outcome",
    "PlanTrial": "trials.outcome",
    "RefinedDesign": "plans.refine",
    "Region": "plans.climbing",
    "Removal": "candidates.screening",
    "RobustDesign": "design.robust",
    "Scaling": "experiment.scaling",
    "Score": "plans.scoring",
    "ScreenedCandidates": "candidates.screening",
    "Sensor": "design.sensors",
    "SensorDesign": "design.sensors",
    "SpectrumDesign": "design.spectrum",
    "StoredInformation": "store",
    "TaskBox": "candidates.task_space",
    "TaskPositions": "candidates.task_space",
    "VisitingOrder": "plans.order",
    "Workcell": "candidates.sources",
    "band_multisine": "experiment.multisine",
    "best_plans": "plans.branch_and_bound",
    "candidate_positions": "candidates.grids",
    "compare_plans": "trials.comparison",
    "crest_factor": "experiment.crest",
    "efficiency_bound": "design.certificate",
    "even_plan": "trials.rivals",
    "exact_design": "plans.exact",
    "experiment_curve": "plans.sequential",
    "experiment_plan": "experiment.plan",
    "experiments_needed": "plans.sequential",
    "export_csv": "experiment.plan_export",
    "export_mat": "experiment.plan_export",
    "fourier_matrix": "experiment.multisine",
    "gathered_candidates": "candidates.sources",
    "grid_plan": "trials.rivals",
    "information": "candidate_information",
    "line_information": "design.spectrum_lines",
    "log_frf_gradients": "design.predictions",
    "log_resonance_gradients": "design.predictions",
    "measured_information": "plans.sequential",
    "move": "experiment.moves",
    "next_experiments": "plans.sequential",
    "optimal_design": "design.relaxed",
    "optimal_sensors": "design.sensors",
    "optimal_spectrum": "design.spectrum",
    "optimality_gap": "design.certificate",
    "predicted_peaks": "experiment.peaks",
    "prediction_matrix": "design.predictions",
    "random_phases": "experiment.multisine",
    "random_plan": "trials.rivals",
    "read_positions": "candidates.position_files",
    "reduced_crest": "experiment.crest",
    "refined_design": "plans.refine",
    "refined_over": "plans.refine",
    "robust_design": "design.robust",
    "scale": "experiment.scaling",
    "score": "plans.scoring",
    "screened_candidates": "candidates.screening",
    "sensor_information": "design.sensor_rows",
    "sobol_positions": "candidates.grids",
    "speed_cost": "design.spectrum_lines",
    "task_space_positions": "candidates.task_space",
    "visiting_order": "plans.order",
}

__all__ = [
    "Addition",
    "AsCriterion",
    "AverageCriterion",
    "BestPlans",
    "Binding",
    "CCriterion",
    "Constraints",
    "Design",
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
    "MaximinCriterion",
    "MixtureCriterion",
    "Move",
    "MoveLimits",
    "Multisine",
    "Needed",
    "NextExperiments",
    "Peaks",
    "PlanComparison",
    "PlanTrial",
    "RefinedDesign",
    "Region",
    "Removal",
    "RobustDesign",
    "Scaling",
    "Score",
    "ScreenedCandidates",
    "Sensor",
    "SensorDesign",
    "SpectrumDesign",
    "StoredInformation",
    "TaskBox",
    "TaskPositions",
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
