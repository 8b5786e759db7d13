"""Designs for a prediction: their certificate, what they gain, and the key of a study."""

import numpy as np
import pytest
import yaml
from pydantic import ValidationError
from robots import HERE, built

import oed
import robotmodels
from estimators import Resonances, ToolCompliance, log_gradients
from oed.study.pipeline import design_study
from oed.study.settings.design_settings import DesignChoice
from oed.study.settings.study_file import load_study
from oed.study.stages.design_inputs import criterion_of
from reports.summaries.study_summary import study_json, study_summary
from robotmodels import Frame, InvalidInput, RelativeNoise, linear_feedback, loop_margins
from robotmodels.simulation.controller import default_controller

ROBOT = built(yaml.safe_load((HERE / "two_joints.yaml").read_text()))
ARM = robotmodels.load_robot("manutec_r3")
OMEGA = 2 * np.pi * np.geomspace(3.0, 60.0, 12)
TIP = ToolCompliance(Frame("tool0", (0.0, 0.0, 0.1)), (0.0, 0.0, 1.0))
END = ToolCompliance(None, (0.0, 0.0, 1.0))
REGION = np.array([[0.0, 0.3, -0.5, 0.0, 0.4, 0.0], [0.0, -0.2, 0.4, 0.0, 0.1, 0.0]])


@pytest.fixture(scope="module")
def info() -> oed.InformationSet:
    positions = oed.candidate_positions(ARM, {"joint2": 5, "joint3": 5})
    noise = RelativeNoise(relative=0.03, floor=0.01)
    return oed.information(ARM, positions, OMEGA, noise)


def variance(design: oed.Design, quantity: object, positions: np.ndarray) -> float:
    """Return the mean relative variance of a quantity, from its gradients."""
    g = log_gradients(ARM, quantity, positions).reshape(-1, len(ARM.parameters))
    return float(np.einsum("ip,pr,ir->i", g, np.linalg.inv(design.information), g).mean())


@pytest.mark.parametrize("quantity", [END, Resonances(1)])
def test_designs_for_a_purpose_are_certified_and_better_at_it(info, quantity) -> None:
    purpose = oed.optimal_design(info, oed.purpose_criterion(ARM, quantity, REGION))
    assert purpose.gap < 1e-4
    usual = oed.optimal_design(info, "D")
    assert variance(purpose, quantity, REGION) < 0.999 * variance(usual, quantity, REGION)
    # No single candidate instead of a part of it is better: the optimum is one.
    own = variance(purpose, quantity, REGION)
    for k in range(0, len(info.positions), 4):
        weights = 0.95 * purpose.weights + 0.05 * np.eye(len(purpose.weights))[k]
        mixed = np.einsum("q,qij->ij", weights, info.matrices)
        g = log_gradients(ARM, quantity, REGION).reshape(-1, len(ARM.parameters))
        other = np.einsum("ip,pr,ir->i", g, np.linalg.inv(mixed), g).mean()
        assert other > own * (1 - 1e-4)


def test_one_prediction_is_a_c_criterion(info) -> None:
    gradient = log_gradients(ARM, END, REGION[:1]).ravel()
    one = oed.optimal_design(info, oed.purpose_criterion(ARM, END, REGION[:1]))
    same = oed.optimal_design(info, oed.CCriterion(gradient))
    assert variance(one, END, REGION[:1]) == pytest.approx(
        variance(same, END, REGION[:1]), rel=1e-4
    )


def test_margins_are_a_purpose_too(info) -> None:
    feedback = linear_feedback(default_controller(ARM, 1e-3))

    def peak(model, positions, parameters):
        return loop_margins(model, positions, feedback, parameters).peak_sensitivity

    criterion = oed.purpose_criterion(ARM, peak, REGION[:1])
    design = oed.optimal_design(info, criterion)
    assert design.gap < 1e-4


def test_studies_have_purposes() -> None:
    keys = {
        "criterion": "I",
        "purpose": {"quantity": "tool_compliance", "at": [0.0, 0.0, 0.1], "positions": 8,
                    "region": {"elbow_joint": [0.2, 1.0]}, "direction": [0.0, 0.0, 1.0]},
    }  # fmt: skip
    choice = DesignChoice.model_validate(keys)
    criterion = criterion_of(choice, ROBOT)
    region = oed.sobol_positions(ROBOT, 8, {"elbow_joint": (0.2, 1.0)})
    expected = oed.purpose_criterion(ROBOT, TIP, region)
    np.testing.assert_allclose(criterion.matrix, expected.matrix)
    modes = DesignChoice.model_validate({"criterion": "I", "purpose": {"quantity": "resonances"}})
    assert criterion_of(modes, ROBOT).matrix.shape == (4, 4)
    for wrong in ({"criterion": "I"}, {"purpose": keys["purpose"]}):
        with pytest.raises(ValidationError, match="criterion I needs one"):
            DesignChoice.model_validate(wrong)
    of_modes = {"quantity": "resonances", "direction": [0.0, 0.0, 1.0]}
    for name, foreign in {
        "direction": of_modes,
        "motors": keys["purpose"] | {"motors": "free"},
    }.items():
        with pytest.raises(ValidationError, match=f"{name}: .* has no such setting"):
            DesignChoice.model_validate({"criterion": "I", "purpose": foreign})
    mistakes = {"'toool' is not a link": {"link": "toool"}, "'knee'": {"region": {"knee": [0, 1]}}}
    for message, keys_changed in mistakes.items():
        wrong = {"criterion": "I", "purpose": keys["purpose"] | keys_changed}
        with pytest.raises(InvalidInput, match=rf"^design\.purpose: .*{message}"):
            criterion_of(DesignChoice.model_validate(wrong), ROBOT)


def test_the_standard_deviation_that_a_plan_leaves_to_its_purpose_is_told(tmp_path) -> None:
    region = {"joint2": [-0.5, 0.5], "joint3": [-0.5, 0.5]}
    content = {
        "schema": "study/1",
        "robot": "manutec_r3",
        "frequencies": {"low": 4.0, "high": 60.0, "count": 12},
        "noise": {"relative": 0.03, "floor": 0.01},
        "candidates": {"sobol": 12},
        "design": {
            "experiments": 3,
            "criterion": "I",
            "purpose": {"quantity": "resonances", "region": region, "positions": 4},
        },
        "output": "out",
    }
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(content))
    results = design_study(load_study(tmp_path / "study.yaml"))
    plan = results.plan
    visits = zip(plan.exact.repetitions[plan.used], plan.information.take(plan.used), strict=True)
    covariance = np.linalg.inv(plan.visit_share * sum(n * H for n, H in visits))
    where = oed.sobol_positions(ARM, 4, {name: tuple(ends) for name, ends in region.items()})
    g = log_gradients(ARM, Resonances(1), where).reshape(4, -1)
    expected = np.sqrt(np.einsum("ip,pr,ir->i", g, covariance, g).mean())
    assert results.purpose_std == pytest.approx(expected, rel=1e-6)
    words = f"resonances, std {100 * expected:.2g} %"
    assert words in study_summary(results, [])
    assert study_json(results, [])["purpose_std"] == results.purpose_std
