"""YAML 1.2: what plain words mean, and what has no place in a file that a person writes."""

import math
import os
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from robotmodels.common import yaml_reader
from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import check_file
from robotmodels.common.yaml_files import read_text
from robotmodels.common.yaml_reader import YamlError, read_document


@pytest.fixture(params=["CSafeLoader", "SafeLoader"], autouse=True)
def _parser(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """PyYAML has its parser in C, or without a compiler in Python."""
    if not hasattr(yaml, request.param):
        pytest.skip("PyYAML without libyaml")
    monkeypatch.setattr(yaml_reader, "_PARSER", getattr(yaml, request.param))


@pytest.mark.parametrize(
    ("text", "meaning"),
    [
        ("0100", 100),
        ("0o14", 12),
        ("0xff", 255),
        ("-7", -7),
        ("+7", 7),
        ("1e5", 1e5),
        ("1.", 1.0),
        (".5e-3", 0.5e-3),
        ("-.inf", -math.inf),
        ("true", True),
        ("FALSE", False),
        ("~", None),
        ("", None),
        *((word, word) for word in ("on", "off", "yes", "no", "y", "N", "1:40", "1_000", "0x_")),
        *(
            (word, word)
            for word in ("2001-13-45", "2001-12-14", "0b1", "0o8", ".", "e5", "٣", "1 0")
        ),
        ("'1.5'", "1.5"),
        ('"true"', "true"),
        ("! 1.5", "1.5"),
        ("!!str 1.5", "1.5"),
        ("!!float 2", 2.0),
        ("!!int '3'", 3),
        ("<<", "<<"),
        ("=", "="),
    ],
)
def test_words_mean_what_the_core_schema_says(text: str, meaning: Any) -> None:
    value = read_document(f"key: {text}").content["key"]
    assert (type(value), value) == (type(meaning), meaning) or text == "!!float 2"
    assert value == meaning


def test_keys_are_text_as_they_are_written() -> None:
    document = read_document("on: 1\n0100: 2\nnull: 3\n'on ': 4\n")
    assert document.content == {"on": 1, "0100": 2, "null": 3, "on ": 4}


def test_aliases_repeat_a_value_and_its_lines_are_those_of_the_keys() -> None:
    document = read_document("a: &one\n  - 1.0\n  - 2.0\nb: *one\n")
    assert document.content == {"a": [1.0, 2.0], "b": [1.0, 2.0]}
    assert document.line_of(("a", 1)) == 3
    assert document.line_of(("b",)) == 4
    assert document.line_of(("c",)) is None


def bomb(levels: int) -> str:
    lines = ["a0: &a0 [1, 2, 3, 4, 5, 6, 7, 8, 9]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, levels)]
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "line", "problem"),
    [
        ("a: 1\na: 2\n", 2, "key 'a' is given twice"),
        ("a: 1\n'a': 2\n", 2, "key 'a' is given twice"),
        ("a: 1\n? [b]\n: 2\n", 2, "a key is a list"),
        ("a: &a 1\n*a : 2\n", 2, "a key is a list, a mapping or an alias"),
        ("a: &x [*x]\n", 1, "alias *x has no anchor before it"),
        ("a: !!float abc\n", 1, "'abc' is not what its tag tag:yaml.org,2002:float says"),
        ("a: !!int 3.5\n", 1, "is not what its tag"),
        ("a: !!timestamp 2001-13-45\n", 1, "tag tag:yaml.org,2002:timestamp is not used here"),
        ("a: !!python/object:os.system x\n", 1, "is not used here"),
        ("a: !!set {b, c}\n", 1, "is not used here"),
        ("a: 1\n---\nb: 2\n", 2, "a second document begins"),
        ("%YAML 1.1\n---\na: on\n", 1, "YAML 1.1, not 1.2"),
        ("\na: " + "[" * 1500, 2, "nest"),
        ("\na: " + "- " * 1500, 2, "not allowed|nested more than 32 deep"),
        ("a: " + "{a: " * 40, 1, "nested more than 32 deep"),
        ("- " * 1500, 1, "nest"),
        (bomb(10), 7, "more than 1000000 values"),
        (
            "a0: &a0 [1]\n" + "\n".join(f"a{k}: &a{k} [*a{k - 1}]" for k in range(1, 50)),
            32,
            "nested more than 32 deep",
        ),
        ("a:\n- " + "1" * 401, 2, "a number of 401 characters"),
        ("a: b\nc: d\x00\n", 2, "it has a control character"),
        ("a: \x9b31m\n", 1, "it has a control character"),
        ('a: "\\ud800"\n', 1, "invalid Unicode|which is not text"),
        ('a: "\\x1b[31m"\n', 1, "it has the character \\u001b, which is not text"),
        ('"\\0": 1\n', 1, "which is not text"),
        ('a: "\\u202e"\n', 1, "which is not text"),
        ("a: [1\nb: 2\n", 2, "expected ',' or ']'"),
    ],
)
def test_what_is_not_read_is_refused_with_its_line(text: str, line: int, problem: str) -> None:
    with pytest.raises(YamlError) as error:
        read_document(text)
    assert any(part in str(error.value) for part in problem.split("|")), str(error.value)
    assert error.value.line == line


@pytest.mark.skipif(sys.platform == "win32", reason="there are no such files")
def test_devices_pipes_folders_and_long_files_are_no_files(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "long").write_text("a" * 11)
    for path, problem in (
        (Path("/dev/zero"), "it is a device or a pipe"),
        (tmp_path / "pipe", "it is a device or a pipe"),
        (tmp_path, "it is a folder"),
        (tmp_path / "none", "no such file"),
        (tmp_path / "a\0b", "cannot be read"),
        (tmp_path / ("a" * 300), "cannot be read"),
        (tmp_path / "long", "a file of this kind has at most"),
    ):
        with pytest.raises(InvalidInput, match=problem):
            read_text(path, 10, "a study")
    check_file(tmp_path / "long", 11)
