"""Which FRF estimator serves a user's own experiments best: a comparison by simulation.

The answer depends on how noise travels through the loop, so the loop is what is simulated: to
every block's torques U0 and outputs G U0 noise V is added as U = U0 - C V, Y = G U + V, with
C = (I + F G)^-1 F, the torque that the controller makes of a disturbed output.
"""

from dataclasses import dataclass

import numpy as np

from estimators.frf.averaging import METHODS, SUMMING, find_method, jio
from estimators.frf.estimate_frf import Transient, usable_spectra
from robotmodels.common.arrays import Array, ComplexArray, IntArray, read_only
from robotmodels.common.errors import InvalidInput
from robotmodels.records.records import Records


@dataclass(frozen=True, eq=False)
class Loop:
    """A closed loop at F frequencies, with the blocks of runs that are planned for it.

    Attributes
    ----------
    response : ndarray of complex, (F, m, n)
        G, torque to acceleration.
    closed : ndarray of complex, (F, n, m)
        C, output noise to (minus) torque; zero in open loop.
    reference : ndarray of complex, (B, F, n, E)
        Reference.
    torque : ndarray of complex, (B, F, n, E)
        U0, without noise.
    noise : ndarray of complex, (F, m, m)
        Covariance of V, of one run with its periods averaged.
    """

    response: ComplexArray
    closed: ComplexArray
    reference: ComplexArray
    torque: ComplexArray
    noise: ComplexArray

    def __post_init__(self) -> None:
        for name in ("response", "closed", "reference", "torque", "noise"):
            array = np.asarray(getattr(self, name), dtype=complex)
            object.__setattr__(self, name, read_only(array))
        F, m, n = self.response.shape
        shapes = {
            "closed": (F, n, m),
            "noise": (F, m, m),
            "reference": (len(self.torque), F, n, self.torque.shape[-1]),
            "torque": (len(self.torque), F, n, self.torque.shape[-1]),
        }
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise InvalidInput(
                    f"{name}: shape {getattr(self, name).shape} does not fit FRFs of shape "
                    f"{self.response.shape}; {shape} is needed"
                )

    def simulate(
        self, runs: int, rng: np.random.Generator
    ) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Return output, input and reference of many runs, (runs, F, B, ., E)."""
        U0, R = (np.moveaxis(a, 0, 1) for a in (self.torque, self.reference))
        shape = (runs, *U0.shape[:2], self.response.shape[1], U0.shape[-1])
        white = rng.standard_normal((2, *shape)) / np.sqrt(2)
        values, vectors = np.linalg.eigh(self.noise)
        root = vectors * np.sqrt(np.clip(values, 0.0, None))[:, None, :]
        V = root[:, None] @ (white[0] + 1j * white[1])
        U = U0 - self.closed[:, None] @ V
        return self.response[:, None] @ U + V, U, np.broadcast_to(R, (runs, *R.shape))


def designed_loop(
    response: ComplexArray,
    feedback: ComplexArray,
    prefilter: ComplexArray,
    reference: ComplexArray,
    noise: ComplexArray,
) -> Loop:
    """Return the loop u = F_r r - F_y y that a model and a plan predict.

    Parameters
    ----------
    response : ndarray of complex, (F, m, n)
        Response of the model.
    feedback : ndarray of complex, (F, n, m)
        F_y, torque per (minus) acceleration. A controller's torque per angle becomes that when
        divided by -omega^2 and, if held, multiplied by the hold's factor.
    prefilter : ndarray of complex, (F, n, n)
        F_r, torque per reference.
    reference : ndarray of complex, (B, F, n, E)
        Reference of the plan.
    noise : ndarray of complex, (F, m, m)
        Covariance of the output noise, periods averaged.
    """
    opened = np.eye(response.shape[-1]) + feedback @ response
    return Loop(
        response=response,
        closed=np.asarray(np.linalg.solve(opened, feedback)),
        reference=reference,
        torque=np.asarray(np.linalg.solve(opened, prefilter @ reference)),
        noise=noise,
    )


def measured_loop(
    records: Records,
    index: int = 0,
    *,
    hold: bool = True,
    delay: float = 0.0,
    transient: Transient = "auto",
    lines: IntArray | None = None,
) -> Loop:
    """Return the loop as records of one position show it; no controller is needed.

    G is JIO's estimate. What of Y - G U and of U the reference does not explain are noise and
    distortion; regressing the torque's on the output's gives C.

    Raises
    ------
    InvalidInput
        If there are too few runs to tell noise from signal, or as `estimators.estimate_frf` does.
    """
    measured = usable_spectra(
        records.at(index),
        f"position {index + 1}",
        "jio",
        hold=hold,
        delay=delay,
        transient=transient,
        lines=lines,
    )
    Y, U, R = (np.moveaxis(a, 0, 1) for a in measured.averaged())  # (F, B, ., E)
    _, B, n, E = R.shape
    freedom = B * E - n
    if freedom < Y.shape[2]:
        raise InvalidInput(
            f"position {index + 1}: {B} blocks of {E} runs for {n} motors leave {freedom} "
            f"degrees of freedom for the noise; {Y.shape[2]} are needed, measure another block"
        )
    G = jio(Y, U, R)
    closed_loop = jio(U, R, R)
    signal = closed_loop[:, None] @ R
    V, away = (_rows(a) for a in (Y - G[:, None] @ U, U - signal))
    power = V @ np.conj(np.swapaxes(V, -1, -2))
    cross = away @ np.conj(np.swapaxes(V, -1, -2))
    closed = -np.swapaxes(
        np.linalg.solve(np.swapaxes(power, -1, -2), np.swapaxes(cross, -1, -2)), -1, -2
    )
    return Loop(G, closed, np.moveaxis(R, 1, 0), np.moveaxis(signal, 1, 0), power / freedom)


@dataclass(frozen=True, eq=False)
class MethodComparison:
    """Errors of FRF estimators over many simulated runs of one loop.

    Attributes
    ----------
    methods : tuple of str
        Names.
    bias : ndarray, (methods, F)
        Norm of the element-wise median of the estimates less G.
    error : ndarray, (methods, F)
        Median over the runs of the norm of the estimate less G. Medians, for at low signal-to-noise
        ratios the mean of a ratio does not exist.
    response : ndarray, (F,)
        Norm of G.
    """

    methods: tuple[str, ...]
    bias: Array
    error: Array
    response: Array

    @property
    def best(self) -> str:
        """The method of the smallest relative error, rms over frequencies."""
        return self.methods[int(np.argmin(self.scores))]

    @property
    def scores(self) -> Array:
        """Relative errors (methods,), rms over frequencies [-]."""
        return np.asarray(np.sqrt(np.mean((self.error / self.response) ** 2, axis=1)))


def compare_methods(
    loop: Loop,
    runs: int = 400,
    *,
    rng: np.random.Generator,
    methods: tuple[str, ...] | None = None,
) -> MethodComparison:
    """Estimate FRFs of simulated runs of `loop` by every method, and judge them by the true one.

    Parameters
    ----------
    runs : int
        Number of simulated campaigns at each frequency.
    methods : tuple of str, optional
        Those to compare; by default all that the runs permit.
    """
    F, m, n = loop.response.shape
    square = loop.torque.shape[-1] == n
    if methods is None:
        methods = tuple(METHODS) if square and m == n else ("ari", "log", *SUMMING)
        methods = methods if square else SUMMING
    bias, error = np.empty((2, len(methods), F))
    for f in range(F):
        line = slice(f, f + 1)
        one = Loop(
            loop.response[line],
            loop.closed[line],
            loop.reference[:, line],
            loop.torque[:, line],
            loop.noise[line],
        )
        signals = one.simulate(runs, rng)
        for i, name in enumerate(methods):
            estimates = find_method(name)(*signals)[:, 0]
            middle = np.median(estimates.real, axis=0) + 1j * np.median(estimates.imag, axis=0)
            bias[i, f] = np.linalg.norm(middle - loop.response[f])
            distance = np.linalg.norm(estimates - loop.response[f], axis=(-2, -1))
            error[i, f] = np.median(distance)
    size = np.linalg.norm(loop.response, axis=(-2, -1))
    return MethodComparison(tuple(methods), bias, error, size)


def _rows(matrices: ComplexArray) -> ComplexArray:
    """Put the blocks' (F, B, c, E) matrices side by side, (F, c, B E)."""
    return np.asarray(np.moveaxis(matrices, 1, 2).reshape(*matrices.shape[::2], -1))
