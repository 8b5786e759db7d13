"""Low frequencies that friction distorts, found and left out."""

import numpy as np

from estimators.modal_data import Data
from robotmodels.arrays import Array
from robotmodels.errors import InvalidInput

# Relative distortion from which on a line at the low end is not trusted, and how far it must stand
# out from that of the rest of the band.
_LARGEST = 0.05
_OUTSTANDING = 4.0
_MOST = 0.4  # of the lines, at most


def unfrictioned(data: Data, distortion: Array | None) -> tuple[Data, int]:
    """Return the data without the lines at the low end that friction distorts, and their number.

    A motor in friction hardly moves at low frequencies: there the distortion of its FRF is largest
    and falls with frequency. Lines are left out up to the last one of the lower part of the band
    that is distorted by more than 5 % and stands out of the rest.

    Parameters
    ----------
    data : FRFs of one position.
    distortion : (F, M, M) standard deviations of the FRFs by distortion; None keeps all lines.

    Raises
    ------
    InvalidInput : if shapes do not fit.
    """
    if distortion is None:
        return data, 0
    level = np.asarray(distortion, dtype=float)
    if level.shape != data.response.shape:
        raise InvalidInput(
            f"distortion: shape {level.shape} given; {data.response.shape} is needed, as response"
        )
    first = friction_limit(data.omega, relative_distortion(data, level))
    return (data.from_line(first), first) if first else (data, 0)


def relative_distortion(data: Data, level: Array) -> Array:
    """Return each line's distortion, (F,): the worst of the motors' own FRFs, relative."""
    own = np.diagonal(level, axis1=1, axis2=2)
    size = np.abs(np.diagonal(data.response, axis1=1, axis2=2))
    return np.asarray(np.nan_to_num(own / np.maximum(size, 1e-300)).max(axis=1))


def friction_limit(omega: Array, relative: Array) -> int:
    """Return how many lines at the low end friction distorts, given relative distortions (F,).

    A moving median over five lines keeps one wild line from deciding.
    """
    padded = np.pad(relative, 2, mode="edge")
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
    most = int(_MOST * len(omega))
    usual = float(np.median(smooth[most:]))
    bad = smooth[:most] > max(_LARGEST, _OUTSTANDING * usual)
    return int(np.flatnonzero(bad)[-1]) + 1 if bad.any() else 0
