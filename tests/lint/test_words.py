"""The check of names is silent on good ones and finds filler words wherever a name is given."""

import pytest
import words

GOOD = '''
"""What was found is kept in one place."""

from package.found import found


def product(left, right):
    """Return what is left."""
    found()
    return left @ right.kept(own=1)
'''


def lines_of(text, folder):
    path = folder / "module.py"
    path.write_text(text, encoding="utf-8")
    return words.faults(path, folder)


def test_uses_texts_and_sides_are_accepted(tmp_path):
    assert lines_of(GOOD, tmp_path) == []


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("found = 1", "found"),
        ("first, *_rest = x", "_rest"),
        ("x.kept = 1", "kept"),
        ("def f(known): ...", "known"),
        ("def f(*, own=1): ...", "own"),
        ("f = lambda given: given", "given"),
        ("def _held(): ...", "_held"),
        ("class Chosen: ...", "Chosen"),
        ("[wanted for wanted in x]", "wanted"),
        ("with f() as said: ...", "said"),
        ("if (place := f()): ...", "place"),
        ("PLACES = 1", "PLACES"),
        ("class A:\n    apart: float", "apart"),
        ("def f(left, middle): ...", "left"),
        ("try: ...\nexcept A as found: ...", "found"),
    ],
)
def test_a_filler_word_is_found(text, name, tmp_path):
    [line] = lines_of(text, tmp_path)
    assert line.startswith("module.py:")
    assert f"{name!r}" in line


def test_more_than_allowed_fails(monkeypatch, capsys):
    monkeypatch.setattr(words, "ALLOWED", {"robotmodels": -1})
    assert words.main() == 1
    assert "-1 are allowed" in capsys.readouterr().out
