"""Old names work for one version, with a warning that names the new one."""

import dataclasses
import pickle
import warnings

import numpy as np
import pytest

import estimators
import oed
import robotmodels
from robotmodels.common.deprecation import (
    renamed_attributes,
    renamed_keywords,
    renamed_names,
)

OMEGA = np.array([20.0])
POSITIONS = np.zeros((1, 6))


@renamed_keywords("0.2", size="length")
def double(length: float, *, unit: float = 1.0) -> float:
    return 2 * unit * length


@renamed_attributes("0.2", size="length")
@dataclasses.dataclass(frozen=True)
class Bar:
    length: float


def test_an_old_keyword_warns_and_works():
    with pytest.warns(DeprecationWarning, match="double: keyword 'size' is now 'length'.*0.3") as w:
        assert double(size=3.0) == 6.0
    assert w[0].filename == __file__
    assert double(length=3.0) == double(3.0) == 6.0


def test_both_names_at_once_are_refused():
    with pytest.raises(TypeError, match="'size' is the old name of 'length'"):
        double(size=3.0, length=3.0)
    with pytest.raises(TypeError, match="depth"):
        double(3.0, depth=1.0)


def test_old_fields_are_taken_and_shown():
    with pytest.warns(DeprecationWarning, match="Bar: keyword 'size' is now 'length'"):
        bar = Bar(size=3.0)
    with pytest.warns(DeprecationWarning, match="Bar.size is now 'length'") as w:
        assert bar.size == bar.length == 3.0
    assert w[0].filename == __file__
    assert [f.name for f in dataclasses.fields(Bar)] == ["length"]
    assert pickle.loads(pickle.dumps(bar)) == dataclasses.replace(bar, length=3.0)


def test_old_names_of_a_module_are_loaded_as_the_new_ones():
    get = renamed_names("a_module", str.upper, "0.2", shape="form")
    with pytest.warns(DeprecationWarning, match="a_module.shape is now 'a_module.form'") as w:
        assert get("shape") == "FORM"
    assert w[0].filename == __file__
    assert get("other") == "OTHER"


@pytest.mark.parametrize(
    ("package", "old", "new"),
    [
        (robotmodels, "AtValues", "WithParameters"),
        (estimators, "Target", "StoppingCriterion"),
        (estimators, "Comparison", "MethodComparison"),
    ],
)
def test_renamed_public_names(package, old, new):
    with pytest.warns(DeprecationWarning, match=f"{package.__name__}.{new}"):
        assert getattr(package, old) is getattr(package, new)
    assert old not in package.__all__


def test_sag_is_equilibrium_shift():
    robot = robotmodels.load_robot("ur10")
    noise = robotmodels.RelativeNoise(0.01)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        exact = robotmodels.sensitivity(robot, POSITIONS, OMEGA, equilibrium_shift=True)[1]
        fixed = robotmodels.sensitivity(robot, POSITIONS, OMEGA, equilibrium_shift=False)[1]
        information = oed.information(robot, POSITIONS, OMEGA, noise, equilibrium_shift=True)
    assert (exact != fixed).any()
    with pytest.warns(DeprecationWarning, match="sensitivity: keyword 'sag'"):
        old = robotmodels.sensitivity(robot, POSITIONS, OMEGA, sag=False)[1]
    np.testing.assert_array_equal(old, fixed)
    with pytest.warns(DeprecationWarning, match="information: keyword 'sag'"):
        same = oed.information(robot, POSITIONS, OMEGA, noise, sag=True)
    np.testing.assert_array_equal(same.matrices, information.matrices)
    with pytest.warns(DeprecationWarning, match="keyword 'sag'"):
        assert robot.tangents(POSITIONS, sag=False) is None


def test_a_network_shows_its_old_fields():
    network = robotmodels.load_robot("ur10").network(POSITIONS)
    with pytest.warns(DeprecationWarning, match="SpringNetwork.ends is now 'nodes'"):
        assert network.ends is network.nodes
