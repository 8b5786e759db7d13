"""Mutants: how one is made from a format and a random number, run, and judged."""

import re
import shutil
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

import contents
from formats import FORMATS, Format
from runner import Outcome, Runner

LONGEST = 1500
"""Of a line of error [characters]."""


@dataclass(frozen=True)
class Mutant:
    """A changed file in a folder, and the command that is to read it."""

    format: Format
    folder: Path
    file: Path
    words: tuple[str, ...]
    draws: bool


def mutant(format: Format, seeds: Path, folder: Path, rng: Random) -> Mutant:
    """Copy a seed to `folder`, which must not be there, and change one file in it."""
    shutil.copytree(seeds / format.seed, folder, symlinks=True)
    file = rng.choice(format.paths(seeds))
    path = folder / file
    if rng.randrange(40):
        change = rng.choice(format.mutations)
        path.write_bytes(change(path.read_bytes(), rng))
    else:
        contents.another_kind(path, rng)
    words = tuple(w.replace("{file}", str(file)) for w in rng.choice(format.commands).split())
    if format.after is not None:
        format.after(folder, file, rng)
    return Mutant(format, folder, file, words, not rng.randrange(12))


def run(runner: Runner, mutant: Mutant) -> tuple[Outcome, str]:
    """Run a mutant's command; return how it ended and what is wrong with that, or nothing."""
    outcome = runner.run(mutant.words, mutant.folder, mutant.draws)
    return outcome, wrong(outcome)


def wrong(outcome: Outcome, codes: Sequence[int] = (0, 2)) -> str:
    """Return what is wrong with how a command ended, in a few words that name the cause."""
    errors = outcome.err
    if outcome.late:
        return f"no end: {_place(errors)}"
    if "Traceback (most recent call last)" in errors:
        return f"traceback: {_last(errors)} at {_place(errors)}"
    if outcome.code < 0:
        return f"signal {-outcome.code}: {_place(errors)}"
    if outcome.code not in codes:
        return f"exit code {outcome.code}: {errors[:300]!r}"
    for stream in (outcome.out, errors):
        control = next((c for c in stream if _is_control(c)), None)
        if control is not None:
            at = stream.index(control)
            return f"control character on the terminal: {stream[max(at - 60, 0) : at + 20]!r}"
    lines = errors.splitlines()
    if outcome.code == 0:
        strange = [line for line in lines if not line.startswith("warning: ")]
        return f"on stderr: {strange[0][:200]!r}" if strange else ""
    if len(lines) != 1:
        return f"{len(lines)} lines of error: {errors[:400]!r}"
    if not errors.startswith("error: ") or len(errors) > LONGEST:
        return f"{len(errors)} characters of error: {errors[:200]!r}"
    return ""


def _is_control(character: str) -> bool:
    """Whether a terminal would obey it, or show what follows elsewhere."""
    category, bidirectional = unicodedata.category(character), unicodedata.bidirectional(character)
    moves = bidirectional in ("LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI")
    return (category in ("Cc", "Zl", "Zp") and character not in "\n\t") or moves


def _last(errors: str) -> str:
    """Return the type of the error that a traceback ends with."""
    lines = [m for line in errors.splitlines() if (m := re.match(r"[A-Za-z_][\w.]*(?=:|$)", line))]
    return lines[-1][0] if lines else "error"


def _place(errors: str) -> str:
    """Return the innermost frame of ours that a traceback names."""
    frames = re.findall(r'File "([^"]+)", line (\d+)(?:,)? in (\S+)', errors)
    ours = [
        (path, line, name)
        for path, line, name in frames
        if re.search(r"/(robotmodels|estimators|oed|reports)/", path)
        and "site-packages" not in path
    ]
    if not ours:
        return "nowhere of ours"
    # faulthandler names the innermost first, a traceback last.
    path, line, name = ours[0] if "most recent call first" in errors else ours[-1]
    path = re.sub(r".*/(?=(robotmodels|estimators|oed|reports)/)", "", path)
    return f"{path}:{line} {name}"


def chosen_formats(word: str = "") -> list[Format]:
    """Return the formats whose name has a word in it."""
    return [format for format in FORMATS if word in format.name]
