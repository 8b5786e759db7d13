"""Every file that this project reads: a new format joins by one entry."""

import json
import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

import contents
import trees

from robotmodels.common.fingerprints import folder_digest

Mutation = Callable[[bytes, Random], bytes]
Prepare = Callable[[Path, Path, Random], None]
"""Does something to a folder after a file in it has been changed."""

TEXT = (contents.text, contents.text, contents.flipped)
YAML = (*TEXT, *[trees.yaml_tree] * 6)
JSON = (*TEXT, *[trees.json_tree] * 6)
XML = (*TEXT, *[trees.xml_tree] * 6)
CSV = (*[contents.text] * 8, contents.flipped)
HDF5 = (contents.flipped, *[contents.hdf5] * 5)
MAT = (contents.flipped, *[contents.mat] * 4)
NPY = (contents.flipped, contents.npy, contents.npy)


@dataclass(frozen=True)
class Format:
    """A file to change and the commands that read it.

    Attributes
    ----------
    name : of the format.
    seed : folder of whole files: inputs, finished or examples.
    files : pattern of those that are changed, one at a time.
    mutations : ways to change their bytes, each as likely as the others.
    commands : that read it, one at a time; "{file}" stands for its path.
    after : what is done to the folder after the change.
    """

    name: str
    seed: str
    files: str
    mutations: Sequence[Mutation]
    commands: Sequence[str]
    after: Prepare | None = None

    def paths(self, seeds: Path) -> list[Path]:
        """Return the files, relative to the seed's folder."""
        folder = seeds / self.seed
        return sorted(p.relative_to(folder) for p in folder.glob(self.files) if p.is_file())


def _unfinished(folder: Path, file: Path, rng: Random) -> None:
    """Make the file's stage one that was interrupted before its end."""
    stage = (folder / file).parent
    record = stage / "stage.json"
    key = json.loads(record.read_text(encoding="utf-8"))["key"]
    record.unlink()
    (stage / "key").write_text(key, encoding="utf-8")
    for result in stage.glob("result.h5"):
        if result != folder / file:
            result.unlink()
    stage.rename(stage.with_name(f"{stage.name}.part"))


def _resealed(folder: Path, file: Path, rng: Random) -> None:
    """Give the stage the digest of what is in it: only its reader can tell that it was changed."""
    stage = (folder / file).parent
    record = json.loads((stage / "stage.json").read_text(encoding="utf-8"))
    record["digest"] = folder_digest(stage, frozenset({"stage.json"}))
    (stage / "stage.json").write_text(json.dumps(record), encoding="utf-8")


def _another_place(folder: Path, file: Path, rng: Random) -> None:
    """Put something else where a folder of the stages is, or is to be."""
    stage = (folder / file).parent
    target = stage.with_name(stage.name + rng.choice(["", ".part", ".old"]))
    if target.exists():
        shutil.rmtree(target)
    kind = rng.randrange(4)
    if kind == 0:
        target.write_text("a file")
    elif kind == 1:
        target.symlink_to("nowhere")
    elif kind == 2:
        target.symlink_to(".")
    else:
        os.mkfifo(target)


def _unchanged(content: bytes, rng: Random) -> bytes:
    return content


ONE = "--workers 1"
ROBOT_COMMANDS = (
    "check {file}",
    "check {file}",
    "check {file} --json",
    "init {file} -o new",
)

FORMATS = (
    Format(
        "robot file", "inputs", "robot.yaml", YAML, (*ROBOT_COMMANDS, f"design study.yaml {ONE}")
    ),
    Format("robot file, all keys", "inputs", "rich.yaml", YAML, ROBOT_COMMANDS),
    Format("robot of the library", "examples", "[!s]*.yaml", YAML, ROBOT_COMMANDS),
    Format(
        "URDF",
        "inputs",
        "arm.urdf",
        XML,
        ("check robot.yaml", "check rich.yaml", "init {file} -o new", f"design study.yaml {ONE}"),
    ),
    Format("URDF of the library", "examples", "*.urdf", XML, ("init {file} -o new",)),
    Format(
        "study",
        "inputs",
        "study.yaml",
        YAML,
        (f"design {{file}} {ONE}", f"fit {{file}} {ONE}", f"run {{file}} {ONE}"),
    ),
    Format(
        "study, all keys",
        "inputs",
        "rich_study.yaml",
        YAML,
        (f"design {{file}} {ONE}", f"design {{file}} {ONE} --json", f"run {{file}} {ONE}"),
    ),
    Format(
        "study, already finished",
        "finished",
        "study.yaml",
        YAML,
        (f"report {{file}} {ONE}", f"sample {{file}} {ONE} --json", f"fit {{file}} {ONE}"),
    ),
    Format(
        "study of measured data",
        "inputs",
        "of_*.yaml",
        YAML,
        (f"fit {{file}} {ONE}", f"design {{file}} {ONE}"),
    ),
    Format(
        "study of the repository",
        "examples",
        "study_[!cm]*.yaml",
        YAML,
        (f"design {{file}} {ONE}",),
    ),
    Format("experiment", "inputs", "experiment.yaml", YAML, (f"simulate {{file}} {ONE}",)),
    Format(
        "experiment, all keys",
        "inputs",
        "rich_experiment.yaml",
        YAML,
        (f"simulate {{file}} {ONE}",),
    ),
    Format(
        "experiment of the repository",
        "examples",
        "study_m*.yaml",
        YAML,
        (f"simulate {{file}} {ONE}",),
    ),
    Format(
        "design.json",
        "inputs",
        "design.json",
        JSON,
        (f"simulate rich_experiment.yaml {ONE}",),
    ),
    *(
        Format(
            f"records, {ending}",
            "inputs",
            f"records.{ending}",
            mutations,
            (
                "frf {file} -o new",
                "frf {file} -o new --robot robot.yaml --structure diagonal",
                "frf {file} -o new --local",
                "frf {file} -o new --method log --compare",
                f"fit of_records_{ending}.yaml {ONE}",
            ),
        )
        for ending, mutations in (("h5", HDF5), ("mat", MAT), ("csv", CSV))
    ),
    Format(
        "records of chains", "inputs", "chains.h5", HDF5, ("chains {file} -o new", "frf {file}")
    ),
    *(
        Format(
            f"FRFs, {ending}",
            "inputs",
            f"frf.{ending}",
            mutations,
            (
                f"fit of_frf_{ending}.yaml {ONE}",
                f"run of_frf_{ending}.yaml {ONE}",
                "python:estimators:read_frf {file}",
            ),
        )
        for ending, mutations in (("h5", HDF5), ("mat", MAT), ("csv", CSV), ("uff", CSV))
    ),
    *(
        Format(
            f"positions, {ending}",
            "inputs",
            f"taught.{ending}",
            mutations,
            (f"design rich_study.yaml {ONE}",),
        )
        for ending, mutations in (("csv", CSV), ("yaml", YAML), ("npy", NPY))
    ),
    Format(
        "plan",
        "inputs",
        "plan.yaml",
        YAML,
        ("python:oed.experiment.experiment_plan:ExperimentPlan.load {file}",),
    ),
    Format(
        "signals of a plan",
        "inputs",
        "plan.h5",
        HDF5,
        ("python:oed.experiment.experiment_plan:ExperimentPlan.load plan.yaml",),
    ),
    Format(
        "distortion", "inputs", "distortion.h5", HDF5, ("python:estimators:read_distortion {file}",)
    ),
    Format("information", "inputs", "information.h5", HDF5, ("python:seeds:design_of {file}",)),
    Format(
        "information store",
        "inputs",
        "information.store",
        (contents.flipped,),
        ("python:seeds:design_of {file}",),
    ),
    Format("fits", "inputs", "fits.h5", HDF5, ("python:seeds:read_fits {file}",)),
    Format(
        "results",
        "finished",
        "results/*.json",
        JSON,
        (f"report study.yaml {ONE}", f"fit study.yaml {ONE}"),
    ),
    Format(
        "record of a stage",
        "finished",
        "results/stages/*/stage.json",
        JSON,
        (f"run study.yaml {ONE}",),
    ),
    Format(
        "file of a stage",
        "finished",
        "results/stages/*/[!s]*",
        (contents.flipped, contents.flipped),
        (f"run study.yaml {ONE}",),
    ),
    Format(
        "file of a stage, resealed",
        "finished",
        "results/stages/*/*.h5",
        HDF5,
        (f"run study.yaml {ONE}", f"fit study.yaml {ONE}"),
        after=_resealed,
    ),
    Format(
        "file of an unfinished stage",
        "finished",
        "results/stages/*/[prf]*.h5",
        HDF5,
        (f"run study.yaml {ONE}",),
        after=_unfinished,
    ),
    Format(
        "place of a stage",
        "finished",
        "results/stages/*/stage.json",
        (_unchanged,),
        (f"run study.yaml {ONE}", f"run study.yaml {ONE} --fresh"),
        after=_another_place,
    ),
)
