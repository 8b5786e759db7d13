"""Margins of a robot's motors under any linear feedback, loop by loop and of all at once.

With F from motor angles to torques and the plant G, the sensitivity at the torques is
S = (1 + F G)^-1. The loop broken at the torque of motor i, all others closed, is L_i = 1/S_ii - 1
(its return difference is 1/S_ii): gain and phase margins are those of L_i. What all loops allow
together is said by the largest singular value of S, and stability by the poles of the whole
(Skogestad and Postlethwaite 2005, chapters 2 and 9).
"""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from robotmodels.common.arrays import Array, BoolArray, ComplexArray
from robotmodels.linear.linear_model import LinearModel
from robotmodels.linear.response import Elastic
from robotmodels.simulation.linear_feedback import LinearFeedback
from robotmodels.simulation.loop_plant import checked_models, loop_plant, loop_poles

_STABLE = 1e-8
"""Poles are this uncertain where two are alike, as those of a rigid motion [samples or seconds]."""
_REAL, _NONE = 1e-4, 1e-7
"""Relative size of an imaginary part that is none; gain of a loop that is as good as opened."""
_LEAST = 1e-6
"""Size of a loop below which nothing depends on it."""
_LINES, _ROUNDS, _STEP, _MOST = 150, 6, 0.3, 6000
"""Frequencies to begin with; how often and until when they are halved [rad]; and most of them."""


@dataclass(frozen=True, eq=False)
class LoopMargins:
    """Margins in Q positions of n loops; an unstable robot has none: zero, infinite peaks.

    Attributes
    ----------
    stable : ndarray of bool, (Q,)
        Whether no motion grows.
    growth : ndarray, (Q,), 1/s
        Largest real part of a pole, or that of its logarithm over the sample time.
    gain_margin : ndarray, (Q, n)
        Factor by which one loop's gain may rise, others closed; infinite where any may.
    gain_reduction : ndarray, (Q, n)
        Factor to which it may fall; zero where it may be opened.
    phase_margin : ndarray, (Q, n), rad
        Least phase at unit gain, of either sign, that one loop may lose or win.
    peak_sensitivity : ndarray, (Q, n)
        Largest |S_ii|.
    peak_frequency : ndarray, (Q, n), rad/s
        Where it is.
    bandwidth : ndarray, (Q, n), rad/s
        Where |S_ii| first exceeds 1/sqrt(2).
    largest_sensitivity : ndarray, (Q,)
        Largest singular value of S.
    """

    stable: BoolArray
    growth: Array
    gain_margin: Array
    gain_reduction: Array
    phase_margin: Array
    peak_sensitivity: Array
    peak_frequency: Array
    bandwidth: Array
    largest_sensitivity: Array


def loop_margins(
    robot: Elastic, positions: Array, feedback: LinearFeedback, parameters: Array | None = None
) -> LoopMargins:
    """Return the margins about the equilibria at `positions` (Q, n).

    Sampled loops are exact, torques held over a sample and delays split at it; so are continuous
    ones but for the poles under delays.

    Raises
    ------
    InvalidInput
        If the controller has another number of motors, or a position is outside the limits.
    NoEquilibrium
        If a spring is too weak for gravity.
    """
    models = checked_models(robot, positions, feedback, parameters)
    each = [_margins(models.at(i), feedback) for i in range(len(models.mass))]
    return LoopMargins(*(np.array(values) for values in zip(*each, strict=True)))


def no_margins(motors: int) -> LoopMargins:
    """Return those of an unstable robot, or of one that falls, in one position."""
    none, infinite = np.zeros((1, motors)), np.full((1, motors), np.inf)
    unstable = np.array([False]), np.array([np.inf])
    loops = none, np.ones((1, motors)), none, infinite, none, none
    return LoopMargins(*unstable, *loops, np.array([np.inf]))


def stacked(margins: list[LoopMargins], axis: int = 0) -> dict[str, Array]:
    """Return fields of several margins as arrays along a new axis, by name."""
    names = [field.name for field in fields(LoopMargins)]
    return {name: np.stack([getattr(m, name) for m in margins], axis) for name in names}


def _margins(model: LinearModel, feedback: LinearFeedback) -> tuple[object, ...]:
    """Return the fields of `LoopMargins` in one position."""
    time, n = feedback.sample_time, model.inputs
    plant = loop_plant(model, time)
    poles = loop_poles(plant, feedback)
    open_loop = np.linalg.eigvals(plant.A), np.linalg.eigvals(feedback.A)
    size = np.abs(poles).max() - 1 if time is not None else poles.real.max()
    growth = size if time is None else np.log1p(size) / time
    if not size <= _STABLE:
        none = no_margins(n)
        values = [getattr(none, field.name)[0] for field in fields(LoopMargins)]
        return False, growth, *values[2:]
    respond, eye = plant.response(), np.eye(n)

    def sensitivity(omega: Array) -> ComplexArray:
        return np.asarray(np.linalg.inv(eye + feedback.response(omega) @ respond(omega)))

    every = np.concatenate([poles, *open_loop]).astype(complex)
    omega, S = _refined(sensitivity, _frequencies(every, time))
    diagonal = np.diagonal(S, axis1=1, axis2=2)
    loops = [_of_loop(omega, s) for s in diagonal.T]
    largest = _largest_gain(S).max()
    return True, growth, *zip(*loops, strict=True), largest


def _of_loop(omega: Array, sensitivity: ComplexArray) -> tuple[float, ...]:
    """Return the fields of `LoopMargins` of one loop by its own sensitivity, (F,)."""
    L, size = 1 / sensitivity - 1, np.abs(sensitivity)
    # Responses are real at both ends, zero and the Nyquist frequency: crossings too.
    ends = L[[0, -1]][np.abs(L[[0, -1]].imag) < _REAL * np.abs(L[[0, -1]].real)].real
    real = np.concatenate([_at_crossings(L.real, L.imag), ends])
    gains = -1 / real[real < 0]
    gains = gains[(gains > _NONE) & (gains < 1 / _NONE)]
    rising, falling = gains[gains > 1], gains[gains < 1]
    turn = np.angle(-L)
    turn = np.abs(_at_crossings(np.unwrap(turn), np.log(np.abs(L))))
    turn = np.abs((turn + np.pi) % (2 * np.pi) - np.pi)
    peak = int(np.argmax(size))
    band = np.flatnonzero(size > np.sqrt(0.5))
    return (
        float(rising.min(initial=np.inf)),
        float(falling.max(initial=0.0)),
        float(turn.min(initial=np.inf)),
        float(size[peak]),
        float(omega[peak]),
        float(omega[band[0]]) if band.size else np.inf,
    )


def _at_crossings(values: Array, zero: Array) -> Array:
    """Return values (F,), linear in between, where another array passes zero."""
    i = np.flatnonzero(np.signbit(zero[1:]) != np.signbit(zero[:-1]))
    share = zero[i] / (zero[i] - zero[i + 1])
    return np.asarray(values[i] + share * (values[i + 1] - values[i]))


def _frequencies(poles: ComplexArray, time: float | None) -> Array:
    """Return angular frequencies between which no resonance of these poles slips, rising."""
    if time is not None:
        poles = np.asarray(np.log(np.where(np.abs(poles) > 1e-12, poles, 1e-12 + 0j)) / time)
    sizes = np.abs(poles)
    seen = sizes > 1e-3
    low = sizes[seen].min(initial=1.0) / 30
    high = np.pi / time if time is not None else 30 * sizes.max(initial=1.0)
    turning = poles[seen & (poles.imag > 0)]
    width = np.maximum(np.abs(turning.real), 1e-6 * turning.imag)
    near = turning.imag + np.outer([-6, -3, -1.5, -0.7, -0.3, 0, 0.3, 0.7, 1.5, 3, 6], width)
    near = near[(near > low) & (near < high)]
    return np.unique(np.concatenate([[1e-6 * low], np.geomspace(low, high, _LINES), near]))


def _refined(
    sensitivity: Callable[[Array], ComplexArray], omega: Array
) -> tuple[Array, ComplexArray]:
    """Return frequencies and S at them, close enough for lines in between and at what counts."""
    S = sensitivity(omega)
    for k in range(_ROUNDS + 3):
        loops = 1 / np.diagonal(S, axis1=1, axis2=2) - 1
        # Smaller loops are rounding of one.
        both = np.stack([np.where(np.abs(loops) < _LEAST, _LEAST, loops), 1 + loops])
        split = np.abs(np.log(both[:, 1:] / both[:, :-1])).max(axis=(0, 2)) > _STEP
        if k >= _ROUNDS:  # by now only where something is read off
            split = _read_off(S, loops)
        i, parts = np.flatnonzero(split), 2 if k < _ROUNDS else 8
        if not i.size or len(omega) + i.size * (parts - 1) > _MOST:
            continue
        shares = np.arange(1, parts) / parts
        more = (omega[i, None] + shares * (omega[i + 1] - omega[i])[:, None]).ravel()
        order = np.argsort(np.concatenate([omega, more]), kind="stable")
        omega = np.concatenate([omega, more])[order]
        S = np.concatenate([S, sensitivity(more)])[order]
    return omega, S


def _read_off(matrices: ComplexArray, loops: ComplexArray) -> BoolArray:
    """Return the intervals with crossings and beside peaks, (F - 1,), of S (F, n, n) and L_i."""
    size = np.abs(np.diagonal(matrices, axis1=1, axis2=2))
    levels = [np.where(loops.real < 0, loops.imag, 1.0), np.abs(loops) - 1, size - np.sqrt(0.5)]
    split = np.zeros(len(loops) - 1, dtype=bool)
    for level in levels:
        split |= (np.signbit(level[1:]) != np.signbit(level[:-1])).any(axis=1)
    peaks = [*np.argmax(size, axis=0), np.argmax(_largest_gain(matrices))]
    for peak in peaks:
        split[max(peak - 1, 0) : peak + 1] = True
    return split


def _largest_gain(matrices: ComplexArray) -> Array:
    """Return the largest singular values of (F, n, n), (F,)."""
    squares = np.conj(np.swapaxes(matrices, 1, 2)) @ matrices
    return np.asarray(np.sqrt(np.linalg.eigvalsh(squares)[:, -1]))
