"""Plans on disk: a YAML file to read and an HDF5 file of arrays beside it.

``PLAN.yaml`` (``schema: plan/1``) holds everything a person looks for; ``duration`` [s] is there to
be read only, it follows from the other keys; ``order``, where positions were reordered, has their
indices in the original order and the duration of the moves [s]. ``PLAN.h5`` has the datasets
``phases`` (V, B, F, n) [rad], ``amplitudes`` (F, n) [rad/s] and ``scale`` (V,), and the attribute
``fingerprint`` that the YAML file repeats, so that files of different plans cannot be confused.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from robotmodels.common.arrays import Array
from robotmodels.common.atomic_files import atomic_write
from robotmodels.common.deprecation import current_key
from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import reason
from robotmodels.common.fingerprints import fingerprint
from robotmodels.common.yaml_files import FileSection, read_yaml, yaml_text
from robotmodels.data_files.array_schema import ArraySchema, Field as ArrayField
from robotmodels.data_files.hdf5_file import open_hdf5

_ARRAYS = ("phases", "amplitudes", "scale")
_FILE = ArraySchema(
    {
        "phases": ArrayField(("visit", "block", "line", "motor")),
        "amplitudes": ArrayField(("line", "motor")),
        "scale": ArrayField(("visit",)),
        "fingerprint": ArrayField((), "text", attribute=True),
    }
)
Count = Annotated[int, Field(ge=0, le=10**9)]


class MultisineSection(FileSection):
    """Lines of the multisine."""

    samples: Count
    sample_time: float
    odd: bool
    lines: list[Count]
    detection: list[Count]


class MovesSection(FileSection):
    """Limits of the moves, arm side."""

    positions: list[tuple[float, float]]
    speed: list[float]
    acceleration: list[float]
    start: list[float]


class OrderSection(FileSection):
    """How the positions came to be in this order, see `VisitingOrder`."""

    order: list[int]
    duration: float
    unordered_duration: float
    optimal: bool

    @model_validator(mode="before")
    @classmethod
    def _current_keys(cls, section: Any) -> Any:
        """Return the section with the present names of its keys."""
        if not isinstance(section, dict):
            return section
        return {
            current_key(key, "order", "0.2", given="unordered_duration"): value
            for key, value in section.items()
        }


class CarrierSection(FileSection):
    """Slow sines under the excitation, see `Carrier`."""

    line: Count
    amplitudes: list[list[float]]
    phases: list[list[float]]


class PlanFile(FileSection):
    """A plan file, ``schema: plan/1``."""

    schema_: Literal["plan/1"] = Field(alias="schema")
    robot: str
    motors: list[str]
    duration: float
    blocks: Count
    runs: Annotated[int, Field(ge=0)] = 0
    periods: Count
    transient_periods: Count
    ramp: bool = False
    settle: float = 0.0
    carrier: CarrierSection | None = None
    repetitions: list[Count]
    positions: list[list[float]]
    order: OrderSection | None = None
    moves: MovesSection
    multisine: MultisineSection
    signals: str
    fingerprint: str


def write_plan(
    path: str | os.PathLike[str], document: Mapping[str, Any], values: Mapping[str, Array]
) -> None:
    """Write the YAML file `path`, and the arrays beside it as ``.h5``; each appears complete.

    Parameters
    ----------
    path : path
        YAML file.
    document : mapping
        Keys of `PlanFile` but ``signals`` and ``fingerprint``, in the order to write them.
    values : mapping of str to ndarray
        ``phases``, ``amplitudes`` and ``scale``.

    Raises
    ------
    InvalidInput
        If the path does not end in .yaml or .yml, or cannot be written to.
    """
    import h5py

    target = Path(path)
    if target.suffix not in (".yaml", ".yml"):
        raise InvalidInput(f"{target}: a plan's file name ends in .yaml")
    arrays = target.with_suffix(".h5")
    fingerprint = _fingerprint(values)
    text = yaml_text({**document, "signals": arrays.name, "fingerprint": fingerprint})
    try:
        # The inner file is renamed first: no plan names arrays that are not there.
        with atomic_write(target) as unfinished, atomic_write(arrays) as unfinished_arrays:
            with h5py.File(unfinished_arrays, "w") as file:
                file.attrs["fingerprint"] = fingerprint
                for name in _ARRAYS:
                    file[name] = values[name]
            unfinished.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InvalidInput(f"{target}: cannot be written to ({reason(error)})") from None


def read_plan(path: Path) -> tuple[PlanFile, dict[str, Any]]:
    """Read a plan's file and the arrays beside it.

    Raises
    ------
    InvalidInput
        Naming the file and what is wrong in it.
    """
    plan = read_yaml(path, PlanFile)
    if Path(plan.signals).name != plan.signals or plan.signals == "..":
        raise InvalidInput(
            f"{path}: signals: {plan.signals!r}; the name of a file in the same folder is needed"
        )
    return plan, _read_arrays(path.parent / plan.signals, plan.fingerprint)


def _read_arrays(path: Path, fingerprint: str) -> dict[str, Any]:
    with open_hdf5(path, "the phases of the plan are") as file:
        values = file.read(_FILE)
    values.pop("fingerprint")  # of those who wrote it; what is there decides
    if _fingerprint(values) != fingerprint:
        raise InvalidInput(
            f"{path}: its signals are not those of the plan that names it (fingerprint "
            f"{_fingerprint(values)}, the plan has {fingerprint}); keep both files together"
        )
    return values


def _fingerprint(values: Mapping[str, Any]) -> str:
    return fingerprint({name: np.asarray(values[name], dtype="<f8") for name in _ARRAYS})[:16]
