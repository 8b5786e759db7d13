"""The marginal likelihood of noise of unknown size against an integral."""

import numpy as np
import pytest
from scipy.integrate import quad

from estimators.sampling.likelihood import Noise


def test_the_scale_is_integrated_out():
    n = 12
    found = Noise("unknown").of_cost(np.array([2.0, 5.0]), n)

    def integral(cost):
        return quad(lambda s: s**-n * np.exp(-cost / s**2) / s, 0, np.inf)[0]

    assert found[1] - found[0] == pytest.approx(np.log(integral(5.0) / integral(2.0)), rel=1e-8)
