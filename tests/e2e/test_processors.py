"""The same answer on every processor: an older one's instructions change what rounding can."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from conftest import STUDY, write_study

# Kernels of OpenBLAS, of numpy, of the C library and of numba as on a processor without AVX.
OLDER = {
    "OPENBLAS_CORETYPE": "Nehalem",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4",
    "NUMBA_CPU_NAME": "nehalem",
}
# What is compared does not rest on the numbers of simulated runs and samples.
FEWER = STUDY.replace("runs: 12", "runs: 0").replace("steps: 400", "steps: 100")


@pytest.fixture(scope="module")
def older(tmp_path_factory):
    """Return results of the small study as an older processor has them."""
    path = write_study(tmp_path_factory.mktemp("older"), FEWER)
    program = "from reports import cli; cli.main()"
    subprocess.run(
        [sys.executable, "-c", program, "sample", str(path), "--workers", "1"],
        env=os.environ | OLDER,
        check=True,
        capture_output=True,
    )
    return path.parent / "results" / "here"


def read(folder, name):
    return json.loads((folder / name).read_text(encoding="utf-8"))


def test_plans_are_the_same(small_study, older):
    here, there = (read(folder, "design.json") for folder in (small_study[0], older))
    plans = [
        [(row["candidate"], row["repetitions"]) for row in one["positions"] if row["repetitions"]]
        for one in (here, there)
    ]
    assert plans[0] == plans[1]
    for name in ("efficiency", "value"):
        section = "exact" if name == "efficiency" else "relaxed"
        # As far as a gap of 1e-6 leaves them open.
        assert here[section][name] == pytest.approx(there[section][name], rel=1e-6)


def test_estimates_and_standard_deviations_agree(small_study, older):
    fits = [read(folder, "fit.json") for folder in (small_study[0], older)]
    estimates = [[row["estimate"] for row in one["parameters"]] for one in fits]
    np.testing.assert_allclose(*estimates, rtol=1e-8)
    assert fits[0]["origin"] == fits[1]["origin"]
    theorem = [read(folder, "uncertainty.json")["theorem1"] for folder in (small_study[0], older)]
    np.testing.assert_allclose(*[one["std"] for one in theorem], rtol=1e-8)
    np.testing.assert_allclose(*[one["correlation"] for one in theorem], atol=1e-8)
