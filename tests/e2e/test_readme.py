"""The README's example prints what the README says it prints."""

import re
import subprocess
import sys
from pathlib import Path

README = Path(__file__).parents[2] / "README.md"


def test_the_library_example_gives_its_numbers():
    text = README.read_text(encoding="utf-8")
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    shown = re.search(r"```text\n(.*?)```", text, re.DOTALL)
    assert code is not None
    assert shown is not None
    assert sum(bool(line.strip()) for line in code[1].splitlines()) == 15
    run = subprocess.run(
        [sys.executable, "-c", code[1]], capture_output=True, text=True, check=True, timeout=300
    )
    printed = [line.split() for line in run.stdout.splitlines()]
    for line in shown[1].splitlines():
        if line.strip() == "...":
            continue
        words = line.split()
        match = next(p for p in printed if p and p[0] == words[0])
        assert [w for w in match if not _number(w)] == [w for w in words if not _number(w)]
        for got, said in zip(filter(_number, match), filter(_number, words), strict=True):
            assert abs(float(got) - float(said)) <= 0.02 * abs(float(said))


def _number(word: str) -> bool:
    return re.fullmatch(r"[\d.]+", word) is not None
