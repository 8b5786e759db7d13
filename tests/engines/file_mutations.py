"""Files turned into faulty and hostile ones: bytes, text, and the contents of HDF5 and MATLAB."""

import io
import json
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import loadmat, savemat
from scipy.sparse import eye_array

from robotmodels import InvalidInput

HUGE = 2**34
NUMBERS = (0, -1, 0.5, 5.9, 1e308, -1e308, 1e-320, 2**31, 2**53 + 2, 2**63, np.nan, np.inf, -np.inf)
TOKENS = (
    *("", "nan", "-inf", "1e999", "0.2_0", "\u0663", "0x10", "true", "null", "-1", "5.9", "1e300"),
    *("[]", "[[]]", "{}", '"text"', "[1, [2]]", "[true]", '["a"]', "[NaN]", '{"a": 1, "a": 2}'),
    *("\x00", "\x1b[31m", "\ud7ff", "'", '"', ",", "\n", "#", "# schema: 1", "9" * 400, "[" * 2000),
)


def mutated_bytes(content, rng):
    """Flip, cut, double, blank or move bytes."""
    data, size = bytearray(content), max(len(content), 1)
    start = int(rng.integers(size))
    stop = min(size, start + int(2 ** rng.uniform(0, 10)))
    match rng.integers(7):
        case 0 | 1:
            for _ in range(int(rng.choice([1, 1, 1, 2, 8]))):
                data[int(rng.integers(size))] ^= 1 << int(rng.integers(8))
        case 2:
            del data[start:]
        case 3:
            del data[start:stop]
        case 4:
            data[start:start] = data[start:stop]
        case 5:
            data[start:stop] = bytes([int(rng.choice([0, 255, 32]))]) * (stop - start)
        case 6:
            data[start:stop] = rng.bytes(stop - start)
    return bytes(data)


def mutated_text(content, rng):
    """Delete, double, swap or rename lines, and put tokens in place of cells."""
    lines = content.decode("utf-8").splitlines(keepends=True)
    heads = [i for i, line in enumerate(lines) if line.startswith("#")]
    # Headers say more than one row of many.
    i = int(rng.choice([*heads, min(len(heads), len(lines) - 1), rng.integers(len(lines))]))
    match rng.integers(7):
        case 0:
            del lines[i]
        case 1:
            lines.insert(i, lines[int(rng.integers(len(lines)))])
        case 2:
            j = int(rng.integers(len(lines)))
            lines[i], lines[j] = lines[j], lines[i]
        case 3:
            column = int(rng.integers(lines[-1].count(",") + 1))
            lines = [line if line[0] == "#" else _without(line, column) for line in lines]
        case _:
            cells = lines[i].rstrip("\n").split(":" if lines[i].startswith("#") else ",")
            cells[int(rng.integers(len(cells)))] = str(rng.choice(TOKENS))
            lines[i] = (":" if lines[i].startswith("#") else ",").join(cells) + "\n"
    return "".join(lines).encode("utf-8", "surrogatepass")


def _without(line, column):
    cells = line.rstrip("\n").split(",")
    return ",".join(cells[:column] + cells[column + 1 :]) + "\n"


def mutated_json(content, rng):
    """Put another value in place of one somewhere in a document."""
    document = json.loads(content)
    place, key = document, None
    while isinstance(place, dict | list) and len(place):
        keys = list(place) if isinstance(place, dict) else range(len(place))
        parent, key = place, list(keys)[int(rng.integers(len(keys)))]
        place = parent[key]
        if rng.random() < 0.3:
            break
    values = [None, True, [], {}, "text", "\x1b[1m", [[1]], *map(float, NUMBERS), 10**400, 5, -5]
    match rng.integers(4):
        case 0:
            del parent[key]
        case 1 if isinstance(parent, dict):
            parent["unknown"] = parent.pop(key)
        case _:
            parent[key] = values[int(rng.integers(len(values)))]
    return json.dumps(document).encode()


def mutated_array(array, rng):
    """Return something else than `array`: other values, types, shapes."""
    array = np.array(array)
    match rng.integers(14):
        case 0 | 1 | 2 if array.size and array.dtype.kind in "fiuc":
            changed = array.astype(complex if array.dtype.kind == "c" else float)
            some = rng.random(array.shape) < rng.choice([1e-9, 0.1, 1.0])
            some.flat[int(rng.integers(array.size))] = True
            changed[some] = rng.choice(NUMBERS)
            return changed
        case 3:
            return array.astype(rng.choice(["u1", "f2", ">f8", "f4", "i8", "?", "c16"]))
        case 4:
            return array.T
        case 5:
            return array[..., None]
        case 6:
            return array.ravel()
        case 7:
            return array[:0] if array.ndim else np.array([])
        case 8:
            return array[1:] if array.ndim else array
        case 9:
            return np.concatenate([array, array]) if array.ndim else np.array([array, array])
        case 10:
            return rng.choice(NUMBERS)
        case 11:
            return "text"
        case 12:
            return array + 0.5 if array.dtype.kind in "fiu" else 0.5
    return array[0] if array.ndim and len(array) else np.array(["a", "b"], dtype="S1")


def mutated_hdf5(path, rng):
    """Change one dataset, group, attribute or link of the file `path`."""
    with h5py.File(path, "r+") as file:
        names = []
        file.visit(names.append)
        name = str(rng.choice(names))
        parent, short = file[name].parent, name.rsplit("/", 1)[-1]
        if rng.random() < 0.25:
            return _mutated_attribute(file[str(rng.choice(["/", name]))], rng)
        old = file[name]
        array = old[()] if isinstance(old, h5py.Dataset) else np.zeros(2)
        kind = rng.integers(12)
        if kind == 0:
            file.move(name, f"{name}{rng.choice(['x', '0', chr(27), ' '])}")
            return None
        if kind == 1:
            parent["unknown"] = array
            return None
        del file[name]
        match kind:
            case 2:
                pass
            case 3:
                parent.create_group(short)
            case 4:
                parent[short] = h5py.ExternalLink("/dev/zero", "/x")
            case 5:
                parent[short] = h5py.SoftLink(str(rng.choice(["/none", name, "/"])))
            case 6:
                shape = tuple(rng.choice([HUGE, 1, 10**5], size=max(np.ndim(array), 1)).tolist())
                chunks = (1,) * len(shape) if rng.random() < 0.5 else None
                _huge(parent, short, shape, chunks)
            case 7:
                _elsewhere(parent, short, path, rng)
            case 8:
                parent[short] = np.dtype("f8")
            case 9:
                parent.create_dataset(short, dtype=h5py.ref_dtype, shape=(2,))
            case _:
                changed = mutated_array(array, rng) if array.dtype.kind != "O" else 1.0
                parent[short] = changed
    return None


def _huge(parent, name, shape, chunks):
    packed = {"chunks": chunks, "compression": 1} if chunks else {}
    try:
        parent.create_dataset(name, shape=shape, dtype="f8", **packed)
    except ValueError:  # beyond what HDF5 itself can describe
        parent[name] = np.zeros(0)


def _elsewhere(parent, name, path, rng):
    """Keep the values of a dataset in another file."""
    if rng.random() < 0.5:
        parent.create_dataset(name, shape=(2,), dtype="f8", external=[("/dev/zero", 0, 16)])
    else:
        layout = h5py.VirtualLayout(shape=(2,), dtype="f8")
        layout[:] = h5py.VirtualSource(str(path), "x", shape=(2,))
        parent.create_virtual_dataset(name, layout)


def _mutated_attribute(owner, rng):
    names = list(owner.attrs)
    if not names:
        owner.attrs["note"] = 1.0
        return
    name = str(rng.choice(names))
    value = owner.attrs[name]
    del owner.attrs[name]
    others = ("text", 1.0, [1.0, 2.0], np.nan, -1, 5.9, h5py.Empty("f8"), np.bytes_(b"\xff"), ["a"])
    match rng.integers(4):
        case 0:
            owner.attrs[f"{name}x"] = value
        case 1 | 2:
            owner.attrs[name] = others[int(rng.integers(len(others)))]


def mutated_mat(path, rng):
    """Change one variable of the file `path`."""
    variables = {k: v for k, v in loadmat(path).items() if k[0] != "_"}
    name = str(rng.choice(list(variables)))
    array = variables[name]
    match rng.integers(9):
        case 0:
            del variables[name]
        case 1:
            variables[f"{name}x"] = variables.pop(name)
        case 2:
            cell = np.empty((1, 1), dtype=object)
            cell[0, 0] = array
            variables[name] = cell
        case 3:
            variables[name] = {"field": array}
        case 4:
            variables[name] = eye_array(3).tocsc()
        case 5:
            whole = io.BytesIO()
            savemat(whole, {name: array})
            with path.open("ab") as file:  # the variable twice
                file.write(whole.getvalue()[128:])
            return
        case _:
            variables[name] = mutated_array(array, rng) if array.dtype.kind != "U" else 1.0
    savemat(path, variables, do_compression=bool(rng.integers(2)))


def mutate(path: Path, rng: np.random.Generator) -> None:
    """Make of a sound file a faulty one, by its ending."""
    structured = {
        ".h5": mutated_hdf5,
        ".mat": mutated_mat,
        ".csv": lambda p, r: p.write_bytes(mutated_text(p.read_bytes(), r)),
        ".json": lambda p, r: p.write_bytes(mutated_json(p.read_bytes(), r)),
    }
    if path.suffix in structured and rng.random() < 0.6:
        with warnings.catch_warnings(action="ignore"):  # of numbers on their way to other types
            structured[path.suffix](path, rng)
    else:
        path.write_bytes(mutated_bytes(path.read_bytes(), rng))


def refusals(path: Path, read: Callable[[Path], object], seeds: Iterable[int]) -> dict[int, str]:
    """Read mutants of the sound file `path`; return by seed what was said of those refused.

    A reader may refuse a mutant in a line that names the file, or take it; nothing else.
    """
    sound, said = path.read_bytes(), {}
    read(path)
    for seed in seeds:
        path.write_bytes(sound)
        mutate(path, np.random.default_rng(seed))
        try:
            read(path)
        except InvalidInput as error:
            said[seed] = str(error)
            assert path.name in said[seed], (seed, said[seed])
            assert said[seed].isprintable(), (seed, said[seed])
            assert len(said[seed]) < 1000, (seed, said[seed])
        except BaseException as error:
            raise AssertionError(f"seed {seed}: {error!r}") from error
    path.write_bytes(sound)
    return said


def check_readers(
    path: Path, kinds: Mapping[str, tuple[Any, Any, Any]], seeds: Sequence[int], least: float
) -> None:
    """Refuse mutants of a file in a line or take them; at least that share is refused.

    Kinds are a reader, a writer and what makes the contents, by the name of the file.
    """
    read, write, contents = kinds[path.name]
    write(path, contents())
    assert len(refusals(path, read, seeds)) > least * len(seeds)
