"""Mutations of a file's letters, bytes and kind, and of the arrays in HDF5, .mat and .npy files."""

import io
import re
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np
import tokens
from scipy.io import loadmat, savemat


def text(content: bytes, rng: Random) -> bytes:
    """Change lines, words and numbers of a text."""
    lines = content.decode("utf-8", "surrogateescape").split("\n")
    at = rng.randrange(len(lines))
    kind = rng.randrange(12)
    if kind < 4:
        lines[at] = _other_number(lines[at], rng)
    elif kind == 4:
        del lines[at]
    elif kind == 5:
        lines.insert(at, rng.choice(lines))
    elif kind == 6:
        other = rng.randrange(len(lines))
        lines[at], lines[other] = lines[other], lines[at]
    elif kind == 7:
        lines[at] = " " * rng.choice([1, 2, 4]) + lines[at]
    elif kind == 8:
        cut = rng.randrange(len(lines[at]) + 1)
        new = rng.choice([tokens.word(rng), rng.choice(tokens.RAW), "\t", ",", "#", ":", '"'])
        lines[at] = lines[at][:cut] + new + lines[at][cut + rng.choice([0, 1, 3]) :]
    elif kind == 9:
        lines = lines[:at]
    elif kind == 10:
        lines[at : at + 1] = lines[at : at + 1] * rng.choice([2, 3, 50])
    else:
        return _otherwise_encoded("\n".join(lines), rng)
    return "\n".join(lines).encode("utf-8", "surrogateescape")


def _other_number(line: str, rng: Random) -> str:
    numbers = list(re.finditer(r"-?\d[\d.e+-]*", line))
    if not numbers:
        return line + tokens.word(rng)
    chosen = rng.choice(numbers)
    new = tokens.number(rng) if rng.randrange(5) else tokens.word(rng)
    return line[: chosen.start()] + new + line[chosen.end() :]


def _otherwise_encoded(content: str, rng: Random) -> bytes:
    encoding = rng.choice(["utf-16", "utf-32", "utf-8-sig", "latin-1", "crlf", "cr"])
    if encoding in ("crlf", "cr"):
        ending = {"crlf": "\r\n", "cr": "\r"}[encoding]
        return content.replace("\n", ending).encode("utf-8", "surrogateescape")
    return content.encode(encoding, "replace") + (b"\xff\xe9" if encoding == "latin-1" else b"")


def flipped(content: bytes, rng: Random) -> bytes:
    """Change bytes, or cut them off."""
    data = bytearray(content)
    kind = rng.randrange(8)
    at = rng.randrange(max(len(data), 1))
    if kind < 3:
        for _ in range(rng.choice([1, 1, 4, 32])):
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    elif kind == 3:
        del data[at:]
    elif kind == 4:
        del data[at : at + rng.choice([1, 8, 500])]
    elif kind == 5:
        data[at : at + 64] = bytes(len(data[at : at + 64]))
    elif kind == 6:
        data[at:at] = bytes(rng.randrange(256) for _ in range(rng.choice([1, 16])))
    else:
        data = bytearray(rng.choice([b"", b"\0", b"\x89HDF\r\n\x1a\n", data * 2, data[::-1]]))
    return bytes(data)


Arrays = dict[str, Any]


def mat(content: bytes, rng: Random) -> bytes:
    """Change variables of a MATLAB file."""
    arrays = {k: v for k, v in loadmat(io.BytesIO(content)).items() if not k.startswith("__")}
    for _ in range(rng.choice([1, 1, 2])):
        _change_variable(arrays, rng)
    file = io.BytesIO()
    savemat(file, arrays, do_compression=bool(rng.randrange(2)))
    return file.getvalue()


def _change_variable(arrays: Arrays, rng: Random) -> None:
    name = rng.choice(sorted(arrays))
    kind = rng.randrange(6)
    if kind == 0:
        del arrays[name]
    elif kind == 1:
        arrays[rng.choice([f"{name}s", "x", name.upper()])] = arrays.pop(name)
    elif kind == 2:
        cell = np.empty((1, rng.choice([0, 1, 2])), dtype=object)
        for i in range(cell.size):
            cell[0, i] = arrays[name] if rng.randrange(2) else "text"
        arrays[name] = rng.choice([cell, {"field": arrays[name]}, "text", [[1, 2], [3, 4]]])
    else:
        arrays[name] = other_array(np.asarray(arrays[name]), rng)


def npy(content: bytes, rng: Random) -> bytes:
    """Change a NumPy array file."""
    array = other_array(np.load(io.BytesIO(content)), rng)
    file = io.BytesIO()
    np.save(file, array.astype(object) if not rng.randrange(10) else array)
    return file.getvalue()


def other_array(array: Any, rng: Random) -> Any:
    """Return an array of other values, another shape or another kind."""
    if array.dtype.kind not in "fciub" or not rng.randrange(3):
        return _other_kind(array, rng)
    if not rng.randrange(3):
        return _other_shape(array, rng)
    return _other_values(array, rng)


def _other_values(array: Any, rng: Random) -> Any:
    changed = np.array(array, dtype=complex if array.dtype.kind == "c" else float)
    value = rng.choice([0, -1, 1, 0.5, 1e-300, 1e300, -1e300, 1e9, np.nan, np.inf, -np.inf, 5.9])
    kind = rng.randrange(5)
    if kind == 0:
        changed[...] = value
    elif kind == 1:
        changed *= rng.choice([-1, 0, 1e-200, 1e200, 1e12, 1e-12, 1.5])
    elif kind == 2 and array.ndim:
        changed = np.roll(changed, 1, axis=rng.randrange(array.ndim))
    elif kind == 3 and array.ndim:
        changed = np.flip(changed, axis=rng.randrange(array.ndim))
    elif changed.size:
        changed.flat[rng.randrange(changed.size)] = value
    return changed if rng.randrange(3) else _cast(changed, array.dtype)


def _cast(array: Any, kind: Any) -> Any:
    with np.errstate(all="ignore"):
        return array.astype(kind)


def _other_shape(array: Any, rng: Random) -> Any:
    axis = rng.randrange(array.ndim) if array.ndim else 0
    changes: list[Callable[[], Any]] = [
        lambda: array[None],
        lambda: array.ravel(),
        lambda: array.ravel()[:1],
        lambda: array.ravel()[0] if array.size else array,
        lambda: array.T,
        lambda: np.zeros((0,) * array.ndim),
        lambda: np.zeros((0, *array.shape[1:])),
        lambda: np.repeat(array, 2, axis=axis) if array.ndim else array,
        lambda: np.take(array, range(max(array.shape[axis] - 1, 0)), axis) if array.ndim else array,
        lambda: np.concatenate([array, array[..., :1]], axis=-1) if array.ndim else array,
        lambda: np.moveaxis(array, axis, 0) if array.ndim else array,
    ]
    return rng.choice(changes)()


def _other_kind(array: Any, rng: Random) -> Any:
    numbers = array if array.dtype.kind in "fiub" else np.ones(array.shape)
    kinds: list[Callable[[], Any]] = [
        lambda: _cast(numbers, np.int64),
        lambda: _cast(numbers, np.int8),
        lambda: _cast(numbers, np.uint64),
        lambda: _cast(numbers, np.float32),
        lambda: numbers + 0.5j,
        lambda: numbers != 0,
        lambda: np.full(array.shape, b"text"),
        lambda: np.full(array.shape, b"1.5"),
        lambda: np.zeros(array.shape, dtype=[("a", float), ("b", int)]),
    ]
    return rng.choice(kinds)()


def hdf5(content: bytes, rng: Random) -> bytes:
    """Change groups, datasets, links and attributes of an HDF5 file."""
    memory = io.BytesIO(content)
    with h5py.File(memory, "r+") as file:
        for _ in range(rng.choice([1, 1, 2])):
            _change_hdf5(file, rng)
    return memory.getvalue()


def _change_hdf5(file: Any, rng: Random) -> None:
    names: list[str] = []
    file.visit(names.append)
    name = rng.choice(sorted(names) or ["/"])
    kind = rng.randrange(12)
    item = file[name]
    if file.attrs and not rng.randrange(4):
        _change_attribute(file, rng)
    elif kind == 0 and item.attrs:
        _change_attribute(item, rng)
    elif kind == 1:
        del file[name]
    elif kind == 2:
        file.move(name, rng.choice([f"{name}_", f"new/{name}"]))
    elif kind == 3:
        del file[name]
        file[name] = rng.choice(
            [
                h5py.SoftLink("/nowhere"),
                h5py.SoftLink(f"/{name}"),
                h5py.ExternalLink("other.h5", "/"),
                h5py.ExternalLink("/etc/passwd", "/"),
                h5py.ExternalLink("absent.h5", "/x"),
            ]
        )
    elif kind == 4:
        del file[name]
        file.create_group(name)
    elif kind == 5 and isinstance(item, h5py.Dataset):
        _huge(file, name, item, rng)
    elif kind == 6 and isinstance(item, h5py.Dataset):
        del file[name]
        file[name] = rng.choice(["text", b"\xff", h5py.Empty("f8"), np.array([], dtype="S1"), 5])
    elif isinstance(item, h5py.Dataset) and item.size and item.size > 10**7:
        pass  # an earlier change made it too large to read
    elif isinstance(item, h5py.Dataset) and item.shape is not None and item.dtype.kind != "O":
        changed = other_array(item[()] if item.shape else np.asarray(item[()]), rng)
        del file[name]
        file[name] = changed
    elif isinstance(item, h5py.Dataset):
        _change_words(file, name, item, rng)
    else:
        file.require_group(f"{name}/{rng.choice(['x', 'position_00002', 'torque'])}s")


def _change_words(file: Any, name: str, item: Any, rng: Random) -> None:
    """Change text in a dataset, JSON in the stages' files."""
    new = rng.choice(["", "{}", "null", "[1]", "{", '{"a": NaN}', "[" * 100_000, tokens.word(rng)])
    words = item[()] if item.shape is not None else b""
    if isinstance(words, bytes) and rng.randrange(3):
        new = text(words or b"x", rng).decode("utf-8", "replace")
    del file[name]
    file[name] = new.replace("\x00", "").encode("utf-8", "replace").decode()


def _huge(file: Any, name: str, item: Any, rng: Random) -> None:
    """Replace a dataset by one too large for any memory, of which nothing is stored."""
    shape = [max(n, 1) for n in item.shape or (1,)] or [1]
    shape[rng.randrange(len(shape))] = rng.choice([10**9, 10**11, 10**14])
    kind = item.dtype if item.dtype.kind in "fciu" else np.dtype(float)
    del file[name]
    file.create_dataset(name, shape=shape, dtype=kind, chunks=tuple(min(n, 1000) for n in shape))


def _change_attribute(owner: Any, rng: Random) -> None:
    name = rng.choice(sorted(owner.attrs))
    kind = rng.randrange(4)
    if kind == 0:
        del owner.attrs[name]
        return
    values = [0, -1.0, np.nan, np.inf, 1e300, "", "records/2", "0.01", b"\xff", [1.0, 2.0], [[1]]]
    values += [h5py.Empty("f8"), np.array([], dtype=float), 1j, True, np.array(["a", "b"], "S1")]
    owner.attrs[name] = rng.choice(values)


def another_kind(path: Path, rng: Random) -> None:
    """Put something that is not a regular file, or other content, in the place of a file."""
    import os

    kind = rng.randrange(6)
    content = path.read_bytes()
    path.unlink()
    if kind == 0:
        path.mkdir()
    elif kind == 1:
        path.symlink_to("nowhere")
    elif kind == 2:
        path.symlink_to(path.name)
    elif kind == 3:
        os.mkfifo(path)
    elif kind == 4:
        path.symlink_to(rng.choice(["/dev/zero", "/dev/null", "/etc/passwd", "."]))
    else:
        path.write_bytes(
            rng.choice([b"", b"\n", b"\x89HDF\r\n\x1a\n" + content, b"PK\3\4", b"<robot/>"])
        )
