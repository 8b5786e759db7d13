"""What to measure: candidate positions, their information, and optimal designs.

Names are loaded when used, so that ``import oed`` stays fast.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from oed.branch_and_bound import BestPlans, best_plans
    from oed.candidate_sources import Workcell, gathered_candidates
    from oed.candidates import candidate_positions, sobol_positions
    from oed.certificate import efficiency_bound, optimality_gap
    from oed.constraints import Constraints, Group
    from oed.crest import crest_factor, reduced_crest
    from oed.criteria import AsCriterion, CCriterion, DsCriterion, ICriterion, MixtureCriterion
    from oed.exact import ExactDesign, exact_design
    from oed.information_set import InformationSet, information
    from oed.moves import Move, MoveLimits, move
    from oed.multisine import Multisine, band_multisine, fourier_matrix, random_phases
    from oed.order import VisitingOrder, visiting_order
    from oed.peaks import Peaks, predicted_peaks
    from oed.plan import ExperimentPlan, experiment_plan
    from oed.plan_export import export_csv, export_mat
    from oed.position_files import read_positions
    from oed.predictions import log_frf_gradients, log_resonance_gradients, prediction_matrix
    from oed.refine import RefinedDesign, Region, refined_design, refined_over
    from oed.relaxed import Design, optimal_design
    from oed.robust import (
        AverageCriterion,
        InformationSamples,
        MaximinCriterion,
        RobustDesign,
        robust_design,
    )
    from oed.scaling import Binding, Limits, Scaling, scale
    from oed.scoring import Addition, Score, score
    from oed.screening import Removal, ScreenedCandidates, screened_candidates
    from oed.sensors import Sensor, SensorDesign, optimal_sensors
    from oed.sequential import (
        ExperimentCurve,
        Needed,
        NextExperiments,
        experiment_curve,
        experiments_needed,
        measured_information,
        next_experiments,
    )
    from oed.spectrum import LineLimit, SpectrumDesign, optimal_spectrum
    from oed.spectrum_lines import line_information, speed_cost
    from oed.store import StoredInformation
    from oed.task_space import TaskBox, TaskPositions, task_space_positions

_HOMES = {
    "Addition": "scoring",
    "AsCriterion": "criteria",
    "AverageCriterion": "robust",
    "BestPlans": "branch_and_bound",
    "Binding": "scaling",
    "CCriterion": "criteria",
    "Constraints": "constraints",
    "Design": "relaxed",
    "DsCriterion": "criteria",
    "ExactDesign": "exact",
    "ExperimentCurve": "sequential",
    "ExperimentPlan": "plan",
    "Group": "constraints",
    "ICriterion": "criteria",
    "InformationSamples": "robust",
    "InformationSet": "information_set",
    "Limits": "scaling",
    "LineLimit": "spectrum",
    "MaximinCriterion": "robust",
    "MixtureCriterion": "criteria",
    "Move": "moves",
    "MoveLimits": "moves",
    "Multisine": "multisine",
    "Needed": "sequential",
    "NextExperiments": "sequential",
    "Peaks": "peaks",
    "RefinedDesign": "refine",
    "Region": "refine",
    "Removal": "screening",
    "RobustDesign": "robust",
    "Scaling": "scaling",
    "Score": "scoring",
    "ScreenedCandidates": "screening",
    "Sensor": "sensors",
    "SensorDesign": "sensors",
    "SpectrumDesign": "spectrum",
    "StoredInformation": "store",
    "TaskBox": "task_space",
    "TaskPositions": "task_space",
    "VisitingOrder": "order",
    "Workcell": "candidate_sources",
    "band_multisine": "multisine",
    "best_plans": "branch_and_bound",
    "candidate_positions": "candidates",
    "crest_factor": "crest",
    "efficiency_bound": "certificate",
    "exact_design": "exact",
    "experiment_curve": "sequential",
    "experiment_plan": "plan",
    "experiments_needed": "sequential",
    "export_csv": "plan_export",
    "export_mat": "plan_export",
    "fourier_matrix": "multisine",
    "gathered_candidates": "candidate_sources",
    "information": "information_set",
    "line_information": "spectrum_lines",
    "log_frf_gradients": "predictions",
    "log_resonance_gradients": "predictions",
    "measured_information": "sequential",
    "move": "moves",
    "next_experiments": "sequential",
    "optimal_design": "relaxed",
    "optimal_sensors": "sensors",
    "optimal_spectrum": "spectrum",
    "optimality_gap": "certificate",
    "predicted_peaks": "peaks",
    "prediction_matrix": "predictions",
    "random_phases": "multisine",
    "read_positions": "position_files",
    "reduced_crest": "crest",
    "refined_design": "refine",
    "refined_over": "refine",
    "robust_design": "robust",
    "scale": "scaling",
    "score": "scoring",
    "screened_candidates": "screening",
    "sobol_positions": "candidates",
    "speed_cost": "spectrum_lines",
    "task_space_positions": "task_space",
    "visiting_order": "order",
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
    "crest_factor",
    "efficiency_bound",
    "exact_design",
    "experiment_curve",
    "experiment_plan",
    "experiments_needed",
    "export_csv",
    "export_mat",
    "fourier_matrix",
    "gathered_candidates",
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
    "read_positions",
    "reduced_crest",
    "refined_design",
    "refined_over",
    "robust_design",
    "scale",
    "score",
    "screened_candidates",
    "sobol_positions",
    "speed_cost",
    "task_space_positions",
    "visiting_order",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
