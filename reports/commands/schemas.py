"""JSON Schemas of the files that people write, with a description of each key."""

import inspect
import re
from types import ModuleType
from typing import Any

from robotmodels.common.errors import check_word
from robotmodels.common.yaml_files import FileSection

KINDS = (
    "study",
    "experiment",
    "robot",
    "chain_study",
    "import",
    "deflection_study",
    "visit_study",
    "campaign",
    "controller",
)

Words = dict[tuple[str, ...], str]
"""Descriptions by the keys that lead to a key."""

_KEY = re.compile(r"(?P<indent> *)(?P<off># )?(?P<key>[a-z_]+):(?P<rest>.*)")


def json_schema(kind: str) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of one of the `KINDS` of files.

    Raises
    ------
    InvalidInput
        For another kind of file.
    """
    from oed.campaign import settings as campaign
    from oed.chain_study import study_file as chain_study
    from oed.experiment import experiment_file as experiment
    from oed.study.settings import (
        candidates_settings,
        deflection_settings,
        design_settings,
        study_file as study,
    )
    from oed.visit_study import study_file as visit_study
    from robotmodels.description import robot_file
    from robotmodels.logs import mapping_file
    from robotmodels.simulation.linear_feedback import ControllerFile

    shaken = key_words(experiment)
    kinds: dict[str, tuple[type[FileSection], Words]] = {
        "study": (
            study.Study,
            key_words(study)
            | key_words(candidates_settings)
            | key_words(design_settings)
            | {("data", "experiment", *keys): words for keys, words in shaken.items()},
        ),
        "deflection_study": (
            deflection_settings.DeflectionStudy,
            key_words(deflection_settings),
        ),
        "visit_study": (
            visit_study.VisitStudy,
            shaken
            | key_words(candidates_settings)
            | key_words(campaign)
            | key_words(design_settings)
            | key_words(visit_study),
        ),
        "experiment": (experiment.Experiment, shaken),
        "campaign": (
            campaign.CampaignSettings,
            shaken | key_words(candidates_settings) | key_words(campaign),
        ),
        "controller": (ControllerFile, {}),  # its fields are described where they stand
        "robot": (robot_file.RobotFile, key_words(robot_file)),
        "import": (mapping_file.Mapping, key_words(mapping_file)),
        "chain_study": (
            chain_study.ChainStudy,
            {
                ("experiment", *keys): words
                for keys, words in shaken.items()
                if keys[0] == "multisine"
            }
            | key_words(chain_study),
        ),
    }
    check_word("kind of file", kind, KINDS)
    model, words = kinds[kind]
    schema: dict[str, Any] = model.model_json_schema(by_alias=True)
    _describe(schema, schema.get("$defs", {}), words, ())
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | schema


def key_words(module: ModuleType) -> Words:
    """Return what the comments of the commented file in a module's docstring say of its keys."""
    descriptions: Words = {}
    within: list[tuple[int, str]] = []  # keys of the line and above it, with their indentation
    for line in (inspect.getdoc(module) or "").splitlines():
        if not line.startswith("    "):
            continue
        if key := _KEY.fullmatch(line):
            indent = len(key["indent"])
            within = [(depth, name) for depth, name in within if depth < indent]
            within.append((indent, key["key"]))
            # A key that is commented out has its words behind its value too.
            value, *comment = re.split(
                r" {3,}" if key["off"] else r"\s#\s", key["rest"], maxsplit=1
            )
            words = "".join(comment).strip()
            words = f"{value.strip()} {words}" if words.startswith("or ") else words
        elif line.lstrip().startswith("# "):  # goes on
            words = line.lstrip()[2:].strip()
        else:
            continue
        keys = tuple(name for _, name in within)
        descriptions[keys] = f"{descriptions.get(keys, '')} {words}".strip()
    return {keys: words.rstrip(",;: ") for keys, words in descriptions.items() if words}


def _describe(
    node: dict[str, Any], models: dict[str, Any], words: Words, at: tuple[str, ...]
) -> None:
    """Write descriptions into the properties of `node`, which lies under the keys `at`."""
    for name, content in node.get("properties", {}).items():
        keys = (*at, name)
        if keys in words:
            content.setdefault("description", words[keys])
        for reference in re.findall(r"'#/\$defs/(\w+)'", str(content)):
            _describe(models[reference], models, words, keys)
