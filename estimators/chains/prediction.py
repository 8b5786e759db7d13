"""How every mass of identified chains answers to the motors, measured or not."""

import numpy as np

from estimators.chains.identification import ChainIdentification
from robotmodels.arrays import Array, ComplexArray
from robotmodels.modes import resonances
from robotmodels.response import check_omega


def predict_masses(found: ChainIdentification, omega: Array) -> ComplexArray:
    """Return accelerations of all masses per motor torque, (F, M N, M), in the chains' order.

    Shapes are those of the identified chains without damping; damping ratios, motor friction and
    delay those of the fitted modes.

    Parameters
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies.

    Raises
    ------
    InvalidInput
        If a frequency is not positive.
    """
    s = 1j * check_omega(omega)
    model, modes = found.chains.linear_model(), found.modes
    undamped = resonances(model)
    w, zeta = undamped.frequencies, modes.damping
    h = s[:, None] ** 2 / (s[:, None] ** 2 + 2 * zeta * w * s[:, None] + w**2)
    motors = model.selector.T @ undamped.shapes
    elastic = np.einsum("fr,dr,mr->fdm", h, undamped.shapes, motors)
    together = np.kron(np.eye(len(found.masses)), np.ones((found.n_masses, 1)))
    inertia = together.T @ model.mass @ together
    rigid = np.linalg.inv(inertia + np.diag(modes.friction) / s[:, None, None])
    late = np.exp(-s * modes.delay)
    return np.asarray(late[:, None, None] * (together @ rigid + elastic))
