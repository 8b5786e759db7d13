"""What to do next, from information matrices that tell it by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from estimators.trust.intervals import Verdict
from estimators.uncertainty.identifiability import identifiability
from oed.study.next_step import next_step
from oed.study.parts import DesignedPlan, MeasuredData
from oed.study.results import FittedStudy, PlannedStudy
from oed.study.robot_time import RobotTime, growing_time, robot_time

NAMES = ("g1.stiffness", "g1.damping")


def plan_of(*diagonals):
    matrices = np.array([np.diag(one) for one in diagonals], dtype=float)
    return SimpleNamespace(
        used=np.arange(len(matrices)),
        visit_share=1.0,
        information=SimpleNamespace(take=lambda indices: matrices[indices], names=NAMES),
        predicted=identifiability(matrices.sum(axis=0), NAMES),
    )


def fitted(verdict, plan, outlying=()):
    """Return a fit whose information is that of the plan."""
    information = plan.information.take(plan.used).sum(axis=0)
    trust = SimpleNamespace(
        verdict=Verdict(verdict, "why"),
        names=NAMES,
        std=1 / np.sqrt(np.diag(information)),
    )
    fits = SimpleNamespace(
        result=SimpleNamespace(trust=trust),
        information=information,
        residuals=SimpleNamespace(outlying=np.array(outlying, dtype=int)),
        identifiability=identifiability(information, NAMES),
    )
    return FittedStudy(study=None, robot=None, plan=plan, run=None, data=None, fits=fits)


def test_precise_parameters_need_nothing():
    step = next_step(fitted("trustworthy", plan_of([1e4, 0], [0, 1e4])))
    assert (step.action, step.positions) == ("none", ())


def test_the_positions_that_tell_most_of_an_imprecise_parameter_are_measured_again():
    step = next_step(fitted("trustworthy", plan_of([1e4, 1], [0, 16], [0, 8])))
    assert step.action == "measure again"
    assert "g1.damping" in step.sentence
    assert "g1.stiffness" not in step.sentence
    # 25 of information in all; the second position adds 16 twice: sqrt(57 / 25) = 1.51.
    assert step.positions == (2,)
    assert "about 1.5" in step.sentence


def test_a_model_error_in_one_position_is_measured_again_and_elsewhere_the_model_is_wrong():
    plan = plan_of([1e4, 0], [0, 1e4], [1, 1])
    step = next_step(fitted("model error", plan, outlying=[2]))
    assert (step.action, step.positions) == ("measure again", (3,))
    step = next_step(fitted("model error", plan, outlying=[0, 2]))
    assert step.action == "correct the model"
    assert "oed structure" in step.sentence


@pytest.mark.parametrize(
    ("verdict", "key"), [("not converged", "fit.starts"), ("too few blocks", "degrees of freedom")]
)
def test_settings_are_named(verdict, key):
    assert key in next_step(fitted(verdict, plan_of([1e4, 1e4]))).sentence


def test_what_no_data_tell_is_fixed_before_and_after_measuring():
    plan = plan_of([1e4, 0.01])
    for results in (PlannedStudy(None, None, plan, None), fitted("not identifiable", plan)):
        step = next_step(results)
        assert step.action == "reparametrise"
        assert "fix g1.damping" in step.sentence


def test_a_plan_is_measured_in_the_order_of_visits_or_of_information():
    matrices = np.array([np.diag([100.0, 1.0]), np.diag([1e4, 1e4]), np.diag([1.0, 300.0])])
    information = SimpleNamespace(take=lambda indices: matrices[indices], names=NAMES)
    exact = SimpleNamespace(repetitions=np.array([1, 2, 1]))
    plan = DesignedPlan(
        information, None, exact, np.arange(3), np.ones(2), 1, 1.0, None, robust=None, order=None
    )
    step = next_step(PlannedStudy(None, None, plan, None))
    # Without the first visit the determinant falls least, then without the third.
    assert (step.action, step.positions) == ("measure", (2, 3, 1))
    assert step.sentence.endswith("positions 1 to 3, the most informative first: 2, 3, 1")
    step = next_step(PlannedStudy(None, None, replace(plan, order=object()), None))
    assert (step.sentence, step.positions) == (
        "measure in positions 1 to 3, in this order",
        (1, 2, 3),
    )


def test_measured_responses_take_no_robot_time_and_records_what_they_last():
    plan = plan_of([1, 1])
    assert robot_time(PlannedStudy(None, None, plan, None)) is None
    for recorded, expected in ((None, None), (90.0, RobotTime(90.0, bound=True))):
        data = MeasuredData(None, recorded=recorded)
        assert robot_time(FittedStudy(None, None, plan, None, data, None)) == expected


def test_time_grows_by_visits_and_by_moves_to_new_positions():
    study = SimpleNamespace(design=SimpleNamespace(measuring=40.0))
    plan = SimpleNamespace(order=SimpleNamespace(duration=30.0))
    time = growing_time(study, plan, np.array([2, 0, 2, 1, 0]))
    np.testing.assert_allclose(time, [50, 100, 140, 190, 230])
    plan.order = None
    np.testing.assert_allclose(growing_time(study, plan, np.array([1, 1])), [40, 80])


def test_time_of_simulated_runs_counts_their_periods():
    excitation = SimpleNamespace(
        blocks=2, periods=3, transient_periods=1, settle=5.0, multisine=SimpleNamespace(period=10.0)
    )
    study = SimpleNamespace(
        design=SimpleNamespace(measuring=None), data=SimpleNamespace(experiment=excitation)
    )
    plan = SimpleNamespace(order=None, runs_per_visit=3)
    np.testing.assert_allclose(growing_time(study, plan, np.array([4, 4])), [245, 490])
    study.data.experiment = None
    assert growing_time(study, plan, np.array([4, 4])) is None
