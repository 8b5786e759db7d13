"""The schema of a study of movements: springs from encoders on both sides of the gears.

    schema: study/1
    robot: kr300                 # a built-in robot, or the path of a robot file
    data:
      movements: movements.h5    # such as `oed import` writes; several in a file are pooled
    fit:
      residuals: [deflection]    # link less motor angle; movements have no other
      payload: estimated         # or robot file: where the payload's mass is from
      low_pass: 5.0              # cut-off frequency of all signals [Hz]
      least_speed: 0.02          # of joints that count [rad/s]
      averaging: 0.1             # duration of the means that covariances come from [s]
      delays: true               # whether delays of the encoders behind the gears are estimated
      eccentric: false           # whether the eccentricity of these encoders is estimated
    validation:                  # left out: none
      movements: others.h5       # whose deflections the result is to explain
    output: ../out/kr300         # folder, relative to this file as every path in it

It is told from other study files by its movements or its residual.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from oed.experiment.settings_files import read_settings
from robotmodels.common.file_paths import existing_file
from robotmodels.common.yaml_files import FileSection
from robotmodels.description.ranges import NonNegative, Positive


class MovementChoice(FileSection):
    """A file of movements."""

    movements: Path


class OtherMovements(FileSection):
    """A file of movements that are not fitted."""

    movements: Path


class DeflectionChoice(FileSection):
    """What `estimators.fit_deflection` takes for granted."""

    residuals: tuple[Literal["deflection"]] = ("deflection",)
    payload: Literal["estimated", "robot file"] = "estimated"
    low_pass: Positive = 5.0
    least_speed: NonNegative = 0.02
    averaging: Positive = 0.1
    delays: bool = True
    eccentric: bool = False


class DeflectionStudy(FileSection):
    """A study file of movements, ``schema: study/1``; paths in it are relative to the file."""

    schema_: Annotated[Literal["study/1"], Field(alias="schema")]
    robot: str
    data: MovementChoice
    fit: DeflectionChoice = DeflectionChoice()
    validation: OtherMovements | None = None
    output: Path


def is_deflection_study(content: dict[str, Any]) -> bool:
    """Tell whether the content of a study file is that of a study of movements."""
    data, fit = content.get("data"), content.get("fit")
    residuals = fit.get("residuals") if isinstance(fit, dict) else None
    named = isinstance(residuals, list) and "deflection" in residuals
    return named or (isinstance(data, dict) and "movements" in data)


def load_deflection_study(path: str | Path) -> DeflectionStudy:
    """Read a study of movements, see `read_settings`; those of movements become absolute too.

    Raises
    ------
    InvalidInput
        As `read_settings`, or if there are no such movements.
    """
    path, changed = Path(path), dict[str, object]()
    study = read_settings(path, DeflectionStudy)
    for key in ("data", "validation"):
        if (choice := getattr(study, key)) is not None:
            file = existing_file(path, f"{key}.movements", choice.movements)
            changed[key] = choice.model_copy(update={"movements": file})
    return study.model_copy(update=changed)
