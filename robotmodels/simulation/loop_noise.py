"""The linear closed loop in each position: spectra to expect, and the noise of FRFs under feedback.

With the controller u = F_r r - F_y y, sampled and held, and G_y from motor torques to motor
angles, a reference of spectrum R gives U0 = (I + F_y G_y)^-1 F_r R and Y0 = G_y U0. Noise at the
output makes Y = G_y U + V whatever U is, V with the transient of `window_noise`, so Ĝ - G = V U^-1,
to first order V U0^-1: vec(Ĝ - G) has the covariance (U0 U0ᴴ)^-T ⊗ Λ_v. It is linear in the
excitation's power.
"""

from dataclasses import dataclass, replace

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray, read_only
from robotmodels.common.errors import InvalidInput, NotIdentifiable, SolverFailed
from robotmodels.linear.linear_model import LinearModel
from robotmodels.linear.noise import kronecker
from robotmodels.linear.response import check_omega
from robotmodels.linear.spring_network import SpringNetwork
from robotmodels.simulation.controller import Controller
from robotmodels.simulation.discrete_loop import sampled_loop
from robotmodels.simulation.window_noise import window_noise

# Beyond it a column of U0 is no more than rounding of the others.
_LARGEST_CONDITION = 1e10
# More entries of dynamic stiffness matrices than this are worth loading compiled code for.
_WORTHWHILE = 1_000_000


def hold_response(omega: Array, sample_time: float) -> ComplexArray:
    """Return the spectrum of a torque held over a sample per DFT of its samples, (F,).

    sinc(omega T / 2) exp(-j omega T / 2); the hold's images beyond the Nyquist frequency are left
    out, of which a mechanical system lets through a few hundred-thousandths.
    """
    half = np.asarray(omega, dtype=float) * sample_time / 2
    return np.asarray(np.sinc(half / np.pi) * np.exp(-1j * half))


def angle_response(network: SpringNetwork, omega: Array, sample_time: float) -> ComplexArray:
    """Return G_y, (Q, F, n, n): sampled motor angle [rad] per held motor torque [N m].

    The robot's delay and torque gains are in it, whatever its file says to measure.
    """
    omega = check_omega(omega)
    motors = replace(network, measurement=None)
    if network.mass.size * len(omega) > _WORTHWHILE:
        from robotmodels.kernel import frequency_response

        accelerations = frequency_response(motors, omega)
    else:
        accelerations = motors.frequency_response(omega)
    lag = (hold_response(omega, sample_time) / -np.square(omega))[:, None]
    if network.measurement is not None:
        late = np.exp(-1j * omega * network.measurement.delay)
        lag = lag * late[:, None] * network.measurement.torque.response(omega)
    return np.asarray(lag[:, None, :] * accelerations)


@dataclass(frozen=True, eq=False)
class LoopTransfer:
    """What a speed reference does in Q positions at F frequencies.

    Attributes
    ----------
    torque : ndarray of complex, (Q, F, n, n), N m s/rad
        U0 R^-1, motor torque per speed reference.
    angle : ndarray of complex, (Q, F, n, n), s
        Motor angle per speed reference.
    """

    torque: ComplexArray
    angle: ComplexArray


def closed_loop(network: SpringNetwork, omega: Array, controller: Controller) -> LoopTransfer:
    """Return the closed loop in each position of `network` at `omega` (F,) [rad/s].

    Raises
    ------
    InvalidInput
        If a frequency is not between zero and the Nyquist frequency, or the controller has another
        number of motors.
    """
    omega = check_omega(omega)
    n = network.selector.shape[1]
    if len(controller.speed_gain) != n:
        raise InvalidInput(f"controller: {len(controller.speed_gain)} motors, the robot has {n}")
    nyquist = np.pi / controller.sample_time
    if omega.max() >= nyquist:
        raise InvalidInput(
            f"omega: {omega.max():g} rad/s is not below the controller's Nyquist frequency, "
            f"{nyquist:g} rad/s"
        )
    G = angle_response(network, omega, controller.sample_time)
    feedback, prefilter = controller.feedback(omega), controller.prefilter(omega)
    torque = np.linalg.solve(
        np.eye(n) + feedback[:, :, None] * G,
        np.broadcast_to(prefilter[:, :, None] * np.eye(n), G.shape),
    )
    return LoopTransfer(np.asarray(torque), np.asarray(G @ torque))


@dataclass(frozen=True, eq=False)
class ClosedLoopNoise:
    """The noise law of FRFs measured under feedback: motor torque to motor acceleration.

    Noise is at the angles' measurement. What it makes the arm do through the controller is not
    periodic and leaks into the lines, most below the loop's bandwidth; that is part of the law, see
    `robotmodels.simulation.window_noise`. Unseen torques leak more than they add in place, and
    have no such law.

    Attributes
    ----------
    controller : Controller
        Controller in whose loop the runs are.
    omega : ndarray, (F,), rad/s
        Excited angular frequencies.
    reference : ndarray of complex, (F, n, e) or (Q, F, n, e), rad/s
        DFT of one period of the speed references in the e runs of a block; FRFs need e >= n, fits
        to the runs themselves one.
    samples : int
        N per period.
    angle_noise : ndarray, (n,), rad
        Standard deviation of white noise on the sampled motor angles.
    averages : int
        Number of periods times blocks that the estimate is the mean of.
    periods : int
        How many of them follow one another in an experiment: one begins as the last ended, so their
        leakage nearly cancels.

    Raises
    ------
    InvalidInput
        If shapes do not fit, or a deviation is not positive.
    """

    controller: Controller
    omega: Array
    reference: ComplexArray
    samples: int
    angle_noise: Array
    averages: int = 1
    periods: int = 1

    def __post_init__(self) -> None:
        n = len(self.controller.speed_gain)
        omega = check_omega(self.omega)
        reference = np.asarray(self.reference, dtype=complex)
        if reference.ndim not in (3, 4) or reference.shape[-3:-1] != (len(omega), n):
            raise InvalidInput(
                f"reference: shape {reference.shape} given; ({len(omega)}, {n}, runs), or "
                "that for each position, is needed"
            )
        if not reference.shape[-1]:
            raise InvalidInput("reference: no run in a block; at least one is needed")
        if self.samples < 1 or self.averages < 1:
            raise InvalidInput(f"samples {self.samples} and averages {self.averages} must be >= 1")
        if self.periods < 1 or self.averages % self.periods:
            raise InvalidInput(
                f"averages: {self.averages} is not {self.periods} periods times a number of blocks"
            )
        noise = np.asarray(self.angle_noise, dtype=float)
        if noise.shape not in ((), (n,)) or not (np.isfinite(noise) & (noise > 0)).all():
            raise InvalidInput(
                f"angle_noise: {noise.tolist()} must be {n} positive numbers, one per motor"
            )
        object.__setattr__(self, "angle_noise", read_only(np.array(np.broadcast_to(noise, (n,)))))
        object.__setattr__(self, "omega", read_only(omega))
        object.__setattr__(self, "reference", read_only(reference))

    def factors(self, network: SpringNetwork, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        """Return power (U0 U0ᴴ)ᵀ and Λ_v, (Q, F, n, n): the inverse covariance is power ⊗ Λ_v^-1.

        U0 is the spectrum of the torque in continuous time, Λ_v that of the motor accelerations.

        Raises
        ------
        InvalidInput
            If `omega` is not that of the law, or something else than motor accelerations is
            measured.
        SolverFailed
            If the closed loop is unstable in a position.
        """
        if not (np.shape(omega) == self.omega.shape and np.allclose(omega, self.omega, rtol=1e-9)):
            raise InvalidInput("noise: omega differs from the frequencies of the excitation")
        w, T, n = self.omega, self.controller.sample_time, network.selector.shape[1]
        model = network.linear_model()
        motors = -(w[:, None, None] ** 2) * model.selector.T
        lag = np.exp(-1j * w * model.measured.delay)[:, None, None]
        outputs = model.measured.outputs(w)
        if outputs.shape[-2] != n or not np.allclose(outputs, lag * motors):
            raise InvalidInput("noise: the law is for motor accelerations and no other outputs")
        R = self.reference
        if R.ndim == 4 and len(R) != len(network.mass):
            raise InvalidInput(
                f"noise: references for {len(R)} positions, {len(network.mass)} are asked for"
            )
        torque = hold_response(w, T)[:, None, None] * (
            closed_loop(network, w, self.controller).torque @ R
        )
        power = np.swapaxes(torque @ np.conj(np.swapaxes(torque, -1, -2)), -1, -2)
        output = w[:, None, None] ** 4 * self._angle_covariance(model)
        return power, np.asarray(np.broadcast_to(output, power.shape))

    def _angle_covariance(self, model: LinearModel) -> ComplexArray:
        """Return the covariance (Q, F, n, n) of the angles' errors, as DFTs of one period."""
        z = np.exp(1j * self.omega * self.controller.sample_time)
        window, blocks = self.periods * self.samples, self.averages // self.periods
        covariances = []
        for q in range(len(model.mass)):
            loop = sampled_loop(model.at(q), self.controller)
            try:
                covariances.append(window_noise(loop, z, window, self.angle_noise))
            except SolverFailed as error:
                raise SolverFailed(f"position {q}: {error}") from None
        return np.asarray(covariances) / (blocks * self.periods**2)

    def covariance(self, network: SpringNetwork, omega: Array) -> ComplexArray:
        """Return the covariances of vec(Ĝ), (Q, F, n n, n n), columns stacked.

        Raises
        ------
        NotIdentifiable
            If the runs do not excite all motors, naming frequency and condition.
        InvalidInput, SolverFailed
            As `factors`.
        """
        power, output = self.factors(network, omega)
        _check_power(power, self.omega)
        return kronecker(np.asarray(np.linalg.inv(power)), output)

    def weights(self, network: SpringNetwork, omega: Array) -> ComplexArray:
        """Return the inverses of `covariance`, exactly: power ⊗ Λ_v^-1, singular for e < n.

        Raises
        ------
        InvalidInput, SolverFailed
            As `factors`.
        """
        power, output = self.factors(network, omega)
        return kronecker(power, np.asarray(np.linalg.inv(output)))


def _check_power(power: ComplexArray, omega: Array) -> None:
    condition = np.linalg.cond(power)
    if not (condition < _LARGEST_CONDITION).all():
        q, f = np.argwhere(~(condition < _LARGEST_CONDITION))[0]
        raise NotIdentifiable(
            (f"the FRF at {omega[f] / (2 * np.pi):.4g} Hz in position {q}",),
            f"the runs do not excite all motors there (condition {condition[q, f]:.2g}); "
            "give each motor its own signal",
        )
