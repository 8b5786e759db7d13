"""What the records of a KR 300 say of springs beside those of its gears."""

import numpy as np
import pytest
from test_kr300_deflection import kr300_fit

from estimators.logs.correlated_regression import Series, regress

BLOCK = 25  # samples in a mean, 0.1 s
MILLIDEGREE = np.radians(1e-3)


def test_no_other_gear_bends_what_the_encoders_see() -> None:
    fit = kr300_fit()
    histories = {gear: fit.histories(gear)[0] for gear in fit.gears}
    explained = {}
    for gear in ("g2.stiffness", "g3.stiffness"):
        here = histories[gear]
        parts = here.measured, here.fitted
        centred = [part - part[here.used].mean() for part in parts]
        residual = centred[0] - centred[1]
        for other in fit.gears:
            if other == gear:
                continue
            load = histories[other].fitted  # in proportion to that gear's torque
            shared = np.stack([load - load[here.used].mean(), centred[1]], axis=1)
            ones = np.ones((len(residual), 1))
            whole = regress([Series(residual, shared, ones, here.used, BLOCK)])
            assert whole.p_value([0]) > 0.01
            before = residual[here.used].std()
            explained[gear, other] = np.sqrt(max(before**2 - whole.rms**2, 0.0)) / MILLIDEGREE
        assert before / MILLIDEGREE < 2.7
    assert max(explained.values()) == pytest.approx(1.0, abs=0.15)
    assert max(explained, key=explained.__getitem__) == ("g2.stiffness", "g3.stiffness")
