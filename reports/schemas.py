"""JSON Schemas of the files that people write."""

from typing import Any

from robotmodels.errors import InvalidInput, nearest
from robotmodels.files import Strict

KINDS = ("study", "experiment", "robot")


def json_schema(kind: str) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a study, an experiment or a robot file.

    Raises
    ------
    InvalidInput : for another kind of file.
    """
    from oed.experiment.file import Experiment
    from oed.study.file import Study
    from robotmodels.description.robot_file import RobotFile

    models: dict[str, type[Strict]] = dict(zip(KINDS, (Study, Experiment, RobotFile), strict=True))
    if kind not in models:
        raise InvalidInput(f"{kind!r} is not a kind of file{nearest(kind, KINDS)}")
    schema: dict[str, Any] = models[kind].model_json_schema(by_alias=True)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | schema
