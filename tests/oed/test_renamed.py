"""Old names of this package's attributes, keywords and classes work with a warning."""

import numpy as np
import pytest
from random_candidates import random_set

import oed
from oed.experiment.plan_files import OrderSection
from oed.plan_comparison.plan_comparison import PlanComparison, SimulatedPlan

INFO = random_set(3, 40, 3, 2)


@pytest.mark.parametrize(
    ("old", "new"), [("PlanTrial", "SimulatedPlan"), ("Needed", "RequiredExperiments")]
)
def test_classes(old, new):
    with pytest.warns(DeprecationWarning, match=f"oed.{old} is now 'oed.{new}'"):
        assert getattr(oed, old) is getattr(oed, new)


@pytest.mark.parametrize(
    ("cls", "old", "new"),
    [
        (oed.InformationSet, "prices", "directional_derivatives"),
        (oed.StoredInformation, "prices", "directional_derivatives"),
        (oed.Objective, "price", "summed_by_sample"),
        (oed.ScreenedCandidates, "kept", "indices"),
        (oed.ScreenedCandidates, "given", "proposed"),
        (oed.SensorDesign, "chosen", "sensors"),
        (oed.SensorDesign, "keep", "relative_efficiency"),
        (SimulatedPlan, "found", "simulation"),
        (SimulatedPlan, "promised", "predicted"),
        (PlanComparison, "promised", "predicted"),
        (PlanComparison, "rivals", "alternatives"),
        (PlanComparison, "found", "simulated"),
        (PlanComparison, "held", "fixed_equilibria"),
        (oed.VisitingOrder, "given", "unordered_duration"),
        (oed.Peaks, "rest", "operating_point"),
    ],
)
def test_attributes(cls, old, new):
    value = cls.__new__(cls)
    if not callable(getattr(cls, new, None)):
        object.__setattr__(value, new, 5)
    with pytest.warns(DeprecationWarning, match=f"{cls.__name__}.{old} is now '{new}'"):
        assert getattr(value, old) == getattr(value, new)


def test_prior_information_by_its_old_keyword():
    plan = oed.next_experiments(INFO, 3, prior=np.eye(3)).plan
    with pytest.warns(DeprecationWarning, match="next_experiments: keyword 'known' is now 'prior'"):
        same = oed.next_experiments(INFO, 3, known=np.eye(3)).plan
    assert same.repetitions.tolist() == plan.repetitions.tolist()


def test_plans_of_a_comparison_by_their_old_name():
    comparison = PlanComparison("D", "plan", ("other",), 1.0, 1.0, 1.0, True)
    with pytest.warns(DeprecationWarning, match="plans"):
        assert comparison.trials == ("plan", "other")


def test_order_of_a_plan_file_by_its_old_key():
    content = {"order": [1, 0], "duration": 2.0, "optimal": True}
    with pytest.warns(DeprecationWarning, match="'given' is now 'unordered_duration'"):
        section = OrderSection.model_validate(content | {"given": 3.0})
    assert section == OrderSection.model_validate(content | {"unordered_duration": 3.0})
