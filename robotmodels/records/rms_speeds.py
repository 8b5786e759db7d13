"""How fast motors move in records: what Coulomb friction counts as depends on it."""

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.records.records import Records


def rms_speeds(records: Records, columns: list[int]) -> Array:
    """Return the root mean square of angles' rates over all runs, (n,) [rad/s].

    Parameters
    ----------
    records : Records
        Periodic runs.
    columns : list of int
        Which of the outputs are motor angles, n of them.

    Raises
    ------
    InvalidInput
        If a motor does not move.
    """
    angle = records.angle[..., columns]
    omega = 2 * np.pi * np.fft.rfftfreq(records.samples, records.sample_time)
    spectrum = np.abs(np.fft.rfft(angle, axis=4) / records.samples) * omega[:, None]
    power = 2 * np.sum(spectrum**2, axis=4)  # Parseval
    rms = np.sqrt(np.nanmean(power, axis=(0, 1, 2, 3)))
    if not (rms > 0).all():
        raise InvalidInput(f"records: output {columns[int(np.argmin(rms))] + 1} does not move")
    return np.asarray(rms)
