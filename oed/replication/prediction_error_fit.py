"""A prediction-error method with a noise model, in innovation form, on records in time.

[WM] section 2 and 7 leave it for later: a predictor that is stable though the robot is not. The
robot is linear about its position, torques are held over a sample `T`:

    x(k+1) = A(theta) x(k) + B(theta) (u(k) + w(k)),     y(k) = C x(k) + v(k)

with torques w that nobody measures, of standard deviation rho times that of each motor's torque,
and an encoder's noise v. Its innovation form (Ljung 1999, section 4.3) predicts y from the past,

    x^(k+1) = A x^(k) + B u(k) + K e(k),     e(k) = y(k) - C x^(k),     Cov e = S,

with the gain K of the steady Kalman filter. The likelihood, the size of the noise concentrated out,
is least where the sum of squares of (det S)^(1/2m) S^(-1/2) e is, over theta and rho together.
"""

import time
from dataclasses import dataclass

import numpy as np

from oed.replication.rollout_fit import RolloutCase, RolloutFit
from robotmodels import ElasticRobot, linearize
from robotmodels.common.arrays import Array

FIRST_RATIO = 0.01
"""Start of rho."""
LEAST_RATIO, LARGEST_RATIO = 1e-6, 10.0
"""Bounds of rho."""


@dataclass(frozen=True, eq=False)
class Innovations:
    """A predictor in innovation form.

    Attributes
    ----------
    transition : ndarray, (s, s)
        A, of the states: coordinates and their speeds.
    input : ndarray, (s, n)
        B, by motor torques [1/(N m)].
    output : ndarray, (m, s)
        C, motor angles over the standard deviation of the encoders' noise.
    gain : ndarray, (s, m)
        K.
    covariance : ndarray, (m, m)
        S, over the variance of the encoders' noise.
    """

    transition: Array
    input: Array
    output: Array
    gain: Array
    covariance: Array

    def errors(self, torque: Array, angle: Array) -> Array:
        """Return the prediction errors e, (E, K, m), of E runs that begin at rest.

        Parameters
        ----------
        torque : ndarray, (E, K, n)
            Motor torques [N m].
        angle : ndarray, (E, K, m)
            Motor angles from rest, over the standard deviation of the encoders' noise.
        """
        # x^(k+1) = (A - K C) x^(k) + (B u(k) + K y(k)): what drives it, all samples at once.
        closed = (self.transition - self.gain @ self.output).T
        drive = torque @ self.input.T + angle @ self.gain.T
        state, predicted = np.zeros((len(torque), len(closed))), np.empty_like(angle)
        for k in range(angle.shape[1]):
            predicted[:, k] = state @ self.output.T
            state = state @ closed + drive[:, k]
        return angle - predicted


def innovations(
    robot: ElasticRobot, position: Array, values: Array, noise: Array, case: RolloutCase
) -> Innovations:
    """Return the predictor at parameter `values` (p,).

    Parameters
    ----------
    position : ndarray, (n,), rad
        Position of the records.
    noise : ndarray, (n,), N m
        Standard deviation of the unmeasured torques, for a unit one of the encoders.

    Raises
    ------
    numpy.linalg.LinAlgError
        If there is no steady filter.
    """
    from scipy.linalg import expm, solve_discrete_are

    model = linearize(robot, position, values)
    d, n = model.selector.shape
    inverse = np.linalg.inv(model.mass)
    A = np.block(
        [[np.zeros((d, d)), np.eye(d)], [-inverse @ model.stiffness, -inverse @ model.damping]]
    )
    B = np.vstack([np.zeros((d, n)), inverse @ model.selector])
    step = expm(case.sample_time * np.block([[A, B], [np.zeros((n, 2 * d + n))]]))
    A, B = step[: 2 * d, : 2 * d], step[: 2 * d, 2 * d :]
    C = np.hstack([model.selector.T, np.zeros((n, d))]) / case.angle_noise
    P = solve_discrete_are(A.T, C.T, (B * noise**2) @ B.T, np.eye(n))
    S = C @ P @ C.T + np.eye(n)
    gain = np.linalg.solve(S, C @ P @ A.T).T
    return Innovations(A, B, C, gain, S)


def whitened_errors(predictor: Innovations, torque: Array, angle: Array) -> Array:
    """Return (det S)^(1/2m) S^(-1/2) e of all runs, as one vector."""
    root = np.linalg.cholesky(predictor.covariance)
    errors = predictor.errors(torque, angle)
    scale = np.exp(np.log(np.diagonal(root)).mean())
    return np.asarray(scale * np.linalg.solve(root, errors.reshape(-1, len(root)).T).ravel())


def fit_prediction_errors(
    robot: ElasticRobot, position: Array, case: RolloutCase, start: Array, reach: float, limit: int
) -> RolloutFit:
    """Return the fit of theta and the noise model from one start of theta.

    Parameters
    ----------
    start : ndarray, (p,)
        Start of theta [SI].
    reach : float
        Decades about the case's parameters between which values are sought.
    limit : int
        Predictions of all runs, after which the best so far is taken.
    """
    from scipy.optimize import least_squares

    reference, bound = case.parameters.values, reach * np.log(10)
    angle = (case.angle - case.angle[:, :1].mean(axis=0)) / case.angle_noise
    size = case.torque.std(axis=(0, 1))
    count, begun = 0, time.perf_counter()

    def residuals(x: Array) -> Array:
        nonlocal count
        count += 1
        noise = np.exp(x[-1]) * size
        try:
            predictor = innovations(robot, position, reference * np.exp(x[:-1]), noise, case)
        except np.linalg.LinAlgError:
            return np.full(angle.size, np.inf)  # makes the trust region shrink
        return whitened_errors(predictor, case.torque, angle)

    low = np.append(np.full(len(start), -bound), np.log(LEAST_RATIO))
    high = np.append(np.full(len(start), bound), np.log(LARGEST_RATIO))
    try:
        solution = least_squares(
            residuals,
            np.append(np.log(start / reference), np.log(FIRST_RATIO)),
            bounds=(low, high),
            x_scale="jac",
            max_nfev=max(limit // (len(low) + 1), 1),  # a Jacobian by differences for each
        )
    except ValueError:  # no filter at the start, or beside a point
        return RolloutFit(start, False, count, time.perf_counter() - begun)
    values = np.asarray(reference * np.exp(solution.x[:-1]))
    return RolloutFit(values, solution.status > 0, count, time.perf_counter() - begun)
