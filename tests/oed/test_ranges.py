"""Counts and physical values beyond any robot are refused where they are read."""

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from oed.experiment.experiment_file import load_experiment
from oed.experiment.prepare import prepare
from oed.study.settings.study_file import load_study
from robotmodels import InvalidInput, load_robot

REPOSITORY = Path(__file__).parents[2]
LIBRARY = REPOSITORY / "robotmodels" / "library"
STUDY = REPOSITORY / "studies" / "ur10.yaml"
EXPERIMENT = REPOSITORY / "studies" / "manutec_r3_experiment.yaml"
ROBOT = LIBRARY / "manutec_r3.yaml"

COUNTS = [
    "frequencies.count",
    "candidates.sobol",
    "candidates.per_joint.elbow_joint",
    "design.experiments",
    "design.most",
    "fit.starts",
    "posterior.ensembles",
    "posterior.walkers",
    "posterior.steps",
    "compare.random",
    "compare.runs",
    "profiles",
    "seed",
]
EXPERIMENT_COUNTS = [
    "multisine.count",
    "multisine.detection",
    "multisine.crest_iterations",
    "blocks",
    "periods",
    "transient_periods",
    "seed",
]


def changed(path: Path, tmp_path: Path, keys: str, value: object) -> Path:
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    *sections, last = keys.split(".")
    section = content
    for key in sections:
        section = section[int(key)] if isinstance(section, list) else section.setdefault(key, {})
    section[last] = value
    edited = tmp_path / "edited.yaml"
    edited.write_text(yaml.safe_dump(content), encoding="utf-8")
    return edited


def refused(edited: Path, load: Callable[[Path], object], keys: str) -> None:
    with pytest.raises(InvalidInput, match=rf"edited\.yaml:\d+: {keys}") as error:
        load(edited)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("value", [10**19, 10**23, 10**399, 1e300, -1, 5.9, "7", True])
@pytest.mark.parametrize("keys", COUNTS)
def test_counts_of_a_study_have_limits(tmp_path: Path, keys: str, value: object) -> None:
    refused(changed(STUDY, tmp_path, keys, value), load_study, keys)


@pytest.mark.parametrize("value", [10**19, 10**399, 1e300, -1, 5.9, "7", True])
@pytest.mark.parametrize("keys", EXPERIMENT_COUNTS)
def test_counts_of_an_experiment_have_limits(tmp_path: Path, keys: str, value: object) -> None:
    refused(changed(EXPERIMENT, tmp_path, keys, value), load_experiment, keys)


@pytest.mark.parametrize("value", [1e300, -1e300, 10**399, "1 000", True, float("nan"), 1e-300])
@pytest.mark.parametrize(
    "keys",
    [
        "motors.0.gear_ratio",
        "motors.0.inertia",
        "motors.0.torque_gain",
        "springs.0.stiffness",
        "springs.0.damping",
    ],
)
def test_physical_values_have_ranges(tmp_path: Path, keys: str, value: object) -> None:
    refused(changed(ROBOT, tmp_path, keys, value), load_robot, r"(motors|springs)\[0\]")


def test_products_of_counts_have_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    edited = changed(STUDY, tmp_path, "posterior", {"walkers": 10_000, "steps": 10_000_000})
    with pytest.raises(InvalidInput, match=r"posterior: steps: .* at most 1e.09 can be taken"):
        load_study(edited)
    edited = changed(EXPERIMENT, tmp_path, "blocks", 100_000)
    with pytest.raises(InvalidInput, match="at most 10000000 samples can be measured in one go"):
        load_experiment(edited)
    edited = changed(EXPERIMENT, tmp_path, "repetitions", [100_000] * 2)
    pages = {"SC_PHYS_PAGES": 4_000_000, "SC_PAGE_SIZE": 4096}
    monkeypatch.setattr("os.sysconf", pages.__getitem__)
    with pytest.raises(InvalidInput, match=r"blocks.* GB are needed, this machine has 16\.4 GB"):
        prepare(load_experiment(edited))
