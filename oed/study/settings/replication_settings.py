"""What a study file says of the published study that it repeats."""

from typing import Annotated

from pydantic import Field

from robotmodels.common.yaml_files import FileSection


class RivalChoice(FileSection):
    """How many starts of the time-domain rival, at each distance from the truth [decades]."""

    starts: Annotated[int, Field(ge=1, le=1000)] = 3
    decades: Annotated[
        tuple[Annotated[float, Field(gt=0, le=1.4)], ...], Field(min_length=1, max_length=20)
    ] = (
        0.1,
        1.0,
    )


ESTIMATORS = ("LLSM15U", "LLS15U", "LLS15O", "NLS15U", "NLS15O", "LLS1U")
"""M: magnitude only; 15 or 1: positions; U or O: user-defined or optimal weights."""
