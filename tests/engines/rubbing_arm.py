"""Three coupled axes whose motors rub: records of one run, quick to simulate and to fit."""

from functools import cache

import numpy as np
from robots import BALANCED, built, changed

import robotmodels
from robotmodels import ElasticRobot, Imperfections, Records, default_controller

LEVELS = np.array([0.02, 0.03, 0.01])
T, N = 1e-3, 2000
_ODD = np.arange(5, 121, 2)  # 2.5 to 60 Hz
_DETECTION = _ODD[3::4]
_LINES = np.setdiff1d(_ODD, _DETECTION)


def rubbing_arm(width: float = 0.0, *, late: bool = False) -> ElasticRobot:
    """Return the robot; `width` of tanh [rad/s]; `late`: with torque loops and a delay."""
    rubbing = [{"coulomb": level, "coulomb_width": width} for level in LEVELS.tolist()]
    loops = [
        {"torque_delay": 7e-4 * i, "torque_lag": 1.3e-3 * i, "torque_gain": 1 - 0.03 * i}
        for i in range(3)
    ]
    both = zip(BALANCED["motors"], rubbing, loops, strict=True)
    motors = [dict(motor) | level | (loop if late else {}) for motor, level, loop in both]
    free = {"counterbalances": [], "friction": [], "parameters": {}}
    return built(changed(BALANCED, motors=motors, delay=1.3e-3 if late else 0.0, **free))


@cache
def rubbing_records(width: float = 0.0, *, late: bool = False) -> Records:
    """Return three periods of one run in one position, about 6 rad/s at the motors."""
    robot = rubbing_arm(width, late=late)
    spectrum = np.zeros((1, 1, 3, N // 2 + 1), dtype=complex)
    spectrum[..., _LINES] = np.exp(2j * np.pi * np.random.default_rng(1).random((3, len(_LINES))))
    records = robotmodels.simulate(
        robot,
        np.array([[0.2, -1.0, 0.9]]),
        np.swapaxes(np.fft.irfft(N * spectrum, n=N), 2, 3),
        default_controller(robot, T),
        lines=_LINES,
        detection=_DETECTION,
        rng=np.random.default_rng(1),
        imperfections=Imperfections(nonlinear_gears=False, angle_noise=1e-6),
        transient=3,
        periods=3,
    )
    return Records.join(list(records))
