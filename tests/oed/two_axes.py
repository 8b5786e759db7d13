"""Two coupled elastic axes under feedback, small enough to simulate sample by sample."""

from types import SimpleNamespace

import numpy as np
from scipy.linalg import expm

from oed import band_multisine, experiment_plan
from robotmodels import Parameters, SpringNetwork
from robotmodels.simulation.controller import Controller

T, N = 1e-3, 500
RATIOS = np.array([50.0, -80.0])
ROBOT = SimpleNamespace(
    name="two_axes",
    motor_names=("m1", "m2"),
    position_limits=np.array([[-1.5, 1.5], [-2.0, 2.0]]),
)
CONTROLLER = Controller([0.06, 0.03], [0.2, 0.3], [4.0, 6.0], T)


class TwoAxes:
    """Drive springs between two coupled arm coordinates and their motors."""

    parameters = Parameters(("k1", "k2"), np.array([2000.0, 1200.0]), ("N m/rad",) * 2)

    def network(self, positions, parameters=None):
        mass = np.zeros((len(positions), 4, 4))
        for K, (_, elbow) in zip(mass, positions, strict=True):
            K[:2, :2] = [[3 + np.cos(elbow), 0.4 + 0.5 * np.cos(elbow)], [0, 0.8]]
            K[1, 0] = K[0, 1]
            K[2:, 2:] = np.diag([1e-3, 4e-4] * RATIOS**2)
        return SpringNetwork(
            mass=mass,
            damping=np.diag([0, 0, 5e-3, 2e-3]) @ np.diag([0, 0, *RATIOS**2]),
            stiffness=np.zeros_like(mass),
            selector=np.vstack([np.zeros((2, 2)), np.diag(RATIOS)]),
            nodes=np.array([[0, 2], [1, 3]]),
            spring_stiffness=np.tile(self.parameters.values, (len(mass), 1)),
            spring_damping=np.tile([10.0, 6.0], (len(mass), 1)),
            exponents=np.tile(np.vstack([np.eye(2), np.zeros((2, 2))]), (len(mass), 1, 1)),
            parameters=self.parameters,
        )


def plan(seed=1, **keywords):
    rng = np.random.default_rng(seed)
    sine = band_multisine(
        N, T, (2 * np.pi * 2, 2 * np.pi * 60), inputs=2, detection_group=4, rng=rng
    )
    usual = {
        "positions": np.array([[0.3, 0.1], [-1.0, 1.6]]),
        "multisine": sine,
        "repetitions": (1, 2),
        "blocks": 2,
        "periods": 2,
        "speed": 1.0,
        "acceleration": (3.0, 4.0),
        "rng": rng,
    }
    return experiment_plan(ROBOT, **{**usual, **keywords})


def run(position, references, fine=4, periods=6):
    """Return torque (K, R, 2) at samples and speed, angle (K fine, R, 2) from rest on.

    References are (R, N, 2), a period of N samples for each run.

    The held torque makes each sample exact: e^{A T} of the first-order system.
    """
    model = TwoAxes().network(np.atleast_2d(position)).linear_model()
    M, D, K, S = model.mass[0], model.damping[0], model.stiffness[0], model.selector
    d, n = S.shape
    A = np.zeros((2 * d + n, 2 * d + n))
    A[:d, d : 2 * d] = np.eye(d)
    A[d : 2 * d] = np.linalg.solve(M, np.hstack([-K, -D, S]))
    step = expm(A * T / fine)
    c = CONTROLLER
    step = step[: 2 * d].T
    state, integral, last = (np.zeros((len(references), k)) for k in (2 * d, n, n))
    torques, speeds, angles = [], [], []
    samples = references.shape[1]
    for k in range(periods * samples):
        y = state[:, :d] @ S
        e = references[:, k % samples] - c.position_gain * y - (y - last) / T
        last = y
        integral = integral + T * e / c.integral_time
        u = c.speed_gain * (e + integral)
        torques.append(u)
        for _ in range(fine):
            speeds.append(state[:, d:] @ S)
            angles.append(state[:, :d] @ S)
            state = np.concatenate([state, u], axis=1) @ step
    return np.array(torques), np.array(speeds), np.array(angles)
