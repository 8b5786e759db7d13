"""What sensors make of motions, eight lines at once: FRFs of other outputs than motors' motions.

G = R x, x the response S^T A^-1 S with more "motors": the coordinates that outputs see, and R what
sensors make of their motions. The torque of a spring depends on its own coefficients, too: for each
such sensor there is one motor more, that moves nothing, at which its spring's elongation is one.
So derivatives are those of motors' motions.
"""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

from typing import NamedTuple

from robotmodels.kernel.compiling import compiled, inlined
from robotmodels.kernel.memory import integer, load, load_complex, scalar, store
from robotmodels.kernel.simd import fma, fma_conjugate, pack, splat
from robotmodels.kernel.solve import motor_response


class RunShape(NamedTuple):
    """Sizes of runs, and addresses of what sensors make of motions.

    Attributes
    ----------
    runs, inputs, outputs : int
        Columns of U, an even number; torques n and outputs m.
    blocks : int
        Cells of a position.
    torques : int
        Sensors of springs' torques.
    readings : int
        (Q, 3, m, t) doubles: angles, velocities, accelerations of the t motors in each output; zero
        where outputs are the n motors' motions.
    sensors : int
        (cells, m) complex vectors: gains, delays and lags.
    table : int
        (torques, 5) integers: output, spring, the two motors at its ends or -1, and its place among
        the needed springs or -1.
    """

    runs: int
    inputs: int
    outputs: int
    blocks: int
    torques: int = 0
    readings: int = 0
    sensors: int = 0
    table: int = 0


@inlined
def even(count):
    """Return the next even number: tiles are of two by two."""
    return count + count % 2


@compiled
def write_sensors(work, cells, cell, stiffness, damping, shape, target):
    """Write R, (m, t), to `target`."""
    w, count = load(cells.omega, cell), shape.outputs * work.n
    readings = shape.readings + 8 * 3 * count * (cell // shape.blocks)
    for i in range(shape.outputs):
        gain = load_complex(shape.sensors, 2 * (cell * shape.outputs + i))
        for e in range(i * work.n, (i + 1) * work.n):
            angle, rate = splat(scalar(readings, e)), splat(scalar(readings, count + e))
            acceleration = splat(scalar(readings, 2 * count + e))
            at_rest = fma(splat(0.0) - w * w, acceleration, angle)
            store(target, 2 * e, pack(at_rest, w * rate) * gain)
    for e in range(shape.torques):
        add_torque(work, e, w, stiffness, damping, cell, shape, target)


@compiled
def add_torque(work, e, w, stiffness, damping, cell, shape, target):
    """Add what torque sensor `e` reads of the motions at its spring's ends to R, and its motor."""
    i, s = integer(shape.table, 5 * e), integer(shape.table, 5 * e + 1)
    gain = load_complex(shape.sensors, 2 * (cell * shape.outputs + i))
    store(target, 2 * (i * work.n + work.n - shape.torques + e), gain)
    spring = pack(splat(scalar(stiffness, s)), w * splat(scalar(damping, s))) * gain
    for end in range(2):
        motor = integer(shape.table, 5 * e + 2 + end)
        if motor >= 0:
            at = 2 * (i * work.n + motor)
            share = splat((2.0 * end - 1.0) / scalar(work.gears, motor))
            store(target, at, load_complex(target, at) + spring * share)


@compiled
def write_response(work, shape, sensors, target):
    """Write G to `target`, (m, n) in rows of an even number."""
    n, wide = shape.inputs, even(shape.inputs)
    if shape.readings == 0:
        for i in range(n):
            for j in range(i, n):
                response = motor_response(work, i, j)
                store(target, 2 * (i * wide + j), response)
                store(target, 2 * (j * wide + i), response)
        return
    zero = pack(splat(0.0), splat(0.0))
    for e in range(shape.outputs * wide):
        store(target, 2 * e, zero)
    for a in range(work.n - shape.torques):
        for j in range(n):
            response = motor_response(work, min(a, j), max(a, j))
            for i in range(shape.outputs):
                at = 2 * (i * wide + j)
                row = load_complex(sensors, 2 * (i * work.n + a))
                store(target, at, fma(row, response, load_complex(target, at)))


@compiled
def lift(work, sensors, rows, columns, low, high, count, target):
    """Write R^H of `rows` (m, columns), from `low` to `high`, to `target` (t, count)."""
    for a in range(work.n):
        for k in range(0, 2 * count, 2):
            y = pack(splat(0.0), splat(0.0))
            for i in range(low, high):
                sensor = load_complex(sensors, 2 * (i * work.n + a))
                y = fma_conjugate(sensor, load_complex(rows, 2 * i * columns + k), y)
            store(target, 2 * a * count + k, y)


@inlined
def copy_sensors(work, sensors, shape, row, target):
    """Write R (m, t), the unit matrix of motors' motions; one row of it if not negative."""
    zero, one, t = pack(splat(0.0), splat(0.0)), pack(splat(1.0), splat(0.0)), work.n
    for i in range(shape.outputs):
        for j in range(t):
            y = zero
            if row < 0 or row == i:
                unit = one if i == j else zero
                y = unit if shape.readings == 0 else load_complex(sensors, 2 * (i * t + j))
            store(target, 2 * (i * t + j), y)


@compiled
def own_torques(work, shape):
    """Set the elongation of springs whose torque is measured to one at the motor of its sensor."""
    if shape is None:
        return
    for e in range(shape.torques):
        s = integer(shape.table, 5 * e + 4)
        if s >= 0:
            at = s * work.wide + 2 * (work.n - shape.torques + e)
            store(work.elongation, at, pack(splat(1.0), splat(0.0)))
