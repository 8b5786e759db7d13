"""FRFs as universal files, dataset 58 (function at nodal degree of freedom), through pyuff.

Each element of each FRF is a function of type 4, binary with double precision: response node =
output + 1, reference node = input + 1, both rotations (direction 4), rad/s^2 over N m, abscissa in
Hz. The version number is the position's number, from 1. Functions of type 0 hold the variance of
each element in the same way, and, with the words "positions", "repetitions" and "degrees of
freedom" in ID line 1, the positions' coordinates, one function a position, the repetitions, and the
degrees of freedom of the variances (1e15 where they are declared).

Responses, variances, positions and repetitions keep every bit, frequencies all but the last, for
the conversion to Hz. Of full covariances the diagonal is kept, and no draws of the errors: UFF has
no place for them.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.frf.file_schemas import read_freedom, stored_freedom
from estimators.frf.frf_estimate import FrfEstimate
from estimators.frf.uff_units import (
    ACCELERATION,
    FREQUENCY,
    check_unit_system,
    frequency_factor,
    response_factor,
)
from robotmodels.common.arrays import Array, ComplexArray, whole_numbers
from robotmodels.common.errors import InvalidInput
from robotmodels.data_files.universal_file import ignore_unclosed_files, read_functions
from robotmodels.linear.noise import NoiseLaw

_FRF, _GENERAL = 4, 0
_ROTATION, _FORCE = 4, 13
_NAME = "elastic robot FRF"
_MOST_ELEMENTS = 1000  # of the FRFs for each function; the missing ones are named below that


def write_frf(path: Path, estimate: FrfEstimate) -> None:
    """Write FRFs and their variances."""
    Q, F, m, n = estimate.response.shape
    if F < 2:
        raise InvalidInput(f"{path}: one frequency; UFF 58 is written from two on")
    hertz = estimate.omega / (2 * np.pi)
    sets = []
    for q in range(Q):
        for i, j in np.ndindex(m, n):
            title = f"position {q + 1}, output {i + 1}, input {j + 1}"
            nodes = {"ver_num": q + 1, "rsp_node": i + 1, "ref_node": j + 1}
            sets.append(_function(_FRF, _NAME, title, hertz, estimate.response[q, :, i, j], nodes))
            values = estimate.variance[q, :, i, j]
            sets.append(_function(_GENERAL, "variance", title, hertz, values, nodes))
        nodes = {"ver_num": q + 1, "rsp_node": 0, "ref_node": 0}
        sets.append(_vector("positions", estimate.positions[q], nodes))
    nodes = {"ver_num": 0, "rsp_node": 0, "ref_node": 0}
    sets.append(_vector("repetitions", estimate.repetitions.astype(float), nodes))
    freedom = stored_freedom(estimate.degrees_of_freedom)
    if freedom is not None:
        sets.append(_vector("degrees of freedom", freedom, nodes))
    _write_sets(path, sets)


def read_frf(
    path: Path, positions: Array | None = None, noise: NoiseLaw | None = None
) -> FrfEstimate:
    """Read FRFs; see `estimators.frf.file_formats.read_frf`."""
    sets, units = read_functions(path)
    check_unit_system(units)
    responses = [s for s in sets if s["func_type"] == _FRF]
    if not responses:
        raise InvalidInput("no frequency response function (dataset 58 of type 4)")
    axes = _axes(responses)
    with np.errstate(over="ignore"):  # what is infinite is refused with the estimate
        omega = frequency_factor(responses[0], _who(responses[0])) * responses[0]["x"]
    response = np.asarray(_gathered(responses, axes, responses[0]), dtype=complex)
    variance, freedom = _variances(sets, axes, response, noise)
    numbers = axes[0]
    told = [s for s in sets if s["id1"].strip() == "positions"]
    if told:
        positions = _positions(told, numbers)
    elif positions is None:
        raise InvalidInput("no positions; give them as positions=... (Q, n) [rad]")
    counts = _single(sets, "repetitions")
    repetitions = np.ones(len(response)) if counts is None else counts
    return FrfEstimate(
        np.asarray(positions, dtype=float),
        omega,
        response,
        variance,
        whole_numbers(repetitions, "repetitions"),
        freedom,
    )


def _variances(
    sets: list[dict[str, Any]],
    axes: list[list[Any]],
    response: ComplexArray,
    noise: NoiseLaw | None,
) -> tuple[Array, Array]:
    """Return variances and their degrees of freedom, from the file or by the law."""
    variances = [s for s in sets if s["id1"].strip() == "variance"]
    if not variances:
        if noise is None:
            raise InvalidInput(
                "no variances; give the law of the errors as noise=RelativeNoise(...)"
            )
        return noise.variance(response), np.full(len(response), np.inf)
    responses = [s for s in sets if s["func_type"] == _FRF]
    if any(abs(response_factor(s, _who(s))) != 1 for s in responses):
        raise InvalidInput("variances beside FRFs in other units than rad/s^2 and N m")
    freedom = read_freedom(_single(sets, "degrees of freedom"), len(response))
    return np.asarray(_gathered(variances, axes, responses[0]).real, dtype=float), freedom


def _single(sets: list[dict[str, Any]], name: str) -> Array | None:
    """Return the values of the function called `name`; None where there is none."""
    values = [_trimmed(s) for s in sets if s["id1"].strip() == name]
    if len(values) > 1:
        raise InvalidInput(f"{name}: given twice")
    return values[0] if values else None


def _positions(functions: list[dict[str, Any]], numbers: list[int]) -> Array:
    """Return coordinates (Q, n), one function for each of the positions' numbers."""
    coordinates = {_version(s): _trimmed(s) for s in functions}
    if len(coordinates) < len(functions) or sorted(coordinates) != numbers:
        raise InvalidInput(
            f"positions: of the numbers {sorted(map(_version, functions))}; one for each of "
            f"{numbers} is needed"
        )
    if len({len(row) for row in coordinates.values()}) > 1:
        raise InvalidInput("positions: they differ in their number of coordinates")
    return np.array([coordinates[number] for number in numbers])


def _function(
    kind: int, name: str, title: str, x: Array, data: NDArray[Any], nodes: dict[str, int]
) -> dict[str, Any]:
    ordinate, divisor = (ACCELERATION, _FORCE) if kind == _FRF else (0, 0)
    return nodes | {
        "type": 58,
        "binary": 1,
        "id1": name,
        "id2": title,
        "func_type": kind,
        "rsp_dir": _ROTATION,
        "ref_dir": _ROTATION,
        "abscissa_spacing": 0,
        "abscissa_spec_data_type": FREQUENCY if nodes["rsp_node"] else 0,
        "abscissa_axis_units_lab": "Hz" if nodes["rsp_node"] else "NONE",
        "ordinate_spec_data_type": ordinate,
        "ordinate_axis_units_lab": "rad/s^2" if kind == _FRF else "NONE",
        "orddenom_spec_data_type": divisor,
        "orddenom_axis_units_lab": "N m" if kind == _FRF else "NONE",
        "data": data,
        "x": x,
    }


def _vector(name: str, values: Array, nodes: dict[str, int]) -> dict[str, Any]:
    """Return a function of the index; a second point is added to a single one, as pyuff needs."""
    data = np.append(values, 0.0) if len(values) == 1 else values
    return _function(
        _GENERAL, name, f"{len(values)} values", np.arange(1.0, len(data) + 1), data, nodes
    )


def _trimmed(one: dict[str, Any]) -> Array:
    """Return the values of what `_vector` made; its title says how many there are."""
    values, title = one["data"].real, one["id2"].split()
    count = int(title[0]) if title and title[0].isdecimal() and len(title[0]) < 10 else -1
    if len(values) != (2 if count == 1 else count):
        raise InvalidInput(
            f"{one['id1'].strip()}: {len(values)} values under the title {one['id2'][:60]!r}; "
            "'... values' with their number is needed"
        )
    return np.asarray(values[:count])


def _write_sets(path: Path, sets: list[dict[str, Any]]) -> None:
    """Write sets one by one, and mend the number of bytes that pyuff puts in their headers.

    It counts 8 bytes a point, whatever a point holds, and other programs rely on it. A file of its
    own for each set spares pyuff reading all that was written before.
    """
    import pyuff

    single = path.with_name(f"{path.name}.set")
    try:
        with path.open("wb") as file:
            for one in sets:
                single.unlink(missing_ok=True)
                with ignore_unclosed_files():
                    pyuff.UFF(str(single)).write_sets(one, mode="add")
                content = single.read_bytes()
                numbers = 3 if np.iscomplexobj(one["data"]) else 2
                count = b"%12d" % (8 * numbers * len(one["data"]))
                at = content.index(b"58b") + len(b"58b") + 6 + 6 + 12
                file.write(content[:at] + count + content[at + 12 :])
    finally:
        single.unlink(missing_ok=True)


def _version(one: dict[str, Any]) -> int:
    return int(one["ver_num"])


def _axes(sets: list[dict[str, Any]]) -> list[list[Any]]:
    """Return the positions' numbers, the outputs' and the inputs' degrees of freedom."""
    outputs = {(s["rsp_node"], abs(s["rsp_dir"])) for s in sets}
    inputs = {(s["ref_node"], abs(s["ref_dir"])) for s in sets}
    return [sorted({_version(s) for s in sets}), sorted(outputs), sorted(inputs)]


def _who(one: dict[str, Any]) -> str:
    return f"function {one['id2'].strip()!r}, nodes {one['rsp_node']} and {one['ref_node']}"


def _gathered(
    sets: list[dict[str, Any]], axes: list[list[Any]], first: dict[str, Any]
) -> ComplexArray:
    """Put functions into one (Q, F, m, n) array, in SI units and positive directions.

    Raises
    ------
    InvalidInput
        Naming an element that is missing, given twice, not an acceleration over a torque, or at
        other frequencies than the `first` function.
    """
    numbers, outputs, inputs = axes
    if len(numbers) * len(outputs) * len(inputs) > _MOST_ELEMENTS * len(sets):
        raise InvalidInput(
            f"{len(sets)} functions for {len(numbers)} positions, {len(outputs)} outputs and "
            f"{len(inputs)} inputs; one for each of their combinations is needed"
        )
    unit, x = frequency_factor(first, _who(first)), first["x"]
    values = np.full((len(numbers), len(outputs), len(inputs), len(x)), np.nan, dtype=complex)
    for s in sets:
        response, reference = (s["rsp_node"], abs(s["rsp_dir"])), (s["ref_node"], abs(s["ref_dir"]))
        who = _who(s)
        factor = response_factor(s, who) if s["func_type"] == _FRF else 1.0
        if frequency_factor(s, who) != unit or not np.array_equal(s["x"], x):
            raise InvalidInput(f"{who}: its frequencies differ from those of the first function")
        if _version(s) not in numbers or response not in outputs or reference not in inputs:
            raise InvalidInput(f"{who}: no frequency response function is there")
        element = (
            numbers.index(_version(s)),
            outputs.index(response),
            inputs.index(reference),
        )
        if not np.isnan(values[element]).all():
            raise InvalidInput(f"{who}: given twice")
        values[element] = factor * s["data"]
    gap = np.argwhere(np.isnan(values).all(axis=-1))
    if len(gap):
        q, i, j = gap[0]
        raise InvalidInput(
            f"no function for position {numbers[q]}, response node {outputs[i][0]}, reference node "
            f"{inputs[j][0]}"
        )
    return np.asarray(np.moveaxis(values, -1, 1))
