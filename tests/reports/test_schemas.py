"""What JSON Schemas tell of the keys of files."""

import re

import pytest

from oed.experiment import experiment_file as experiment
from oed.study.settings import (
    candidates_settings,
    deflection_settings,
    design_settings,
    study_file as study,
)
from oed.visit_study import study_file as visit_study
from reports.commands.schemas import json_schema, key_words
from robotmodels.description import robot_file
from robotmodels.logs import mapping_file


def described(schema, node, at=()):
    """Return the keys that the schema describes, by all keys that lead to them."""
    found = {}
    for name, content in node.get("properties", {}).items():
        if "description" in content:
            found[*at, name] = content["description"]
        for model in re.findall(r"'#/\$defs/(\w+)'", str(content)):
            found |= described(schema, schema["$defs"][model], (*at, name))
    return found


@pytest.mark.parametrize(
    ("kind", "modules", "chosen"),
    [
        # Names that the user chooses, and what stands below them, are no keys of a schema.
        ("study", [study, candidates_settings, design_settings], {"elbow_joint", "folded"}),
        ("experiment", [experiment], set()),
        ("robot", [robot_file], set()),
        ("import", [mapping_file], {"block_2", "a6"}),
        ("deflection_study", [deflection_settings], set()),
        ("visit_study", [visit_study], set()),
    ],
)
def test_what_docstrings_say_of_keys_is_in_the_schema(kind, modules, chosen):
    schema = json_schema(kind)
    known = described(schema, schema)
    for module in modules:
        words = key_words(module)
        assert words
        for keys, said in words.items():
            assert known.get(keys) == said or chosen & set(keys), keys


def test_every_key_of_robot_files_is_described():
    schema = json_schema("robot")
    for model in ("Motor", "Spring", "Output", "Accelerometer", "Payload", "Choice"):
        for key, content in schema["$defs"][model]["properties"].items():
            assert content.get("description"), (model, key)
    known = described(schema, schema)
    assert known["motors", "gear_ratio"].startswith("motor turns")
    assert "its slope at rest" in known["springs", "stiffness"]  # of the line below the key


def test_every_key_of_controller_files_is_described():
    schema = json_schema("controller")
    assert set(described(schema, schema)) == {
        *((name,) for name in ("sample_time", "A", "B", "C", "D", "motors")),
        *(("motors", name) for name in ("numerator", "denominator")),
    }


def test_words_that_name_an_alternative_name_the_value_too():
    schema = json_schema("study")
    known = described(schema, schema)
    assert known["data", "covariance"] == "total or noise, which misses distortion"
    assert known["data", "experiment", "blocks"].startswith("per experiment")
    assert known["design", "criterion"] == "D or A, E, Ds, As, maximin, I"
