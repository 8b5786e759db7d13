"""The measurements of a real two-inertia motor bench, as records; see shared/data."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from robotmodels.records.records import Records

PATH = Path(__file__).parents[2].parent / "shared" / "data" / "motor_bench" / "MultisineTypeB.mat"
LINES = np.arange(13, 250, 4)
DETECTION = np.arange(15, 249, 4)
SAMPLES, PERIODS, RATE = 2500, 20, 2500.0


def bench_data():
    """Return the file's variables; skip the test where it is absent, fail it in CI."""
    if not PATH.is_file():
        message = f"{PATH} is absent: the motor bench's measurements, see shared/data"
        if os.environ.get("CI") == "true":
            pytest.fail(message)
        pytest.skip(message)
    return loadmat(PATH, squeeze_me=True)


def bench_records(data, angle):
    """Return records of the current, in place of the torque, and of one of the angles."""

    def shaped(signal):
        return np.asarray(signal, dtype=float).reshape(1, 1, 1, -1, SAMPLES, 1)

    return Records(
        positions=np.zeros((1, 1)),
        sample_time=1 / RATE,
        reference=shaped(data["ref"]),
        torque=shaped(data["iq_adx"]),  # the current: everything in units of the torque constant
        angle=shaped(angle),
        lines=LINES,
        detection=DETECTION,
        saturated=np.zeros((1, 1, 1, PERIODS, 1), dtype=bool),
    )
