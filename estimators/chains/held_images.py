"""Images of a torque that is held over a sample, in FRFs from sampled angles.

A held torque has images at omega_m = omega + 2 pi m/T, which sampling the angle folds back to
omega. After the correction by the hold's own spectrum an FRF of accelerations is

    sum over all m of (omega/omega_m)^3 G(omega_m),

G itself for m = 0. Far above the resonances G is that of the motors' inertias alone, A_H, and the
images add A_H (h^3 cos h/sin^3 h - 1), about -A_H h^4/15, with h = omega T/2: hundred-thousandths,
which count where noise is as small.
"""

import numpy as np

from estimators.chains.modal_model import modal_response
from estimators.chains.modes import FittedModes
from estimators.chains.whitened_frf import Data
from robotmodels.common.arrays import Array, ComplexArray

_IMAGES = 40
_COUNTS = 0.02  # of a standard deviation, from which on images are taken off


def held_images(found: FittedModes, sample_time: float, delay: float = 0.0) -> ComplexArray:
    """Return what images add to the FRFs (F, M, M) of fitted modes.

    Parameters
    ----------
    sample_time : float, s
        T.
    delay : float, s
        Delay that the FRFs were corrected for, beside that of the modes.
    """
    omega = found.data.omega
    total = np.zeros(found.data.response.shape, dtype=complex)
    for m in [k for i in range(1, _IMAGES + 1) for k in (-i, i)]:
        image = omega + 2 * np.pi * m / sample_time
        G = modal_response(found.x, found.layout, np.abs(image))
        G = np.where(image[:, None, None] < 0, np.conj(G), G)
        share = (omega / image) ** 3 * np.exp(-1j * (image - omega) * delay)
        total += share[:, None, None] * G
    return total


def image_size(data: Data, sample_time: float) -> Array:
    """Return about how large images are, (F, M, M), at most: those of the largest gain of all."""
    half = data.omega * sample_time / 2
    gain = np.median(np.abs(data.response), axis=0).max()
    size = gain * half**3 / 15
    return np.asarray(np.broadcast_to(size[:, None, None], data.response.shape))


def images_count(data: Data, sample_time: float) -> bool:
    """Tell whether images are not negligible beside the noise."""
    return bool((image_size(data, sample_time) > _COUNTS * data.std).any())
