"""Tests compute as the command line does: one thread of linear algebra in every process."""

import os

# Products of large matrices round otherwise with two threads; a pool's workers would have one.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
