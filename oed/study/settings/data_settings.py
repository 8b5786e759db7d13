"""The sections ``data`` and ``validation`` of a study file: what is fitted, and what is not."""

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from oed.experiment.experiment_file import ExcitationSettings
from robotmodels.common.yaml_files import FileSection
from robotmodels.description.ranges import Count, Index, NonNegative


class DataChoice(FileSection):
    """Where the data come from; FRFs by the noise law where none of the first three is given."""

    experiment: ExcitationSettings | None = None
    records: Path | None = None
    frf: Path | None = None
    noise: Literal["auto", "blocks", "periods", "detection"] | tuple[NonNegative, NonNegative] = (
        "auto"
    )
    method: Literal["ari", "har", "log", "h1", "jio"] = "ari"
    covariance: Literal["total", "noise"] = "total"
    structure: Literal["diagonal", "full"] = "diagonal"
    delay: Annotated[float, Field(ge=-1e3, le=1e3)] = 0.0
    hold: bool = True
    coulomb_speeds: Literal["file", "data"] | tuple[float, ...] = "file"
    friction: bool = False

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        sources = [k for k in ("experiment", "records", "frf") if getattr(self, k) is not None]
        if len(sources) > 1:
            raise ValueError(f"{' and '.join(sources)} given; one of them is needed")
        if self.coulomb_speeds == "data" and not self.recorded:
            raise ValueError(
                "coulomb_speeds: 'data' are the speeds of an experiment or of records, which are "
                "not given; list them, one for each motor"
            )
        return self

    @property
    def measured(self) -> bool:
        """Whether the data come from files."""
        return self.records is not None or self.frf is not None

    @property
    def recorded(self) -> bool:
        """Whether the data are records."""
        return self.records is not None or self.experiment is not None


class ValidationChoice(FileSection):
    """Which positions check predictions instead of being fitted.

    Of simulated data `count` candidates that the plan does not use; of measured data some of their
    positions, counted from 0, or a share of them drawn at random.
    """

    count: Count | None = None
    positions: Annotated[tuple[Index, ...], Field(min_length=1)] | None = None
    share: Annotated[float, Field(gt=0, lt=1)] | None = None

    @model_validator(mode="after")
    def _one(self) -> Self:
        keys = [k for k in ("count", "positions", "share") if getattr(self, k) is not None]
        if len(keys) != 1:
            listed = " and ".join(keys) or "none of count, positions and share"
            raise ValueError(f"{listed} given; one of them is needed")
        return self
