"""``python tests/reliability``: the figures of docs/reliability.md, counted anew.

Whatever fails is printed, counted in the page too, and makes the exit code 1.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path
from random import Random

TESTS = Path(__file__).parents[1]
sys.path[:0] = [str(TESTS / name) for name in ("e2e", "engines", "oed", "fuzz")]

from page import table, write_figures  # noqa: E402

SHARES = {"kills": 0.2, "finished": 0.15, "unfinished": 0.1, "mutants": 0.3, "designs": 0.25}
"""Of the time, for each part."""


def main() -> int:
    """Count until the time is up; return the exit code."""
    parser = argparse.ArgumentParser(prog="python tests/reliability", description=__doc__)
    parser.add_argument("--minutes", type=float, default=14.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write", action="store_true", help="figures into docs/reliability.md")
    options = parser.parse_args()
    seconds = {name: 60 * options.minutes * share for name, share in SHARES.items()}
    rows, faults = [], []
    for part in (damaged_studies, malformed_files, random_designs):
        for what, done, told in part(seconds, options.seed):
            rows.append([what, done, len(told)])
            faults += [f"{what}: {one}" for one in told]
            print(f"{what}: {done}, {len(told)} failed", flush=True)
    print(*faults, sep="\n")
    if options.write:
        write_figures("counts", table(["what", "how often", "failures"], rows))
    return int(bool(faults))


def damaged_studies(seconds, seed):
    """Kill a study, and damage its files; a result that differs in a bit is a failure."""
    from damage import DamagedStudy

    with tempfile.TemporaryDirectory() as folder:
        study, rng = DamagedStudy(Path(folder)), Random(seed)
        kills, cycles = study.killed(time.monotonic() + seconds["kills"], rng)
        finished = study.finished_files(time.monotonic() + seconds["finished"], rng)
        unfinished = study.unfinished_files(time.monotonic() + seconds["unfinished"], rng)
    return [
        (f"kills of a study at random moments, over {cycles} runs", kills.done, kills.faults),
        ("files of finished stages flipped, cut or removed", finished.done, finished.faults),
        ("files of unfinished stages, the same", unfinished.done, unfinished.faults),
    ]


def malformed_files(seconds, seed):
    """Give mutants of all formats to the commands that read them."""
    from campaign import chosen_formats, mutant, run
    from runner import Runner

    done, told, number = 0, [], seed
    end = time.monotonic() + seconds["mutants"]
    with tempfile.TemporaryDirectory() as name, Runner(Path(name) / "seeds") as runner:
        while time.monotonic() < end:
            for format in chosen_formats():
                with tempfile.TemporaryDirectory(dir=name) as work:
                    rng = Random(f"{format.name} {number}")
                    made = mutant(format, Path(name) / "seeds", Path(work) / "work", rng)
                    _, fault = run(runner, made)
                done += 1
                told += [f"{format.name} {number}: {fault}"] * bool(fault)
            number += 1
    return [("malformed files", done, told)]


def random_designs(seconds, seed):
    """Design for random and degenerate problems, half of them changed by 1e-13 besides."""
    from design_draws import check_design

    done, refused, told, end = 0, 0, [], time.monotonic() + seconds["designs"]
    while time.monotonic() < end:
        for change in (0.0, 1e-13):
            outcome = check_design(seed + done // 2, change)
            done, refused = done + 1, refused + outcome.refused
            told += [f"{outcome.label}: {outcome.failure}"] * bool(outcome.failure)
    return [(f"random designs, {refused} of them refused as beyond the stated limits", done, told)]


if __name__ == "__main__":
    sys.exit(main())
