"""``python tests/fuzz --minutes 30``: mutants of every format until the time is up.

One line for each cause of failure, then a table of outcomes; exit code 1 where there is a failure.
``--keep FOLDER`` keeps a folder for each cause: the mutant, ``COMMAND`` and ``STDERR``.
"""

import argparse
import shutil
import sys
import tempfile
import time
from collections import Counter, defaultdict
from pathlib import Path
from random import Random

from campaign import Mutant, chosen_formats, mutant, run
from runner import Outcome, Runner


def main() -> int:
    """Run mutants; return the exit code."""
    parser = argparse.ArgumentParser(prog="python tests/fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--format", default="", help="a word of the names of formats to use")
    parser.add_argument("--seed", type=int, default=0, help="number of the first mutant")
    parser.add_argument("--mutants", type=int, default=10**9, help="at most, of each format")
    parser.add_argument("--keep", type=Path, help="folder for mutants that fail")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as scratch:
        return _campaign(options, Path(scratch))


def _campaign(options: argparse.Namespace, scratch: Path) -> int:
    tally: dict[str, Counter[str]] = defaultdict(Counter)
    causes: Counter[str] = Counter()
    slowest = (0.0, "")
    with Runner(scratch / "seeds") as runner:
        end = time.monotonic() + 60 * options.minutes
        for number in range(options.seed, options.seed + options.mutants):
            for format in chosen_formats(options.format):
                if time.monotonic() > end:
                    break
                rng = Random(f"{format.name} {number}")
                made = mutant(format, scratch / "seeds", scratch / "work", rng)
                outcome, fault = run(runner, made)
                tally[format.name][_kind(outcome, fault)] += 1
                slowest = max(slowest, (outcome.seconds, f"{format.name} {number}"))
                if fault:
                    causes[fault] += 1
                    if causes[fault] == 1:
                        print(
                            f"{format.name} {number}: oed {' '.join(made.words)}: {fault}",
                            flush=True,
                        )
                        if options.keep:
                            _keep(options.keep / f"{len(causes):03d}", made, outcome, fault)
                shutil.rmtree(scratch / "work")
            else:
                continue
            break
    _table(tally)
    print(f"slowest: {slowest[0]:.1f} s ({slowest[1]})")
    for fault, count in causes.most_common():
        print(f"{count:6d}  {fault}")
    return int(bool(causes))


def _kind(outcome: Outcome, fault: str) -> str:
    return "failed" if fault else {0: "done", 2: "refused"}[outcome.code]


def _keep(folder: Path, made: Mutant, outcome: Outcome, fault: str) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    words = " ".join(made.words)
    (folder / "COMMAND").write_text(f"oed {words}\n# changed: {made.file}\n# {fault}\n")
    (folder / "STDERR").write_text(outcome.err)
    shutil.move(made.folder, folder / "work")
    made.folder.mkdir()


def _table(tally: dict[str, Counter[str]]) -> None:
    kinds = ("done", "refused", "failed")
    print(f"{'format':32}" + "".join(f"{kind:>9}" for kind in kinds))
    for name, counts in tally.items():
        print(f"{name:32}" + "".join(f"{counts[kind]:9d}" for kind in kinds))
    total = sum(tally.values(), Counter())
    print(f"{'all':32}" + "".join(f"{total[kind]:9d}" for kind in kinds))


if __name__ == "__main__":
    sys.exit(main())
