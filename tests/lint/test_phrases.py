"""The check of phrases finds them in templates, strings and help, and leaves names alone."""

import phrases
import pytest

HEAD = '"""A file of which nobody says what came out as."""\n'


def lines_of(folder, text, name="reports/texts.py"):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return list(phrases.faults(folder))


def test_the_packages_use_the_terms_of_the_field():
    assert list(phrases.faults(phrases.ROOT)) == []


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("reports/texts.py", HEAD + 'TEXT = f"the plan beats {3} others"\n'),
        (
            "reports/texts.py",
            'def run():\n    """Say what springs come out as.\n\n    Example: oed run x\n    """\n',
        ),
        ("reports/templates/page.html.j2", "<p>{{ count }} rivals</p>"),
    ],
)
def test_a_phrase_is_found(tmp_path, name, text):
    [line] = lines_of(tmp_path, text, name)
    assert line.startswith(name)
    assert "the field says" in line


def test_docstrings_of_public_names_name_the_thing(tmp_path):
    (tmp_path / "oed").mkdir()
    (tmp_path / "oed" / "__init__.pyi").write_text("from oed.a import A as A, B as B\n")
    text = 'class A:\n    """What it is."""\n\n\nclass C:\n    """What it is."""\n'
    [line] = lines_of(tmp_path, text, "oed/a.py")
    assert line.startswith("oed/a.py:1")


def test_docstrings_and_names_are_left_alone(tmp_path):
    assert lines_of(tmp_path, HEAD + 'KEY = "rivals_of"\n') == []
