"""Any linear feedback of motor angles to motor torques, u = -F y, by state-space matrices."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from robotmodels.common.arrays import Array, ComplexArray, check_above_zero, read_only, real_numbers
from robotmodels.common.errors import InvalidInput
from robotmodels.common.yaml_files import FileSection, read_yaml
from robotmodels.description.ranges import Seconds
from robotmodels.simulation.controller import Controller
from robotmodels.simulation.loop_noise import hold_response

_MOST = 200
"""States of a controller in a file."""


@dataclass(frozen=True, eq=False)
class LinearFeedback:
    """Torques u = -(C x + D y) on the motor shafts by their angles y, x' or x+ = A x + B y.

    Attributes
    ----------
    A : ndarray, (h, h)
        State matrix.
    B : ndarray, (h, n)
        Input matrix, of motor angles [rad].
    C : ndarray, (n, h)
        Output matrix, of torques with opposite sign [N m].
    D : ndarray, (n, n), N m/rad
        Feedthrough.
    sample_time : float or None, s
        Of a sampled controller, whose torque is held over a sample; None in continuous time.

    Raises
    ------
    InvalidInput
        Naming the matrix that does not fit, or a sample time that is not positive.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    sample_time: float | None = None

    def __post_init__(self) -> None:
        D = np.atleast_2d(real_numbers(self.D, "controller: D"))
        n, h = len(D), len(np.atleast_1d(self.A))
        shapes = {"A": (h, h), "B": (h, n), "C": (n, h), "D": (n, n)}
        for name, shape in shapes.items():
            matrix = real_numbers(getattr(self, name), f"controller: {name}")
            matrix = matrix.reshape(shape) if matrix.size == 0 == np.prod(shape) else matrix
            if matrix.shape != shape or not np.isfinite(matrix).all():
                raise InvalidInput(
                    f"controller: {name} of shape {matrix.shape}; finite numbers of shape {shape} "
                    f"are needed for {h} states and {n} motors"
                )
            object.__setattr__(self, name, read_only(matrix))
        if self.sample_time is not None:
            check_above_zero(self.sample_time, "controller: sample_time")

    def response(self, omega: Array | ComplexArray) -> ComplexArray:
        """Return F, (F, n, n) [N m/rad], at `omega` (F,) [rad/s]; complex omega is -j s."""
        jw = 1j * np.asarray(omega)
        point = jw if self.sample_time is None else np.exp(jw * self.sample_time)
        resolvent = point[:, None, None] * np.eye(len(self.A)) - self.A
        states = np.linalg.solve(resolvent, np.broadcast_to(self.B, (len(jw), *self.B.shape)))
        return np.asarray(self.C @ states + self.D)

    def __call__(self, omega: Array) -> ComplexArray:
        """Return torque per angle with the hold of a sampled torque, for `ToolModel.response`."""
        hold = hold_response(omega, self.sample_time or 0.0)
        return np.asarray(hold[:, None, None] * self.response(omega))

    def filtered(self, motor: int, notch: "Notch | None", gain: float = 1.0) -> "LinearFeedback":
        """Return the controller with a notch filter and a factor at the torque of one motor."""
        none = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), 1.0
        a, b, c, d = none if notch is None else notch.state_space(self.sample_time)
        h, k = len(self.A), len(a)
        A = np.block([[self.A, np.zeros((h, k))], [b * self.C[motor], a]])
        B = np.vstack([self.B, b * self.D[motor]])
        C = np.hstack([self.C, np.zeros((len(self.C), k))])
        D = self.D.copy()
        C[motor] = gain * np.concatenate([d * self.C[motor], c.ravel()])
        D[motor] = gain * d * self.D[motor]
        return replace(self, A=A, B=B, C=C, D=D)


@dataclass(frozen=True)
class Notch:
    """$(s^2 + 2 z w s + w^2) / (s^2 + 2 p w s + w^2)$: damping z of the zeros below p of the poles.

    Attributes
    ----------
    frequency : float, rad/s
        w, where it is deepest, z / p.
    zeros, poles : float, dimensionless
        Damping ratios z and p.
    """

    frequency: float
    zeros: float
    poles: float

    def state_space(self, sample_time: float | None) -> tuple[Array, Array, Array, float]:
        """Return its matrices (2, 2), (2, 1), (1, 2) and its feedthrough; sampled by Tustin's rule.

        The rule is that which keeps the frequency of the notch.
        """
        from scipy.signal import bilinear, tf2ss

        w = self.frequency
        zeros, poles = ([1.0, 2 * x * w, w**2] for x in (self.zeros, self.poles))
        if sample_time is not None:
            rate = w / (2 * np.tan(w * sample_time / 2))
            zeros, poles = bilinear(zeros, poles, rate)
        A, B, C, D = tf2ss(zeros, poles)
        return A, B, C, float(D[0, 0])


def linear_feedback(controller: Any, sample_time: float | None = None) -> LinearFeedback:
    """Return a controller as state-space matrices.

    Parameters
    ----------
    controller : Controller, LinearFeedback, str, Path, object or sequence
        Also a file (`ControllerFile`); a state-space model of python-control (or any object with
        A, B, C, D and dt), angles in and torques out; or one transfer function per motor, objects
        with num, den and dt. Torques are F y with positive stiffness: u = -F y.
    sample_time : float, optional
        In place of that of the objects.

    Raises
    ------
    InvalidInput
        If it is none of these, or matrices do not fit.
    """
    if isinstance(controller, LinearFeedback):
        return controller
    if isinstance(controller, Controller):
        return _of_cascade(controller)
    if isinstance(controller, str | Path):
        return _of_file(Path(controller))
    if hasattr(controller, "A"):
        A, B, C, D = (np.asarray(getattr(controller, name)) for name in "ABCD")
        return LinearFeedback(A, B, C, D, sample_time or _time_step(controller))
    functions = list(controller) if isinstance(controller, Sequence) else [controller]
    if not functions or not all(hasattr(f, "num") and hasattr(f, "den") for f in functions):
        raise InvalidInput(
            f"controller: a {type(controller).__name__}; a Controller, a file, state-space "
            "matrices or a transfer function for each motor are needed"
        )
    if len({_time_step(f) for f in functions}) > 1:
        raise InvalidInput("controller: transfer functions of different sample times")
    pairs = [(np.ravel(f.num[0][0]), np.ravel(f.den[0][0])) for f in functions]
    return _of_functions(pairs, sample_time or _time_step(functions[0]))


def _time_step(system: Any) -> float | None:
    """Return the sample time of a python-control system; None in continuous time."""
    step = getattr(system, "dt", None)
    if step is True:
        raise InvalidInput("controller: a sampled system without its sample time (dt)")
    return float(step) if step else None


def _of_cascade(controller: Controller) -> LinearFeedback:
    """Return the matrices of `Controller` without its reference: states w, i, last angle."""
    n, T = len(controller.speed_gain), controller.sample_time
    w, i, last, y = np.eye(4 * n).reshape(4, n, 4 * n)
    a, integral = controller.filter_pole[:, None], (T / controller.integral_time)[:, None]
    w = a * w + (1 - a) / T * (y - last)
    error = -controller.position_gain[:, None] * y - w
    # Without an integral part nothing is remembered: the pole at 1 would pass for instability.
    i = (integral > 0) * i + integral * error
    torque = -controller.speed_gain[:, None] * (error + i)
    step = np.concatenate([w, i, y])
    h = 3 * n
    return LinearFeedback(step[:, :h], step[:, h:], torque[:, :h], torque[:, h:], T)


def _of_functions(pairs: Sequence[tuple[Array, Array]], time: float | None) -> LinearFeedback:
    """Return the matrices of one transfer function, numerator and denominator, per motor."""
    from scipy.linalg import block_diag
    from scipy.signal import tf2ss

    for i, (numerator, denominator) in enumerate(pairs):
        if len(numerator) > len(denominator) or denominator[0] == 0:
            raise InvalidInput(
                f"controller: transfer function of motor {i + 1}: a numerator of order "
                f"{len(numerator) - 1} over a denominator of order {len(denominator) - 1}; it must "
                "be proper, with a leading coefficient other than zero"
            )
    blocks = zip(*(tf2ss(*pair) for pair in pairs), strict=True)
    A, B, C, D = (block_diag(*block) for block in blocks)
    return LinearFeedback(A, B, C, D, time)


Number = Annotated[float, Field(ge=-1e15, le=1e15)]
Row = Annotated[list[Number], Field(max_length=_MOST)]
Matrix = Annotated[list[Row], Field(max_length=_MOST)]


class TransferFunction(FileSection):
    """Coefficients of powers of s, or of z of a sampled one, highest first."""

    numerator: Row = Field(min_length=1, description="[N m/rad], of no higher order")
    denominator: Row = Field(min_length=1, description="leading coefficient other than zero")


class ControllerFile(FileSection):
    """A controller in a YAML or JSON file: matrices, or a transfer function for each motor.

    ``{"schema": "controller/1", "sample_time": 1e-3, "A": [[..]], "B": .., "C": .., "D": ..}`` or
    ``{.., "motors": [{"numerator": [..], "denominator": [..]}, ..]}``; without a sample time it is
    in continuous time. Torques are -F times the motor angles.
    """

    schema_: Literal["controller/1"] = Field(alias="schema")
    sample_time: Seconds | None = Field(
        None, description="[s], zero-order hold of torques; left out: continuous time"
    )
    A: Matrix = Field([], description="(h, h), of states; with B, C and D in place of motors")
    B: Matrix = Field([], description="(h, n), of motor angles [rad]")
    C: Matrix = Field([], description="(n, h), of torques with opposite sign [N m]")
    D: Matrix | None = Field(None, description="(n, n), feedthrough [N m/rad]")
    motors: list[TransferFunction] = Field(
        [], max_length=_MOST, description="transfer function of each motor, in place of matrices"
    )


def _of_file(path: Path) -> LinearFeedback:
    content = read_yaml(path, ControllerFile)
    if bool(content.motors) == (content.D is not None):
        raise InvalidInput(f"{path}: either motors, or A, B, C and D are needed")
    try:
        if content.motors:
            pairs = [(np.array(m.numerator), np.array(m.denominator)) for m in content.motors]
            return _of_functions(pairs, content.sample_time)
        A, B, C, D = (np.array(getattr(content, name), dtype=float) for name in "ABCD")
        return LinearFeedback(A, B, C, D, content.sample_time)
    except (InvalidInput, ValueError) as error:  # rows of different lengths
        raise InvalidInput(f"{path}: {error}") from None
