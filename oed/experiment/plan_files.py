"""Plans on disk: a YAML file to read and an HDF5 file of arrays beside it.

``PLAN.yaml`` (``schema: plan/1``) holds everything a person looks for; ``duration`` [s] is there to
be read only, it follows from the rest; ``order``, where positions were reordered, tells their
places among those given and what the moves take [s]. ``PLAN.h5`` has the datasets ``phases``
(V, B, F, n) [rad], ``amplitudes`` (F, n) [rad/s] and ``scale`` (V,), and the attribute
``fingerprint`` that the YAML file repeats, so that two files of different plans cannot be taken
for one.
"""

import os
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import Field

from oed.experiment.experiment_plan import ExperimentPlan
from oed.experiment.moves import MoveLimits
from oed.experiment.multisine import Multisine
from oed.experiment.visiting_order import VisitingOrder
from robotmodels.common.arrays import read_only
from robotmodels.common.atomic_files import atomic_write
from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import reason
from robotmodels.common.fingerprints import fingerprint
from robotmodels.common.yaml_files import Strict, read_yaml
from robotmodels.common.yaml_reader import reads_as_text
from robotmodels.data_files.array_schema import ArraySchema
from robotmodels.data_files.array_schema import Field as ArrayField
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


class MultisineSection(Strict):
    """Lines of the multisine."""

    samples: Count
    sample_time: float
    odd: bool
    lines: list[Count]
    detection: list[Count]


class MovesSection(Strict):
    """Limits of the moves, arm side."""

    positions: list[tuple[float, float]]
    speed: list[float]
    acceleration: list[float]
    start: list[float]


class OrderSection(Strict):
    """How the positions came to be in this order, see `VisitingOrder`."""

    order: list[int]
    duration: float
    given: float
    optimal: bool


class PlanFile(Strict):
    """A plan file, ``schema: plan/1``."""

    schema_: Literal["plan/1"] = Field(alias="schema")
    robot: str
    motors: list[str]
    duration: float
    blocks: Count
    periods: Count
    transient_periods: Count
    repetitions: list[Count]
    positions: list[list[float]]
    order: OrderSection | None = None
    moves: MovesSection
    multisine: MultisineSection
    signals: str
    fingerprint: str


class _Dumper(yaml.SafeDumper):
    """Quotes the words that YAML 1.2 takes for numbers too, such as ``1e5``."""

    def represent_str(self, data: str) -> yaml.ScalarNode:
        style = None if reads_as_text(data) else '"'
        return self.represent_scalar("tag:yaml.org,2002:str", data, style)


_Dumper.add_representer(str, _Dumper.represent_str)


def save_plan(plan: ExperimentPlan, path: str | os.PathLike[str]) -> None:
    """Write the YAML file `path`, and the arrays beside it as ``.h5``; each appears complete.

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
    values = {"phases": plan.phases, "amplitudes": plan.multisine.amplitudes, "scale": plan.scale}
    fingerprint = _fingerprint(values)
    text = yaml.dump(
        _document(plan, arrays.name, fingerprint),
        Dumper=_Dumper,
        sort_keys=False,
        default_flow_style=None,
        width=100,
        allow_unicode=True,
    )
    try:
        # The inner one takes its place first: no plan names arrays that are not there.
        with atomic_write(target) as unfinished, atomic_write(arrays) as unfinished_arrays:
            with h5py.File(unfinished_arrays, "w") as file:
                file.attrs["fingerprint"] = fingerprint
                for name in _ARRAYS:
                    file[name] = values[name]
            unfinished.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InvalidInput(f"{target}: cannot be written to ({reason(error)})") from None


def load_plan(path: str | os.PathLike[str]) -> ExperimentPlan:
    """Read a plan.

    Raises
    ------
    InvalidInput
        Naming the file and what is wrong in it.
    """
    path = Path(path)
    plan = read_yaml(path, PlanFile)
    if Path(plan.signals).name != plan.signals or plan.signals == "..":
        raise InvalidInput(
            f"{path}: signals: {plan.signals!r}; the name of a file in the same folder is needed"
        )
    arrays = _read_arrays(path.parent / plan.signals, plan.fingerprint)
    try:
        built = ExperimentPlan(
            robot=plan.robot,
            positions=_matrix("positions", plan.positions),
            repetitions=np.array(plan.repetitions, dtype=np.int64),
            multisine=Multisine(
                samples=plan.multisine.samples,
                sample_time=plan.multisine.sample_time,
                lines=np.array(plan.multisine.lines, dtype=np.int64),
                inputs=len(plan.motors),
                amplitudes=arrays["amplitudes"],
                detection=np.array(plan.multisine.detection, dtype=np.int64),
                odd=plan.multisine.odd,
            ),
            phases=arrays["phases"],
            periods=plan.periods,
            transient_periods=plan.transient_periods,
            moves=MoveLimits(
                motors=tuple(plan.motors),
                positions=np.array(plan.moves.positions),
                speed=np.array(plan.moves.speed),
                acceleration=np.array(plan.moves.acceleration),
            ),
            scale=arrays["scale"],
            start=np.array(plan.moves.start),
            order=_order(plan.order, len(plan.positions)),
        )
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from None
    if built.blocks != plan.blocks:
        raise InvalidInput(
            f"{path}: blocks: {plan.blocks}, but {plan.signals} holds the phases of {built.blocks}"
        )
    return built


def _document(plan: ExperimentPlan, signals: str, fingerprint: str) -> dict[str, Any]:
    sine, moves = plan.multisine, plan.moves
    start = plan.positions[0] if plan.start is None else plan.start
    return {
        "schema": "plan/1",
        "robot": plan.robot,
        "motors": list(plan.motors),
        "duration": plan.duration,
        "blocks": plan.blocks,
        "periods": plan.periods,
        "transient_periods": plan.transient_periods,
        "repetitions": plan.repetitions.tolist(),
        "positions": plan.positions.tolist(),
        **_order_document(plan.order),
        "moves": {
            "positions": moves.positions.tolist(),
            "speed": moves.speed.tolist(),
            "acceleration": moves.acceleration.tolist(),
            "start": start.tolist(),
        },
        "multisine": {
            "samples": sine.samples,
            "sample_time": float(sine.sample_time),
            "odd": bool(sine.odd),
            "lines": sine.lines.tolist(),
            "detection": sine.detection.tolist(),
        },
        "signals": signals,
        "fingerprint": fingerprint,
    }


def _order_document(order: VisitingOrder | None) -> dict[str, Any]:
    """Return how positions were put in order; nothing where they are as given."""
    if order is None:
        return {}
    rest = {"duration": order.duration, "given": order.given, "optimal": order.optimal}
    return {"order": {"order": order.order.tolist(), **rest}}


def _order(section: OrderSection | None, count: int) -> VisitingOrder | None:
    if section is None:
        return None
    if sorted(section.order) != list(range(count)):
        raise InvalidInput(
            f"order: {section.order[:8]} ...; each of the numbers 0 to {count - 1} once is needed"
        )
    order = read_only(np.array(section.order, dtype=np.int64))
    return VisitingOrder(order, section.duration, section.given, section.optimal)


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


def _fingerprint(values: dict[str, Any]) -> str:
    return fingerprint({name: np.asarray(values[name], dtype="<f8") for name in _ARRAYS})[:16]


def _matrix(name: str, rows: list[list[float]]) -> Any:
    if len({len(row) for row in rows}) != 1:
        raise InvalidInput(f"{name}: rows of equal length are needed, one number per motor")
    return np.array(rows)
