"""Low frequencies that friction distorts, found and left out."""

import numpy as np

from estimators.chains.modal_data import Data
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
    and falls with frequency. Lines are left out from the lowest on while they are distorted by
    more than 5 % and stand out of the rest. On those that stay, friction shifts the FRF by about
    as much as it makes one block differ from the next, most near anti-resonances, where the motor
    stands still: that is added to their errors.

    Parameters
    ----------
    data : Data
        FRFs of one position.
    distortion : ndarray or None, (F, M, M)
        Standard deviations of one block's FRF by distortion; None keeps all lines.

    Raises
    ------
    InvalidInput
        If shapes do not fit.
    """
    if distortion is None:
        return data, 0
    level = np.asarray(distortion, dtype=float)
    if level.shape != data.response.shape:
        raise InvalidInput(
            f"distortion: shape {level.shape} given; {data.response.shape} is needed, as response"
        )
    first = friction_limit(data.omega, relative_distortion(data, level))
    kept = data.from_line(first) if first else data
    return kept.with_error(_smooth(level[first:] ** 2)), first


def _smooth(variance: Array) -> Array:
    """Return variances averaged over five lines: those from a few blocks scatter widely."""
    padded = np.pad(np.nan_to_num(variance), [(2, 2), (0, 0), (0, 0)], mode="edge")
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, 5, axis=0).mean(axis=-1))


def relative_distortion(data: Data, level: Array) -> Array:
    """Return each line's distortion, (F,): the worst of the motors' own FRFs, relative."""
    own = np.diagonal(level, axis1=1, axis2=2)
    size = np.abs(np.diagonal(data.response, axis1=1, axis2=2))
    return np.asarray(np.nan_to_num(own / np.maximum(size, 1e-300)).max(axis=1))


def friction_limit(omega: Array, relative: Array) -> int:
    """Return how many lines at the low end friction distorts, given relative distortions (F,).

    Only those from the lowest on without a break: anti-resonances further up, where the motor
    stands still, are distorted too, but tell of the springs. A moving median over five lines
    keeps one wild line from deciding.
    """
    padded = np.pad(relative, 2, mode="edge")
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
    most = int(_MOST * len(omega))
    usual = float(np.median(smooth[most:]))
    bad = smooth[:most] > max(_LARGEST, _OUTSTANDING * usual)
    return most if bad.all() else int(np.argmin(bad))
