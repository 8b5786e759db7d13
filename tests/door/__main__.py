"""Say for each alteration what is said of the spoiled data, and how many good data are questioned.

python tests/door [--seeds N]
"""

import sys

from alter import FRFS, RECORDS, estimated, listed, questions
from good_data import ROBOTS, good_data


def main() -> None:
    seeds = int(sys.argv[sys.argv.index("--seeds") + 1]) if "--seeds" in sys.argv else 0
    for robot in ROBOTS:
        data = good_data(robot, 0)
        good = estimated(data, data.records)[0]
        for name in ["", *FRFS, *RECORDS]:
            said = questions(data, name, good)
            line = said[0][:150] if said else "-"
            print(f"{robot:12} {name:26} {len(said)} {line}", flush=True)
    questioned = {
        (robot, seed): said
        for seed in range(seeds)
        for robot in ROBOTS
        if (said := questions(good_data(robot, seed), ""))
    }
    print(f"{len(questioned)} of {seeds * len(ROBOTS)} good data questioned: {questioned}")
    unlisted = {*listed()} ^ {*FRFS, *RECORDS}
    print("in the list alone, or not in it:", *sorted(unlisted))


main()
