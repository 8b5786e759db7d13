"""Designs that also tell whether and where springs are."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from derivatives import frf_derivatives, information_of

import robotmodels
from oed.study.pipeline import design_study
from oed.study.settings.study_file import load_study
from robotmodels import InvalidInput, possible_springs

ROBOT = robotmodels.load_robot("manutec_r3")
SPRING = next(spring for spring in possible_springs(ROBOT) if spring.name == "joint3 z")
SPRING = SPRING.model_copy(update={"stiffness": 5e6, "damping": 5e3})
OTHER = next(spring for spring in possible_springs(ROBOT) if spring.name == "joint2 z")
OTHER = OTHER.model_copy(update={"stiffness": 2e7, "damping": 2e4})


def _design(folder: Path, **design):
    content = {
        "schema": "study/1",
        "robot": "manutec_r3",
        "frequencies": {"low": 4.0, "high": 60.0, "count": 20},
        "noise": {"relative": 0.03, "floor": 0.01},
        "candidates": {"sobol": 24},
        "design": {"experiments": 3} | design,
        "output": "out",
    }
    folder.mkdir(exist_ok=True)
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(content))
    return design_study(load_study(path))


def _springs(*springs):
    return [s.model_dump(mode="json", exclude_none=True) for s in springs]


def _detection(results, springs=(SPRING,)):
    """Information on each stiffness beside all others: Schur complements, by differences."""
    positions = results.plan.positions
    counts = results.plan.exact.repetitions[results.plan.used]
    omega = results.plan.omega
    robot = robotmodels.with_springs(ROBOT, springs, free=True)
    G = robotmodels.frequency_response(robot, positions, omega)
    dampers = {f"{spring.name}.damping" for spring in springs}
    kept = [i for i, name in enumerate(robot.parameters.names) if name not in dampers]
    names = [robot.parameters.names[i] for i in kept]
    J = frf_derivatives(robot, positions, omega, 1e-4)[..., kept]
    variance = robotmodels.RelativeNoise(0.03, 0.01).variance(G) / counts[:, None, None, None]
    information = information_of(J, variance).sum(axis=0)
    variances = dict(zip(names, np.diag(np.linalg.inv(information)), strict=True))
    return np.array([1 / variances[f"{spring.name}.stiffness"] for spring in springs])


def test_a_plan_that_tells_springs_apart_sees_them_better_and_has_a_certificate(tmp_path):
    plain = _design(tmp_path / "a")
    both = _design(tmp_path / "b", distinguish=_springs(SPRING, OTHER))
    only = _design(
        tmp_path / "c",
        distinguish=_springs(SPRING),
        criterion="Ds",
        interest=["joint3 z.stiffness"],
    )
    for results in (both, only):
        assert results.plan.design.gap <= 1e-6
        assert results.plan.information.names == ROBOT.parameters.names
        assert results.plan_summary.worst.std > 0
    assert both.plan.design.names == (
        *ROBOT.parameters.names[:3],
        "joint3 z.stiffness",
        "joint2 z.stiffness",
        *ROBOT.parameters.names[3:],
    )
    seen = [_detection(results)[0] for results in (plain, both, only)]
    assert seen[2] > 0.9 * max(seen)
    assert seen[1] > seen[0]
    assert seen[2] > 1.2 * seen[0]
    # The plain plan is the better one for the parameters alone, but for whole numbers.
    volumes = [np.linalg.slogdet(_total(results))[1] for results in (plain, both)]
    assert volumes[0] >= volumes[1] - 0.05


def _least(design):
    """Least information on a spring of a relaxed design, beside all else."""
    variances = dict(zip(design.names, np.diag(np.linalg.inv(design.information)), strict=True))
    return min(1 / variances[f"{spring.name}.stiffness"] for spring in (SPRING, OTHER))


def _total(results):
    plan = results.plan
    return np.tensordot(plan.exact.repetitions, plan.information.matrices, axes=1)


def test_maximin_raises_the_least_and_a_structure_file_stands_for_its_springs(tmp_path):
    robot = robotmodels.with_springs(ROBOT, [SPRING, OTHER], free=True)
    robotmodels.save_robot(robot, tmp_path / "structure.yaml")
    by_file = _design(tmp_path, distinguish=["structure.yaml"], criterion="maximin")
    assert by_file.plan.design.gap <= 1e-6
    by_elements = _design(tmp_path / "a", distinguish=_springs(SPRING, OTHER), criterion="maximin")
    np.testing.assert_array_equal(
        by_file.plan.exact.repetitions, by_elements.plan.exact.repetitions
    )
    volume = _design(tmp_path / "b", distinguish=_springs(SPRING, OTHER))
    least, by_volume = (_least(each.plan.design) for each in (by_file, volume))
    assert least > 1.02 * by_volume
    # In one file the springs are there together, as elements each is there alone.
    for results, source in ((by_file, " (structure.yaml)"), (by_elements, "")):
        names = [f"{spring.name}{source}" for spring in (SPRING, OTHER)]
        assert [power.name for power in results.powers] == names
    stored = _design(tmp_path / "a", distinguish=_springs(SPRING, OTHER), criterion="maximin")
    assert stored.powers == by_elements.powers
    lengths = [power.misfit for power in by_elements.powers]
    assert lengths != [power.misfit for power in by_file.powers]
    # What is stored of springs that are there alone is not that of those that are there together.
    robotmodels.save_robot(robot, tmp_path / "a" / "structure.yaml")
    together = _design(tmp_path / "a", distinguish=["structure.yaml"], criterion="maximin")
    assert together.powers == by_file.powers


def test_structure_files_that_are_none_are_refused(tmp_path):
    robotmodels.save_robot(ROBOT, tmp_path / "same.yaml")
    fewer = ROBOT.file.model_copy(update={"springs": ROBOT.file.springs[1:]})
    robotmodels.save_robot(robotmodels.ElasticRobot(fewer, ROBOT.folder), tmp_path / "fewer.yaml")
    for file, message in {
        "same.yaml": "no spring that the study's robot has not",
        "fewer.yaml": "no spring 'g1'",
        "moberg_axis1": "motors of another robot",
        "absent.yaml": r"design\.distinguish: .*absent.yaml: no such file",
    }.items():
        with pytest.raises(InvalidInput, match=message):
            _design(tmp_path, distinguish=[file])


@pytest.mark.parametrize(
    ("design", "message"),
    [
        ({"robust": {"std": 0.3}}, "robust and distinguish: samples are"),
        ({"criterion": "I", "purpose": {"quantity": "resonances"}}, "predictions are functions"),
        ({"criterion": "Ds", "interest": ["joint9.stiffness"]}, "joint9.stiffness"),
    ],
)
def test_what_does_not_fit_together_is_refused(tmp_path, design, message):
    with pytest.raises(InvalidInput, match=message):
        _design(tmp_path / "a", distinguish=_springs(SPRING), **design)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (3, r"design\.distinguish\[0\]: a mapping of keys to values is needed, found 3"),
        ({"name": "a"}, r"missing key 'design\.distinguish\[0\]\.axis' of 'a'"),
        (
            {"name": "a", "stifness": 1.0},
            r"unknown key 'design\.distinguish\[0\]\.stifness' of 'a'",
        ),
    ],
)
def test_entries_that_are_no_springs_are_named(entry, message, tmp_path):
    with pytest.raises(InvalidInput, match=message):
        _design(tmp_path, distinguish=[entry])


def test_a_spring_that_the_robot_has_is_refused(tmp_path):
    again = ROBOT.file.springs[0].model_copy(update={"name": "again"})
    with pytest.raises(InvalidInput, match=r"design\.distinguish: springs: joint 'joint1' has 2"):
        _design(tmp_path / "a", distinguish=_springs(again))
