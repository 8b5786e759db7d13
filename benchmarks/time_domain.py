"""Springs and dampers by rollouts in time, mujoco.sysid, beside fits of FRFs: the same records.

    python benchmarks/time_domain.py [--starts 3]

writes `benchmarks/results/time_domain.json`. The case is that of a study's `time_domain`, see
`oed.replication.time_domain_comparison`; mujoco.sysid comes with ``pip install '.[sysid]'``.
"""

import argparse
import json
import os

import numpy as np
from linearisation import HERE, machine

from oed.replication.time_domain_comparison import compare
from oed.study.settings.study_file import TimeDomainChoice
from robotmodels.common.plain_data import json_data

RESULTS = HERE / "results" / "time_domain.json"


def main() -> None:
    """Run both, print and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=3)
    asked = parser.parse_args()
    found = compare(TimeDomainChoice(starts=asked.starts), np.random.default_rng(1))
    for way in found.ways:
        print(
            f"{way.name}, starts within {way.decades:g} decades: {way.successes} of {way.starts} "
            f"succeed, springs {way.spring_error:.2g}, dampers {way.damper_error:.2g}, "
            f"{way.seconds:.3g} s per start"
        )
    if found.missing:
        print(f"mujoco.sysid did not run: no module {found.missing}")
    results = json_data(found) | {"machine": machine() | {"load_average": os.getloadavg()[0]}}
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
