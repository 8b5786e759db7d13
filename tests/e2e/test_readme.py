"""The README's example prints what the README says it prints."""

import re
from pathlib import Path

README = Path(__file__).parents[2] / "README.md"


def test_the_library_example_gives_its_numbers(capsys):
    text = README.read_text(encoding="utf-8")
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    shown = re.search(r"```text\n(.*?)```", text, re.DOTALL)
    assert code is not None
    assert shown is not None
    assert sum(bool(line.strip()) for line in code[1].splitlines()) == 15
    exec(compile(code[1], README.name, "exec"), {"__name__": "__main__"})
    printed = [line.split() for line in capsys.readouterr().out.splitlines()]
    for line in shown[1].splitlines():
        if line.strip() == "...":
            continue
        words = line.split()
        match = next(p for p in printed if p and p[0] == words[0])
        assert len(match) == len(words)
        for got, said in zip(match, words, strict=True):
            if _number(said) is None:
                assert got == said
            else:
                assert abs(_number(got) - _number(said)) <= 0.02 * abs(_number(said))


def _number(word: str) -> float | None:
    """Return the number that a word is, brackets and commas aside."""
    bare = word.strip("[](),")
    return float(bare) if re.fullmatch(r"[\d.]+", bare) else None
