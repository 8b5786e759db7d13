import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from robotmodels.common.plain_data import json_data, json_text, split_arrays, write_json


@dataclass(frozen=True, eq=False)
class Pair:
    values: np.ndarray
    parts: tuple[float, ...]


PAIR = Pair(np.array([[1.0, np.nan], [np.inf, 2.0]]), (np.float64(0.5), float("nan"), True))


def test_json_has_lists_for_arrays_and_null_for_what_is_not_finite():
    assert json_data({"pair": PAIR, "n": np.int64(3)}) == {
        "pair": {"values": ((1.0, None), (None, 2.0)), "parts": (0.5, None, True)},
        "n": 3,
    }
    assert json.loads(json_text([PAIR]))[0]["values"] == [[1.0, None], [None, 2.0]]


def test_arrays_are_parted_by_the_path_of_their_field():
    plain, arrays = split_arrays({"a": (PAIR, PAIR)})
    assert list(arrays) == ["a/00000/values", "a/00001/values"]
    assert arrays["a/00001/values"] is PAIR.values
    name, content = plain["a"][0]
    assert name == "Pair"
    assert content["values"] == "<f8"
    assert content["parts"][0] == 0.5


@pytest.mark.parametrize("value", [Path("x"), {1, 2}, b"x", Pair, object()])
def test_what_is_neither_plain_data_nor_an_array_is_refused_by_its_path(value):
    with pytest.raises(TypeError, match=r"a/00001: .* is neither plain data nor an array"):
        json_data({"a": [1, value]})


def test_a_json_file_has_characters_that_every_program_reads(tmp_path):
    write_json(tmp_path / "x.json", {"name": "ü"})
    assert (tmp_path / "x.json").read_bytes() == b'{\n "name": "\\u00fc"\n}\n'
