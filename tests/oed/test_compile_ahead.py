"""What fits call is compiled before they call it."""

import os
import subprocess
import sys

import pytest

SCRIPT = """
from oed.study.compile_ahead import compile_ahead
from robotmodels.kernel.adjoint import slopes
from robotmodels.kernel.compiling import is_stored
from robotmodels.kernel.cost_cells import cell_costs
from robotmodels.kernel.fisher import informations
from robotmodels.kernel.gauss_newton import cell_normals
from robotmodels.kernel.solve import responses

compile_ahead()
print(*map(is_stored, (slopes, cell_costs, cell_normals, responses, informations)))
"""


@pytest.mark.slow
def test_code_of_fits_is_stored_and_that_of_designs_left_to_another_process(tmp_path):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["True"] * 4 + ["False"]
