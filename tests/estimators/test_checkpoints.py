"""Whatever changes a result keeps what was computed before from being taken for it.

Each function that keeps its work is called with one argument after another changed, on the file of
the unchanged call: it either refuses the file or returns what it would return without. A new
argument is found in the signature, and has to be judged here.
"""

import dataclasses
import inspect
import shutil

import numpy as np
import pytest
from mass_springs import OMEGA, POSITIONS, MassSprings
from test_least_squares import MODEL, TRUTH

from estimators import (
    EarlyStop,
    FrfExperiment,
    Prior,
    StoppingCriterion,
    fit,
    monte_carlo,
    multistart,
    perturbed_starts,
    sample_posterior,
    simulate_frf,
)
from oed import InformationSet, compare_plans
from robotmodels import InvalidInput, Parameters, RelativeNoise, SpringNetwork
from robotmodels.common.checkpoint_file import UnusableCheckpoint

NOISE = RelativeNoise(0.03, 0.01)
OTHER_NOISE = RelativeNoise(0.03, 0.02)
FEW = OMEGA[2::10]
WITHOUT_EFFECT = {"executor", "progress", "store", "backend"}


class Heavier(MassSprings):
    """The same parameters on other masses."""

    def network(self, positions, parameters=None):
        network = super().network(positions, parameters)
        return SpringNetwork(**(vars(network) | {"mass": 1.1 * network.mass}))


def heavier():
    return Heavier(MODEL.parameters)


def elsewhere():
    values = MODEL.parameters.values * 1.02
    return MassSprings(Parameters(MODEL.parameters.names, values, MODEL.parameters.units))


def measured(noise=NOISE, seed=3, positions=POSITIONS[:2]):
    return simulate_frf(MODEL, positions, FEW, noise, np.random.default_rng(seed))


def fitted(**changes):
    arguments = {"model": MODEL, "estimate": measured(), "residual": "nls", "weights": "optimal"}
    return fit(**arguments | changes)


PRIOR = Prior(("k1",), TRUTH[:1], np.array([0.05]))
WEIGHTS = np.ones((2, len(FEW), 2, 2))
MULTISTART = {
    "model": (MODEL, [heavier(), elsewhere()]),
    "estimate": (measured(), [measured(seed=4), measured(OTHER_NOISE)]),
    "starts": (
        perturbed_starts(MODEL.parameters, 3, 0.2, np.random.default_rng(0)),
        [perturbed_starts(MODEL.parameters, 2, 0.2, np.random.default_rng(1))],
    ),
    "residual": ("nls", ["lls"]),
    "weights": ("optimal", [WEIGHTS, 1.001 * WEIGHTS]),
    "bounds": ((1e-2, 1e2), [(0.5, 2.0)]),
    "max_evaluations": (20, [3]),
    "tolerance": (1e-8, [1e-2]),
    "positions": (None, [[0]]),
    "prior": (None, [PRIOR]),
    "loss": ("linear", ["huber"]),
    "early_stop": (None, [EarlyStop(2, 1.01)]),
    "minimiser": ("trust_region", ["quasi_newton"]),
}
CHAIN_STARTS = np.exp(0.001 * np.random.default_rng(5).normal(size=(12, 6))) * TRUTH
POSTERIOR = {
    "fit": (
        fitted(),
        [
            fitted(estimate=measured(seed=4)),
            fitted(residual="lls"),
            fitted(weights="user"),
            fitted(prior=PRIOR),
            fitted(bounds=(0.9, 1.1)),
            fitted(model=heavier()),
        ],
    ),
    "rng": (0, [1]),
    "ensembles": (2, [3]),
    "walkers": (12, [14]),
    "steps": (200, [120, 260]),
    "thin": (2, [1]),
    "noise": ("known", ["unknown"]),
    "scale": (0.9, [1.1, None]),
    "prior": (None, [PRIOR]),
    "target": (StoppingCriterion(r_hat=1.001, ess=1e6), [StoppingCriterion(r_hat=5.0, ess=10.0)]),
    "starts": (None, [CHAIN_STARTS, 1.0001 * CHAIN_STARTS]),
}
MONTE_CARLO = {
    "experiment": (
        FrfExperiment(MODEL, POSITIONS[:2], FEW, NOISE),
        [
            FrfExperiment(heavier(), POSITIONS[:2], FEW, NOISE),
            FrfExperiment(MODEL, POSITIONS[1:3], FEW, NOISE),
            FrfExperiment(MODEL, POSITIONS[:2], FEW[1:], NOISE),
            FrfExperiment(MODEL, POSITIONS[:2], FEW, OTHER_NOISE),
            FrfExperiment(MODEL, POSITIONS[:2], FEW, NOISE, np.array([2, 1])),
        ],
    ),
    "model": (MODEL, [heavier(), elsewhere()]),
    "rng": (0, [1]),
    "runs": (4, [3, 6]),
    "residual": ("nls", ["lls"]),
    "weights": ("optimal", ["user", WEIGHTS]),
    "truth": (None, [1.1 * TRUTH]),
    "methods": (("theorem1",), [("scaled",), ()]),
    "level": (0.95, [0.9]),
    "noise": ("known", []),
}
KINDS = {
    "multistart": (multistart, MULTISTART, "store"),
    "posterior": (sample_posterior, POSTERIOR, "backend"),
    "Monte Carlo": (monte_carlo, MONTE_CARLO, "store"),
}


def called(function, arguments, **store):
    given = dict(arguments)
    if "rng" in given:
        given["rng"] = np.random.default_rng(given["rng"])
    return function(**given, **store)


def content(result):
    """Return all numbers and words of a result; of fits what a search gives."""
    if isinstance(result, tuple) and result and dataclasses.is_dataclass(result[0]):
        return [(r.parameters.values.tolist(), r.cost, r.status, r.message) for r in result]
    plain = {
        field.name: getattr(result, field.name)
        for field in dataclasses.fields(result)
        if not dataclasses.is_dataclass(getattr(result, field.name))
    }
    return {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in plain.items()}


@pytest.mark.parametrize("kind", KINDS)
def test_every_argument_that_changes_a_result_is_judged(kind):
    function, arguments, _ = KINDS[kind]
    assert set(inspect.signature(function).parameters) - WITHOUT_EFFECT == set(arguments)


CASES = [
    (kind, name, k)
    for kind, (_, arguments, _) in KINDS.items()
    for name, (_, changes) in arguments.items()
    for k in range(len(changes))
]


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Return a function that gives the file of an unchanged call."""
    files = {}

    def file(kind):
        if kind not in files:
            function, arguments, store = KINDS[kind]
            files[kind] = tmp_path_factory.mktemp("kept") / "kept.h5"
            base = {name: value for name, (value, _) in arguments.items()}
            called(function, base, **{store: files[kind]})
        return files[kind]

    return file


@pytest.mark.parametrize(("kind", "name", "k"), CASES, ids=str)
def test_what_was_kept_is_never_taken_for_another_result(kept, tmp_path, kind, name, k):
    function, arguments, store = KINDS[kind]
    base = {key: value for key, (value, _) in arguments.items()}
    changed = base | {name: arguments[name][1][k]}
    path = shutil.copy(kept(kind), tmp_path / "kept.h5")
    try:
        found = called(function, changed, **{store: path})
    except UnusableCheckpoint:
        return
    assert repr(content(found)) == repr(content(called(function, changed)))


@pytest.mark.parametrize("kind", KINDS)
def test_the_unchanged_call_takes_what_was_kept(kept, tmp_path, kind):
    function, arguments, store = KINDS[kind]
    base = {key: value for key, (value, _) in arguments.items()}
    path = shutil.copy(kept(kind), tmp_path / "kept.h5")
    written = path.read_bytes()
    found = called(function, base, **{store: path})
    assert path.read_bytes() == written
    assert repr(content(found)) == repr(content(called(function, base)))


def test_a_comparison_of_other_plans_is_refused(tmp_path):
    matrices = np.stack([np.eye(6) * (q + 1.0) for q in range(3)])
    info = InformationSet(POSITIONS[:3], matrices, MODEL.parameters.names)
    plans = {"one": np.array([2, 1, 0]), "two": np.array([0, 1, 2])}

    def compared(noise=NOISE, omega=FEW, seed=0, plans=plans, model=MODEL, **store):
        rng = np.random.default_rng(seed)
        return compare_plans(
            model, info, POSITIONS[:3], plans, omega, noise, rng=rng, runs=9, **store
        )

    compared(store=tmp_path)
    for change in (
        {"noise": OTHER_NOISE},
        {"omega": FEW[1:]},
        {"seed": 1},
        {"plans": plans | {"one": np.array([1, 2, 0])}},
        {"model": elsewhere()},
    ):
        with pytest.raises(InvalidInput, match=r"plan_0\d\.h5: holds another series"):
            compared(store=tmp_path, **change)
