"""The compiled loop of the plant: sampled controller, MuJoCo's dynamics, integration, friction.

MuJoCo gives masses and forces; time steps are taken here, for two reasons. What depends on the
robot's shape (mass matrix, gravity, velocity terms) changes little within a sample and is computed
once, at the mean coordinates and velocities of it; springs and dampers, which are stiff, are
integrated by a Runge-Kutta method of fourth order. And Coulomb friction stops a motor and holds it,
where smooth approximations creep.

Mean velocities are those of the step that is to be taken. So it is taken with gravity and velocity
terms extrapolated from the samples before, and corrected by their mean at its end (a predictor and
a corrector, of second order).
"""

# numba's decorators come without types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

from typing import Any, NamedTuple

import numpy as np
from numba import extending, types
from numpy.typing import NDArray

from robotmodels.common.arrays import Array, IntArray
from robotmodels.kernel.compiling import entry, inlined

_signature = types.void(types.intp, types.intp)
_mj_kinematics: Any = types.ExternalFunction("mj_kinematics", _signature)
_mj_comPos: Any = types.ExternalFunction("mj_comPos", _signature)  # noqa: N816
_mj_tendon: Any = types.ExternalFunction("mj_tendon", _signature)
_mj_makeM: Any = types.ExternalFunction("mj_makeM", _signature)  # noqa: N816
_mj_factorM: Any = types.ExternalFunction("mj_factorM", _signature)  # noqa: N816
_mj_fwdVelocity: Any = types.ExternalFunction("mj_fwdVelocity", _signature)  # noqa: N816
_mj_comVel: Any = types.ExternalFunction("mj_comVel", _signature)  # noqa: N816
_mj_rne: Any = types.ExternalFunction(
    "mj_rne", types.void(types.intp, types.intp, types.int32, types.intp)
)
_mj_solveM: Any = types.ExternalFunction(  # noqa: N816
    "mj_solveM", types.void(types.intp, types.intp, types.intp, types.intp, types.int32)
)
_mju_cholFactor: Any = types.ExternalFunction(  # noqa: N816
    "mju_cholFactor", types.int32(types.intp, types.int32, types.float64)
)
_mju_cholSolve: Any = types.ExternalFunction(  # noqa: N816
    "mju_cholSolve", types.void(types.intp, types.intp, types.intp, types.int32)
)

# Carpenter and Kennedy (1994): five stages of fourth order in two registers, stable for real poles
# to 4.6 and imaginary ones to 3.3 / step (the classical four stages: 2.8).
_A = np.array(
    [
        0.0,
        -567301805773 / 1357537059087,
        -2404267990393 / 2016746695238,
        -3550918686646 / 2091501179385,
        -1275806237668 / 842570457699,
    ]
)
_B = np.array(
    [
        1432997174477 / 9575080441755,
        5161836677717 / 13612068292357,
        1720146321549 / 2090206949498,
        3134564353537 / 4481467310338,
        2277821191437 / 14882151754819,
    ]
)
STABILITY = (1 / 200, 1 / 24, 1 / 6, 1 / 2, 1.0, 1.0)  # polynomial in pole times step
_FARTHEST = 1.0  # from its start, beyond which a motor is not under control [rad or m, arm side]
_ROUNDING = 1e-9  # of times [samples]
_SWEEPS = 50  # of Gauss and Seidel over motors that friction couples (rigid drives)


class MujocoState(NamedTuple):
    """MuJoCo's model and data: addresses, and views of the data's arrays (d,).

    Attributes
    ----------
    passive, bias : ndarray, (d,)
        Forces of springs and dampers; those of gravity and velocities, which count against them.
    balanced : bool
        Whether there are springs between points of the robot beside those on coordinates.
    constraints : ndarray, (f, d)
        J of the joints that follow others, J dq = 0.
    """

    model: int
    data: int
    qpos: Array
    qvel: Array
    applied: Array
    acceleration: Array
    passive: Array
    bias: Array
    balanced: bool
    constraints: Array


class Springs(NamedTuple):
    """Springs and dampers on coordinates, (s,), which are integrated within a sample.

    Attributes
    ----------
    first, second : ndarray of int, (s,)
        Coordinates whose difference is the elongation; -1 for a spring to the ground.
    low, high : ndarray, (s,), rad
        Elongations between which there is no force.
    stiffness, cubic, damping : ndarray, (s,)
        Coefficients of the elongation beyond, its cube, and its rate.
    """

    first: IntArray
    second: IntArray
    low: Array
    high: Array
    stiffness: Array
    cubic: Array
    damping: Array


class Scratch(NamedTuple):
    """Room for one sample, (d,) each.

    Attributes
    ----------
    start, shape, mean : ndarray
        Coordinates at its start, those at which geometry is computed, and mean velocities.
    before : ndarray
        Velocities before a step.
    end_q, end_v : ndarray
        Coordinates and velocities at its end, while MuJoCo has others.
    slope_q, slope_v : ndarray
        Increments of the Runge-Kutta method.
    others, last : ndarray
        Forces of gravity, velocities and no `Springs`, extrapolated; and of the sample before.
    driven, forces : ndarray
        Forces applied without friction, and those that accelerations are computed of.
    """

    start: Array
    shape: Array
    mean: Array
    before: Array
    end_q: Array
    end_v: Array
    slope_q: Array
    slope_v: Array
    others: Array
    last: Array
    driven: Array
    forces: Array


class Drives(NamedTuple):
    """What acts at the motors, (n,): coordinate, gear ratio, torque gain and limit.

    Attributes
    ----------
    friction : ndarray, (n,), N m
        Coulomb torque on the motor shaft.
    delay, lag : ndarray, (n,), samples
        Delay of the torques after their commands, and time constant of their first-order lag.
    mobility : ndarray, (d, n)
        Velocity per impulse on a motor's coordinate.
    brakes : ndarray of int, (b,)
        Coordinates with smooth Coulomb friction, each once.
    brake_torque, brake_width : ndarray, (b,)
        Its torque [N m] and the width of its tanh [rad/s], on the arm side.
    """

    coordinate: IntArray
    ratio: Array
    gain: Array
    limit: Array
    friction: Array
    delay: Array
    lag: Array
    mobility: Array
    brakes: IntArray
    brake_torque: Array
    brake_width: Array


class ControllerGains(NamedTuple):
    """The numbers of a `Controller`, and the torques that hold the arm, (n,)."""

    speed_gain: Array
    integral_rate: Array
    position_gain: Array
    filter_pole: Array
    hold: Array


class Sensing(NamedTuple):
    """Delay in samples, resolution [rad] and errors, (T, n) [rad], of the angles."""

    delay: float
    resolution: float
    errors: Array


@extending.intrinsic
def _uncounted(context, fields):
    """Return a named tuple whose arrays' references nobody counts; the caller holds them.

    To count them, again and again for each call of an inner function, took a third of the time.
    """

    def code(target, builder, signature, arguments):
        (result,) = arguments
        for i, kind in enumerate(fields.types):
            if isinstance(kind, types.Array):
                view = target.make_array(kind)(target, builder, builder.extract_value(result, i))
                view.meminfo, view.parent = view.meminfo.type(None), view.parent.type(None)
                result = builder.insert_value(result, view._getvalue(), i)
        return result

    return fields(fields), code


@entry
def closed_loop_run(
    engine: MujocoState,
    springs: Springs,
    scratch: Scratch,
    drives: Drives,
    gains: ControllerGains,
    sensing: Sensing,
    reference: Array,
    disturbance: Array,
    sample_time: float,
    substeps: int,
    parts: int,
    motion: Array,
) -> tuple[Array, Array, NDArray[np.bool_], Array, Array, int]:
    """Simulate one run from the state in `engine`.

    Torques may change `parts` times a sample; `motion`, (2, parts T, d) or empty, receives
    coordinates and rates at these instants.

    Returns
    -------
    tuple of (ndarray, ndarray, ndarray of bool, ndarray, ndarray, int)
        Torque as commanded, angle and whether the torque was limited, (T, n); mean torque of the
        motors from each instant to the next, and that with disturbance and Coulomb friction,
        (parts T, n), all on the motor shafts; and how many samples went well.
    """
    engine, springs, scratch, drives = (
        _uncounted(engine),
        _uncounted(springs),
        _uncounted(scratch),
        _uncounted(drives),
    )
    T, n = reference.shape
    torque, angle = np.zeros((T, n)), np.zeros((T, n))
    delivered, acting = np.zeros((parts * T, n)), np.zeros((parts * T, n))
    limited, true_angle, true_speed = (
        np.zeros((T, n), np.bool_),
        np.empty((T, n)),
        np.empty((T, n)),
    )
    start = drives.ratio * engine.qpos[drives.coordinate]
    last, speed, integral = start.copy(), np.zeros(n), np.zeros(n)
    impulses, lagging = np.zeros(n), gains.hold.copy()
    _start(engine, springs, scratch)
    step, steps = sample_time / parts, -(-substeps // parts)
    for k in range(T):
        for j in range(n):
            c = drives.coordinate[j]
            true_angle[k, j] = drives.ratio[j] * engine.qpos[c]
            true_speed[k, j] = drives.ratio[j] * engine.qvel[c]
            # Written so that NaN ends it too.
            if not abs(true_angle[k, j] - start[j]) < _FARTHEST * abs(drives.ratio[j]):
                return torque, angle, limited, delivered, acting, k
            y = _measured(true_angle, true_speed, k, j, sensing, sample_time, start[j])
            pole = gains.filter_pole[j]
            speed[j] = pole * speed[j] + (1 - pole) * (y - last[j]) / sample_time
            error = reference[k, j] + gains.position_gain[j] * (start[j] - y) - speed[j]
            rise = sample_time * gains.integral_rate[j] * error
            u = gains.speed_gain[j] * (error + integral[j] + rise) + gains.hold[j]
            limited[k, j] = abs(u) > drives.limit[j]
            if limited[k, j]:
                u = np.sign(u) * drives.limit[j]
            else:
                integral[j] += rise
            torque[k, j], angle[k, j], last[j] = u, y, y
        for i in range(k * parts, (k + 1) * parts):
            for j in range(n):
                u = _motor_torque(torque, i / parts, 1 / parts, j, drives, lagging, gains.hold[j])
                delivered[i, j] = u
                acting[i, j] = u + disturbance[k, j]
                engine.applied[drives.coordinate[j]] = drives.ratio[j] * acting[i, j]
            if motion.size:
                _copy(engine.qpos, motion[0, i])
                _copy(engine.qvel, motion[1, i])
            _advance(engine, springs, scratch, drives, impulses, acting[i], step, steps)
    return torque, angle, limited, delivered, acting, T


@inlined
def _start(engine: MujocoState, springs: Springs, scratch: Scratch) -> None:
    """Start from a sample before in which velocities and forces were what they are now."""
    _copy(engine.qvel, scratch.mean)
    _compute_geometry(engine, scratch, 0.0)
    _compute_others(engine, springs, scratch.last)
    _copy(scratch.last, scratch.others)


@inlined
def _copy(source: Array, target: Array) -> None:
    """Assign elements; numba's assignment of slices compiles messages of errors for seconds."""
    for i in range(len(source)):
        target[i] = source[i]


@inlined
def _motor_torque(
    torque: Array,
    time: float,
    duration: float,
    j: int,
    drives: Drives,
    lagging: Array,
    hold: float,
) -> float:
    """Return motor `j`'s mean torque from a time on [samples]; `lagging` (n,) is behind commands.

    To hold the mean takes a part (omega duration)^2 / 24 off the torque's amplitude.
    """
    begin = time - drives.delay[j]
    k = int(np.floor(begin + _ROUNDING))
    late = torque[k, j] if k >= 0 else hold
    beyond = (begin + duration - k - 1) / duration
    if beyond > _ROUNDING:
        late += beyond * ((torque[k + 1, j] if k >= -1 else hold) - late)
    gain, before = drives.gain[j], lagging[j]
    if drives.lag[j] == 0:
        return float(gain * late)
    lag = drives.lag[j] / duration
    remaining = np.exp(-1 / lag)
    lagging[j] = late + (before - late) * remaining
    return float(gain * (late + (before - late) * lag * (1 - remaining)))


@inlined
def _measured(
    angle: Array, speed: Array, k: int, j: int, sensing: Sensing, step: float, start: float
) -> float:
    """Return what the sensor of motor `j` tells at sample `k`: late, in error and rounded."""
    y = _delayed(angle, speed, k, j, sensing.delay, step, start) + sensing.errors[k, j]
    if sensing.resolution > 0:
        y = sensing.resolution * np.floor(y / sensing.resolution + 0.5)
    return float(y)


@inlined
def _delayed(
    angle: Array, speed: Array, k: int, j: int, delay: float, step: float, start: float
) -> float:
    """Return the angle `delay` samples ago, by Hermite's cubic between samples."""
    if delay == 0:
        return float(angle[k, j])
    whole = int(np.floor(delay))
    x = 1 - (delay - whole)  # from sample i to sample i + 1
    i = k - whole - 1
    if i < 0:
        return start
    a, b = angle[i, j], angle[i + 1, j]
    va, vb = step * speed[i, j], step * speed[i + 1, j]
    bend, twist = 3 * (b - a) - 2 * va - vb, 2 * (a - b) + va + vb
    return float(a + x * (va + x * (bend + x * twist)))


@inlined
def _advance(
    engine: MujocoState,
    springs: Springs,
    scratch: Scratch,
    drives: Drives,
    impulses: Array,
    acting: Array,
    duration: float,
    substeps: int,
) -> None:
    """Advance by one sample: geometry of its middle, Runge-Kutta steps, friction after each.

    Friction of the step before acts along, so that only what changes of it is left for afterwards:
    friction after each step alone would not be damped within it, and seem larger by half a step
    times the rate of damping.

    The mean torque of friction is added to what is `acting` on the motors' shafts, (n,).
    """
    h = duration / substeps
    _compute_geometry(engine, scratch, duration)
    reactions = _reactions(engine)
    _copy(engine.applied, scratch.driven)
    for step in range(substeps):
        _copy(engine.qvel, scratch.before)
        for j in range(len(impulses)):
            engine.applied[drives.coordinate[j]] += impulses[j] / h
        _integrate(engine, springs, scratch, drives, reactions, h)
        if step == substeps - 1:
            _correct(engine, springs, scratch, reactions, duration)
        apply_coulomb_friction(engine, drives, scratch.before, impulses, h)
        for j in range(len(impulses)):
            acting[j] += impulses[j] / (duration * drives.ratio[j])
        _copy(scratch.driven, engine.applied)


@inlined
def _integrate(
    engine: MujocoState,
    springs: Springs,
    scratch: Scratch,
    drives: Drives,
    reactions: Array,
    h: float,
) -> None:
    """Take one Runge-Kutta step of springs, dampers and smooth friction."""
    q, v, slope_q, slope_v = engine.qpos, engine.qvel, scratch.slope_q, scratch.slope_v
    for stage in range(len(_A)):
        _brake(engine, drives, scratch.driven)
        for i in range(len(q)):
            scratch.forces[i] = engine.applied[i] + scratch.others[i]
        add_spring_forces(springs, q, v, scratch.forces, 1.0)
        _accelerate(engine, scratch.forces, reactions)
        for i in range(len(q)):
            slope_q[i] = _A[stage] * slope_q[i] + h * v[i]
            slope_v[i] = _A[stage] * slope_v[i] + h * engine.acceleration[i]
            q[i] += _B[stage] * slope_q[i]
            v[i] += _B[stage] * slope_v[i]


@inlined
def _accelerate(engine: MujocoState, forces: Array, reactions: Array) -> None:
    """Compute accelerations by `forces`, (d,), of joints with those that they follow."""
    result = engine.acceleration.ctypes.data
    _mj_solveM(engine.model, engine.data, result, forces.ctypes.data, 1)
    if reactions.size > 0:
        correction = reactions @ (engine.constraints @ engine.acceleration)
        for i in range(len(correction)):
            engine.acceleration[i] -= correction[i]


@inlined
def _brake(engine: MujocoState, drives: Drives, driven: Array) -> None:
    """Take smooth Coulomb friction from the forces `driven` (d,)."""
    for i in range(len(drives.brakes)):
        c = drives.brakes[i]
        torque = drives.brake_torque[i] * np.tanh(engine.qvel[c] / drives.brake_width[i])
        engine.applied[c] = driven[c] - torque


@inlined
def add_spring_forces(springs: Springs, q: Array, v: Array, forces: Array, sign: float) -> None:
    """Add the forces of springs and dampers, times `sign`, to `forces`, (d,)."""
    for i in range(len(springs.first)):
        a, b = springs.first[i], springs.second[i]
        elongation, rate = q[a], v[a]
        if b >= 0:
            elongation -= q[b]
            rate -= v[b]
        beyond = elongation - min(max(elongation, springs.low[i]), springs.high[i])
        force = springs.stiffness[i] + springs.cubic[i] * beyond * beyond
        force = sign * (force * beyond + springs.damping[i] * rate)
        forces[a] -= force
        if b >= 0:
            forces[b] += force


@inlined
def _compute_geometry(engine: MujocoState, scratch: Scratch, duration: float) -> None:
    """Compute what depends on the robot's shape only, at mean coordinates; the state stays.

    They are q + h v / 2 + h^2 a / 6, with accelerations from mean velocities of the sample before.
    """
    q, v = engine.qpos, engine.qvel
    _copy(q, scratch.start)
    for i in range(len(q)):
        q[i] += 0.5 * duration * (v[i] + 2 / 3 * (v[i] - scratch.mean[i]))
    _mj_kinematics(engine.model, engine.data)
    _mj_comPos(engine.model, engine.data)
    _mj_makeM(engine.model, engine.data)
    _mj_factorM(engine.model, engine.data)
    if engine.balanced:
        _mj_tendon(engine.model, engine.data)
    _copy(q, scratch.shape)
    _copy(scratch.start, q)


@inlined
def _compute_others(engine: MujocoState, springs: Springs, others: Array) -> None:
    """Compute forces of gravity, velocities and all passive ones but those of `springs`, (d,)."""
    if engine.balanced:
        _mj_fwdVelocity(engine.model, engine.data)
        _copy(engine.passive, others)
        add_spring_forces(springs, engine.qpos, engine.qvel, others, -1.0)
    else:
        _mj_comVel(engine.model, engine.data)
        _mj_rne(engine.model, engine.data, 0, engine.bias.ctypes.data)
        for i in range(len(others)):
            others[i] = 0.0
    for i in range(len(others)):
        others[i] -= engine.bias[i]


@inlined
def _correct(
    engine: MujocoState, springs: Springs, scratch: Scratch, reactions: Array, duration: float
) -> None:
    """Correct a sample's end by the forces at its mean velocities; extrapolate them to the next."""
    q, v, forces, others = engine.qpos, engine.qvel, scratch.forces, scratch.others
    _copy(q, scratch.end_q)
    _copy(v, scratch.end_v)
    for i in range(len(q)):
        scratch.mean[i] = (q[i] - scratch.start[i]) / duration
    _copy(scratch.shape, q)
    _copy(scratch.mean, v)
    _compute_others(engine, springs, forces)
    for i in range(len(q)):
        force = forces[i]
        forces[i] = force - others[i]
        others[i], scratch.last[i] = 2 * force - scratch.last[i], force
    _accelerate(engine, forces, reactions)
    for i in range(len(q)):
        change_of_speed = duration * engine.acceleration[i]
        q[i] = scratch.end_q[i] + 0.5 * duration * change_of_speed
        v[i] = scratch.end_v[i] + change_of_speed


@inlined
def _reactions(engine: MujocoState) -> Array:
    """Return M^-1 J^T (J M^-1 J^T)^-1, (d, f), by Lagrange's multipliers of J a = 0.

    They are the accelerations that keep joints with those that they follow.
    """
    J = engine.constraints
    if len(J) == 0:
        return J
    mobility = np.zeros_like(J)
    _mj_solveM(engine.model, engine.data, mobility.ctypes.data, J.ctypes.data, len(J))
    reactions = mobility.T.copy()
    coupling = J @ reactions
    _mju_cholFactor(coupling.ctypes.data, len(J), 0.0)
    for row in reactions:
        _mju_cholSolve(row.ctypes.data, coupling.ctypes.data, row.ctypes.data, len(J))
    return reactions


@inlined
def apply_coulomb_friction(
    engine: MujocoState, drives: Drives, before: Array, impulses: Array, h: float
) -> None:
    """Brake the motors by Coulomb friction: stop each one if the impulse at hand can do it.

    `impulses` (n,) have acted in the step; they are replaced by what they should have been. The
    impulse is that of a force that was constant over the step h, so it moves the motors too:
    one that rests and is pushed by less than its friction stays where it is. One that turns around
    within the step, from the velocities `before` (d,), is braked in either direction for its time:
    friction in the last direction all along would come half a step early, like a negative inertia.
    """
    if not drives.friction.any():
        return
    bounds = np.empty((len(impulses), 2))
    for j in range(len(impulses)):
        bounds[j, 0], bounds[j, 1] = _impulse_bounds(engine, drives, before, j, h, impulses[j])
    for _ in range(_SWEEPS):
        if _sweep(engine, drives, bounds, impulses, h) < 1e-9:
            break


@inlined
def _sweep(engine: MujocoState, drives: Drives, bounds: Array, impulses: Array, h: float) -> float:
    """Stop each motor in turn, within `bounds` (n, 2); return the largest change of friction."""
    change = 0.0
    for j in range(len(impulses)):
        if drives.friction[j] == 0:
            continue
        c = drives.coordinate[j]
        last = impulses[j]
        needed = last - engine.qvel[c] / drives.mobility[c, j]
        impulses[j] = min(max(needed, bounds[j, 0]), bounds[j, 1])
        impulse = impulses[j] - last
        if impulse == 0:
            continue
        change = max(change, abs(impulse) / (h * drives.friction[j] * abs(drives.ratio[j])))
        for i in range(len(engine.qvel)):
            change_of_speed = drives.mobility[i, j] * impulse
            engine.qvel[i] += change_of_speed
            engine.qpos[i] += 0.5 * h * change_of_speed
    return change


@inlined
def _impulse_bounds(
    engine: MujocoState, drives: Drives, before: Array, j: int, h: float, acted: float
) -> tuple[float, float]:
    """Return the least and largest impulse of friction on a motor in a step.

    A motor that stops after the part tau of the step, v0 / (v0 - v + F h), and is pushed on by more
    than its friction, has the impulse of that in its first direction for tau, then in the other.
    """
    c = drives.coordinate[j]
    bound = h * drives.friction[j] * abs(drives.ratio[j])
    first = before[c]
    sign = 1.0 if first > 0 else -1.0
    braking = drives.mobility[c, j] * bound
    unbraked = engine.qvel[c] - drives.mobility[c, j] * acted
    pushed = -sign * (unbraked - first)  # against the first direction, without friction
    if first == 0 or pushed <= braking:
        return -bound, bound
    part = min(sign * first / (pushed + braking), 1.0)
    other = (1 - 2 * part) * bound
    return (-bound, other) if sign > 0 else (-other, bound)
