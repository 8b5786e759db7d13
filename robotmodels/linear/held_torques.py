"""Images of torques that are held over a sample, in outputs that are sampled at instants."""

from collections.abc import Callable

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray, IntArray

# Images on either side. Masses alone answer to those beyond, which fall with k^-4 in pairs: the
# last pair counts for them too.
_IMAGES = 2
_LAST = _IMAGES**4 * (np.pi**4 / 90 - sum(m**-4 for m in range(1, _IMAGES)))


def held_torque_images(
    response: Callable[[Array], ComplexArray],
    omega: Array,
    sample_time: float,
    derivatives: int | IntArray = 2,
    delay: float = 0.0,
) -> ComplexArray:
    """Return what FRFs of held torques have beside the system's own, (..., F, m, n).

    The steps of a torque held over T contain omega_k = omega + 2 pi k / T too, where the hold has
    omega / omega_k times its gain at omega; outputs sampled at instants show their responses at
    omega. Those of an output that is differentiated d times, by (j omega)^d, are
    $sum_(k != 0) G(omega_k) (omega / omega_k)^(d + 1)$: of a free motor -(omega T/2)^4 / 15 of its
    FRF, 0.4 % at a sixth of the sampling frequency (Astrom and Wittenmark, Computer-Controlled
    Systems, 3rd ed. 1997, sec. 7.7).

    Parameters
    ----------
    response : callable
        FRFs (..., F, m, n) of the system at positive angular frequencies (F,) [rad/s].
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    sample_time : float, s
        T.
    derivatives : int or ndarray of int, (m,)
        d.
    delay : float, s
        By which sampled outputs were late before that was corrected.
    """
    k = np.delete(np.arange(-_IMAGES, _IMAGES + 1), _IMAGES)[:, None]
    away = 2 * np.pi / sample_time * k
    at = omega + away
    G = response(np.abs(at).ravel())
    G = G.reshape(*G.shape[:-3], *at.shape, *G.shape[-2:])
    G = np.where(at[..., None, None] < 0, np.conj(G), G)
    powers = (omega / at)[..., None] ** (np.asarray(derivatives) + 1)
    counts = np.where(np.abs(k) == _IMAGES, _LAST, 1.0) * np.exp(-1j * delay * away)
    return np.asarray(((powers * counts[..., None])[..., None] * G).sum(axis=-4))
