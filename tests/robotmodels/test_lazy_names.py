"""Names of the packages are loaded when they are used, and importing a package loads little."""

import importlib
import subprocess
import sys

import pytest

import estimators
import oed
import robotmodels

HEAVY = ("numpy", "scipy", "pydantic", "numba", "pinocchio", "coal", "cvxpy", "emcee")


@pytest.mark.parametrize("package", [robotmodels, estimators, oed], ids=lambda p: p.__name__)
def test_every_public_name_is_what_it_says(package):
    for name in package.__all__:
        assert name.isupper() or getattr(package, name).__name__ == name
    assert set(package.__all__) <= set(dir(package))


def test_functions_stay_when_modules_inside_are_imported():
    for name in (
        "estimators.fitting.sandwich",
        "oed.information_sets.information_set",
        "robotmodels.records.records",
    ):
        importlib.import_module(name)
    for package in (robotmodels, estimators, oed):
        for name in package.__all__:
            assert getattr(package, name).__class__.__name__ != "module", name


def test_an_unknown_name_is_told():
    with pytest.raises(AttributeError, match="estimators attribute fitt"):
        estimators.fitt  # noqa: B018


@pytest.mark.parametrize("package", ["robotmodels", "estimators", "oed"])
def test_importing_a_package_loads_no_heavy_library(package):
    loaded = f"import sys, {package}; sys.exit([m for m in {HEAVY} if m in sys.modules] or 0)"
    done = subprocess.run([sys.executable, "-c", loaded], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
