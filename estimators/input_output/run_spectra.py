"""Spectra of runs in each position, with the covariance of inputs and outputs together."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimators.frf.block_checks import check_excited
from estimators.frf.estimate_frf import Transient, each_position, first_period
from estimators.frf.record_checks import check_periods
from estimators.frf.spectra import Spectra, spectra
from estimators.input_output.coulomb import CoulombSpectra
from estimators.input_output.friction_shares import friction_shares, torque_channels
from estimators.input_output.run_noise import FEWEST, NOISES, NoiseOf, declared, possible_noise
from estimators.input_output.silent_lines import SilentLines
from robotmodels.common.arrays import (
    Array,
    ComplexArray,
    IntArray,
    check_kind,
    chosen_positions,
    complex_numbers,
    one_or_each,
    read_only,
    real_numbers,
    whole_numbers,
)
from robotmodels.common.errors import IdentificationWarning, InvalidInput, check_word
from robotmodels.common.printing import ReprHtml
from robotmodels.linear.held_torques import held_torque_images
from robotmodels.linear.linear_model import Channels
from robotmodels.linear.response import Elastic, frequency_response
from robotmodels.records.records import Records


@dataclass(frozen=True, eq=False)
class RunSpectra(ReprHtml):
    """Spectra of E runs in each of Q positions at F excited lines.

    Attributes
    ----------
    positions : ndarray, (Q, n), rad
        Positions.
    omega : ndarray, (F,), rad/s
        Angular frequencies, positive and rising.
    inputs : ndarray of complex, (Q, E, F, n), N m
        Motor torques.
    outputs : ndarray of complex, (Q, E, F, m), rad/s^2
        Motor accelerations.
    covariance : ndarray of complex, (Q, F, m + n, m + n)
        Covariance of the circular complex errors of outputs and inputs, outputs first, of each
        run; it may be singular.
    degrees_of_freedom : ndarray, (Q,)
        Complex degrees of freedom of the covariance; infinite where it is declared. A scalar
        stands for all positions.
    shared_draws : ndarray, (Q,)
        Complex draws that covariances of all lines of a position share; infinite if none.
    noise : str
        Where the covariance comes from, for people.
    sample_time : float, s, optional
        Of runs that do not end as they began: the states' differences are estimated along, from
        outputs sampled that often. None for periodic runs.
    delay : float, s
        By which sampled outputs were late before that was corrected.
    derivatives : ndarray of int, (m,)
        How often sampled outputs were differentiated.
    polynomials : bool
        Whether what runs add that do not end as they began is taken for polynomials of the
        frequency, in blocks of lines, instead of the model's states.
    commanded : bool
        Whether inputs are commands, to which the model's torque loop belongs, or measured torques.
    hold_time : float, s
        Sampling time over which inputs were held, whose images the outputs contain, see
        `held_torque_images`; 0 where there are none.
    coulomb : CoulombSpectra or None
        Friction of the motors, whose levels are estimated along; the first outputs are their
        angles. Inputs are torques less the friction of its levels.
    silent : tuple of SilentLines or None
        Of each position, where lines that were not excited tell the noise; empty if nowhere.
    """

    positions: Array
    omega: Array
    inputs: ComplexArray
    outputs: ComplexArray
    covariance: ComplexArray
    degrees_of_freedom: Array = np.inf  # type: ignore[assignment]  # an array after __post_init__
    shared_draws: Array = np.inf  # type: ignore[assignment]  # an array after __post_init__
    noise: str = "declared"
    sample_time: float | None = None
    delay: float = 0.0
    derivatives: IntArray = 2  # type: ignore[assignment]  # an array after __post_init__
    polynomials: bool = False
    commanded: bool = True
    hold_time: float = 0.0
    coulomb: CoulombSpectra | None = None
    silent: tuple[SilentLines | None, ...] = ()

    def __post_init__(self) -> None:
        inputs = complex_numbers(self.inputs, "inputs")
        outputs = complex_numbers(self.outputs, "outputs")
        if inputs.ndim != 4 or outputs.ndim != 4 or inputs.shape[:3] != outputs.shape[:3]:
            raise InvalidInput(
                f"inputs, outputs: shapes {inputs.shape} and {outputs.shape}; (Q, E, F, n) and "
                "(Q, E, F, m) are needed"
            )
        (q, _, f, n), m = inputs.shape, outputs.shape[3]
        arrays: dict[str, NDArray[Any]] = {
            "positions": real_numbers(self.positions, "positions"),
            "omega": real_numbers(self.omega, "omega"),
            "inputs": inputs,
            "outputs": outputs,
            "covariance": complex_numbers(self.covariance, "covariance"),
        }
        columns = arrays["positions"].shape[1:2]
        shapes = {"positions": (q, *columns), "omega": (f,), "covariance": (q, f, m + n, m + n)}
        _check_arrays(arrays, shapes)
        _check_covariance(arrays["covariance"], arrays["omega"])
        freedom = _freedom(self.degrees_of_freedom, q)
        derivatives = np.broadcast_to(whole_numbers(self.derivatives, "derivatives"), (m,)).copy()
        if self.coulomb is not None and self.has_states:
            raise InvalidInput(
                "friction: that of runs that do not end as they began is not estimated; "
                "take states='no' and periodic runs"
            )
        shared = _freedom(self.shared_draws, q, "shared_draws")
        arrays |= {"degrees_of_freedom": freedom, "shared_draws": shared}
        arrays |= {"derivatives": derivatives}
        for name, value in arrays.items():
            object.__setattr__(self, name, read_only(value))

    @property
    def has_states(self) -> bool:
        """Whether runs do not end as they began."""
        return self.polynomials or self.sample_time is not None

    @property
    def estimates_along(self) -> bool:
        """Whether states or levels of friction are eliminated from the errors of fits."""
        return self.has_states or self.coulomb is not None

    def subset(self, positions: IntArray) -> "RunSpectra":
        """Return the spectra of some positions."""
        rows = chosen_positions(positions, len(self.positions))
        coulomb = None if self.coulomb is None else self.coulomb.subset(rows)
        silent = tuple(self.silent[int(q)] for q in np.asarray(rows) if self.silent)
        arrays: dict[str, Any] = {name: getattr(self, name)[rows] for name in _EACH}
        return replace(self, coulomb=coulomb, silent=silent, **arrays)

    def without_images(self, model: Elastic) -> "RunSpectra":
        """Return the spectra without images of held inputs, by the model's nominal values."""
        if not self.hold_time:
            return self
        response = partial(frequency_response, model, self.positions)
        sampling = self.hold_time, self.derivatives, self.delay
        images = held_torque_images(response, self.omega, *sampling)
        outputs = self.outputs - np.einsum("qfmn,qefn->qefm", images, self.inputs)
        return replace(self, outputs=outputs, hold_time=0.0)

    def at_coulomb(self, levels: Array) -> "RunSpectra":
        """Return the spectra with the friction of other levels (Q, n) [N m] taken off."""
        assert self.coulomb is not None
        change, covariance, coulomb = self.coulomb.at(levels)
        return replace(self, inputs=self.inputs + change, covariance=covariance, coulomb=coulomb)

    def single_runs(self) -> "RunSpectra":
        """Return the same runs, each as the only one of a position of its own.

        Costs, estimates and covariances are the same, but for levels of friction of each run.
        """
        runs = self.inputs.shape[1]
        rows: dict[str, Any] = {
            name: np.repeat(getattr(self, name), runs, axis=0) for name in _EACH
        }
        for name in ("inputs", "outputs"):
            array = getattr(self, name)
            rows[name] = array.reshape(-1, 1, *array.shape[2:])
        coulomb = None if self.coulomb is None else self.coulomb.single_runs()
        silent = tuple(one for one in self.silent for _ in range(runs))
        return replace(self, coulomb=coulomb, silent=silent, **rows)

    @staticmethod
    def join(parts: Sequence["RunSpectra"]) -> "RunSpectra":
        """Return the spectra of all positions of `parts`, which may differ in their noise.

        Where they differ in the number of runs, each run stands for itself, see `single_runs`.

        Raises
        ------
        InvalidInput
            If there is no part, or parts differ in lines, inputs, outputs or states.
        """
        if not parts:
            raise InvalidInput("run spectra: nothing to join; at least one position is needed")
        if len({part.inputs.shape[1] for part in parts}) > 1:
            parts = [part.single_runs() for part in parts]
        first = parts[0]
        for i, part in enumerate(parts):
            for name, one, other in zip(_ALIKE, _alike(first), _alike(part), strict=True):
                if not np.array_equal(one, other):
                    raise InvalidInput(f"run spectra {i}: other {name} than those before")
        kinds = list(dict.fromkeys(part.noise for part in parts))
        joined: dict[str, Any] = {
            name: np.concatenate([getattr(x, name) for x in parts]) for name in _EACH
        }
        frictions = [x.coulomb for x in parts if x.coulomb is not None]
        coulomb = CoulombSpectra.join(frictions) if frictions else None
        silent = tuple(
            one for part in parts for one in part.silent or (None,) * len(part.positions)
        )
        silent = silent if any(silent) else ()
        return replace(first, noise=", ".join(kinds), coulomb=coulomb, silent=silent, **joined)

    def __str__(self) -> str:
        q, e, f, n = self.inputs.shape
        return (
            f"positions: {q}, runs in each: {e}, lines: {f}, inputs: {n}, outputs: "
            f"{self.outputs.shape[3]}, noise by {self.noise}"
        )


STATES = ("auto", "yes", "no", "polynomial")


_EACH = ("positions", "inputs", "outputs", "covariance", "degrees_of_freedom", "shared_draws")
"""Arrays with a row for each position."""

_ALIKE = ("lines", "inputs or outputs", "states, derivatives, friction or commands")


def _alike(data: RunSpectra) -> tuple[ArrayLike, ...]:
    """Return what spectra that are joined have in common, see `_ALIKE`."""
    sizes = data.inputs.shape[3], data.outputs.shape[3]
    kinds = data.coulomb is not None, data.polynomials, data.commanded
    states = data.sample_time or 0.0, data.delay, data.hold_time, *kinds, *data.derivatives
    return data.omega, sizes, states


def run_spectra(
    records: Records,
    noise: str | tuple[ArrayLike, ArrayLike] = "auto",
    *,
    hold: bool = True,
    delay: float = 0.0,
    transient: Transient = "auto",
    states: str = "auto",
    weak: bool = False,
    friction: Elastic | None = None,
    values: Array | None = None,
    near: bool = True,
) -> RunSpectra:
    """Return the spectra of runs with the covariance of their errors.

    With `noise` "blocks", as many runs a block as motors, at least 4 blocks: each block's
    spectra are multiplied by the inverse of its references, R_b^-1, averaged, and combined to runs
    with independent errors of one covariance: E = n runs, whose
    scatter over blocks holds nonlinear distortions too, with (B - 1) E degrees of freedom. Else all
    runs of all blocks count by themselves, and the noise is that between the bins of periods
    ("periods", two or more), or of the 6 nearest lines that were not excited ("detection", which
    holds odd distortions where odd lines were left out). Of "auto" the first that is possible in
    all positions.

    Runs of random torques, and single periods in a closed loop, whose noise is fed back, do not end
    as they began: their states are then estimated along (``sample_time`` of the result). Noise of
    lines that were not excited holds what that adds to them, so there states need not be.

    Parameters
    ----------
    records : Records
        Runs.
    noise : str or tuple
        "auto", "blocks", "periods" or "detection"; or standard deviations of white noise in single
        samples of torques [N m] and angles [rad], of all motors or each.
    hold, delay, transient
        As in `estimate_frf`.
    states : {"auto", "yes", "no", "polynomial"}
        Whether states are estimated along; "auto" does for one period of noise that is stated.
        "polynomial" takes what they add for polynomials of the frequency in blocks of 10 lines,
        whatever the sensors: standard deviations are 5 to 20 % larger, and fits refuse lines that
        are not dense against the resonances of the model at its start.
    weak : bool
        Whether lines may be among them at which no motor's torque is above its noise, as those of
        planned spectra may be: they tell little, and nothing wrong. By default they are refused, as
        records with a wrong number of samples a period look like that.
    friction : Elastic, optional
        The robot, if its motors have Coulomb friction whose levels are to be estimated along in
        each position, see `friction_shares` and `settled_runs`; else friction counts as noise.
    values : ndarray, (p,), SI, optional
        Parameters of `friction`; by default its own.
    near : bool
        Whether these values are near, see `friction_shares`.

    Raises
    ------
    InvalidInput
        If the records cannot show the noise in this way, or runs are missing.
    """
    check_kind(records, Records, "run_spectra: records")
    check_word("states", states, STATES)
    if isinstance(noise, str):
        check_word("noise", noise, ("auto", *NOISES))
    read: Callable[..., Spectra] = partial(spectra, hold=hold, delay=delay)

    def reader(part: Records) -> Callable[..., Spectra]:
        if friction is None:
            return read
        shares = friction_shares(part, friction, values, delay, hold=hold, near=near)
        return partial(
            _with_shares, read, shares, torque_channels(friction, part.positions[0], values, delay)
        )

    positions = [
        (part, f"position {i + 1}", reader(part)) for i, part in enumerate(each_position(records))
    ]
    measured = [_checked(part, who, read, full, transient, weak) for part, who, full in positions]
    kind, estimated = _noise(noise, measured, hold)
    parts = [
        estimated(one, part, full, who)
        for one, (part, who, full) in zip(measured, positions, strict=True)
    ]
    outputs, inputs, covariance, freedom = (
        np.stack([np.asarray(getattr(part, name)) for part in parts])
        for name in ("outputs", "inputs", "covariance", "degrees_of_freedom")
    )
    silent = tuple(part.silent for part in parts if part.silent is not None)
    alone = kind == "declared" and any(one.periods == 1 for one in measured)
    along = states == "yes" or (states == "auto" and alone)
    n, m = records.torque.shape[-1], outputs.shape[-1]
    return RunSpectra(
        positions=records.positions,
        omega=records.omega,
        inputs=inputs[..., :n],
        outputs=outputs,
        covariance=covariance[..., : m + n, : m + n],
        degrees_of_freedom=freedom,
        noise=kind,
        sample_time=records.sample_time if along else None,
        delay=delay,
        derivatives=records.derivatives,
        polynomials=states == "polynomial",
        commanded=records.commanded,
        hold_time=records.sample_time if hold and records.commanded else 0.0,
        silent=silent,
        coulomb=None
        if friction is None
        else CoulombSpectra(inputs[..., n:], np.zeros(records.positions.shape), covariance),
    )


def _with_shares(
    read: Callable[..., Spectra],
    friction: Records,
    channels: Channels,
    records: Records,
    **choice: Any,
) -> Spectra:
    """Return spectra with the shares of friction as further inputs."""
    measured, shares = read(records, **choice), spectra(friction, hold=False, **choice)
    # Triangular means, as late as the angles; commands have the torque loop before friction.
    mean = np.sinc(shares.omega * records.sample_time / (2 * np.pi)) ** 2
    factor = 1 / (mean[:, None] * channels.response(shares.omega))[..., None]
    return replace(
        measured,
        input=np.concatenate([measured.input, shares.input * factor], axis=3),
        noise_input=np.concatenate([measured.noise_input, shares.noise_input * factor], axis=3),
    )


def _noise(
    noise: str | tuple[ArrayLike, ArrayLike], measured: list[Spectra], hold: bool
) -> tuple[str, NoiseOf]:
    """Return the kind of the noise, and what estimates it."""
    if not isinstance(noise, str):
        return "declared", partial(declared, noise, hold)
    kinds = list(NOISES)
    kind = max(map(possible_noise, measured), key=kinds.index) if noise == "auto" else noise
    return kind, NOISES[kind]


def _checked(
    records: Records,
    who: str,
    read: Callable[..., Spectra],
    full: Callable[..., Spectra],
    transient: Transient,
    weak: bool,
) -> Spectra:
    """Return the `full` spectra of one position without its transient, checked by plain ones."""
    measured = read(records)
    check_periods(measured, who)
    if not measured.present.all():
        block, run = np.argwhere(~measured.present)[0] + 1
        what = (
            "that block out of all positions" if len(measured.present) > 1 else "the position out"
        )
        raise InvalidInput(f"{who}: run {run} of block {block} is missing; leave {what}")
    if not weak:
        check_excited(measured, records, records.lines, who, 1)
    _check_alive(records, who)
    first = first_period(measured, transient, who)
    return full(records, first=first) if first or full is not read else measured


def _check_alive(records: Records, who: str) -> None:
    """Refuse outputs that never move, warn of torques that never do: dead sensors, motors off."""
    dead = (np.ptp(records.angle[0], axis=3) == 0).all(axis=(0, 1, 2))
    if dead.any():
        outputs = ", ".join(str(i + 1) for i in np.flatnonzero(dead))
        raise InvalidInput(
            f"{who}: output {outputs} is constant in all runs: a dead sensor, or nothing was on"
        )
    idle = (np.ptp(records.torque[0], axis=3) == 0).all(axis=(0, 1, 2))
    if idle.any():
        motors = ", ".join(str(i + 1) for i in np.flatnonzero(idle))
        warnings.warn(
            f"{who}: the torque of motor {motors} is constant in all runs; unless that motor was "
            "off, its torque was not recorded",
            IdentificationWarning,
            stacklevel=2,
        )


def _freedom(stated: ArrayLike, positions: int, name: str = "degrees_of_freedom") -> Array:
    """Return degrees of freedom of each position, (Q,)."""
    freedom = one_or_each(stated, positions, name, "positions")
    if not (freedom >= FEWEST).all():
        raise InvalidInput(f"{name}: {np.nanmin(freedom):g}; {FEWEST} at least are needed")
    return freedom


def _check_arrays(arrays: dict[str, NDArray[Any]], shapes: dict[str, tuple[int, ...]]) -> None:
    """Refuse arrays of other shapes, numbers that are not finite, lines that do not rise."""
    for name, array in arrays.items():
        if array.shape != shapes.get(name, array.shape):
            raise InvalidInput(f"{name}: shape {array.shape}; {shapes[name]} is needed")
        if not (array.size and np.isfinite(array).all()):
            raise InvalidInput(f"{name}: finite numbers are needed, at least one")
    omega = arrays["omega"]
    if not (omega[0] > 0 and (np.diff(omega) > 0).all()):
        raise InvalidInput("omega: positive rising frequencies are needed [rad/s]")


def _check_covariance(covariance: ComplexArray, omega: Array) -> None:
    """Refuse covariances that are none, and outputs or runs without any noise."""
    size = np.sqrt(np.abs(np.diagonal(covariance, axis1=-2, axis2=-1)))
    scale = np.where(size > 0, size, 1.0)
    unit = covariance / (scale[..., :, None] * scale[..., None, :])
    if not np.allclose(unit, np.conj(np.swapaxes(unit, -1, -2)), rtol=0, atol=1e-9):
        raise InvalidInput("covariance: the matrices are not Hermitian")
    least = np.linalg.eigvalsh(unit).min(axis=(0, 2))
    if least.min() < -1e-9:
        at = omega[int(np.argmin(least))] / (2 * np.pi)
        raise InvalidInput(f"covariance: negative eigenvalues at {at:.4g} Hz")
    if not size.any(axis=-1).all():
        raise InvalidInput("covariance: no noise at a line; declare a positive variance")
