"""Logs opened by the endings of their files, several files as one recording."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import check_file
from robotmodels.common.progress import Progress, StageProgress
from robotmodels.data_files.file_guard import PathLike
from robotmodels.logs.array_log import read_numpy_log
from robotmodels.logs.bag_log import read_bag_log
from robotmodels.logs.hdf5_log import read_hdf5_log
from robotmodels.logs.kuka_trace import is_kuka_trace, read_kuka_trace
from robotmodels.logs.log import Log
from robotmodels.logs.matlab_log import read_matlab_log
from robotmodels.logs.record_formats import read_parquet_log, read_tdms_log
from robotmodels.logs.stamp_pairs import with_joined_stamps
from robotmodels.logs.text_log import read_text_log
from robotmodels.logs.uff_log import read_uff_log

_READERS: dict[str, Callable[[Path, ExitStack], Log]] = {
    ".tdms": read_tdms_log,
    ".mat": read_matlab_log,
    **dict.fromkeys((".h5", ".hdf5", ".hdf"), read_hdf5_log),
    **dict.fromkeys((".npz", ".npy"), read_numpy_log),
    **dict.fromkeys((".uff", ".unv", ".uf"), read_uff_log),
}
_TEXT = (".csv", ".tsv", ".txt", ".log", ".asc", ".dat")
_STREAMS: dict[str, Callable[[Path, ExitStack, Progress | None], Log]] = {
    **dict.fromkeys(_TEXT, read_text_log),
    **dict.fromkeys((".parquet", ".pq"), read_parquet_log),
    **dict.fromkeys((".bag", ".db3", ".mcap"), read_bag_log),
}
"""Formats that are read through once, with progress."""


@contextmanager
def open_log(
    paths: PathLike | Sequence[PathLike], progress: StageProgress | None = None
) -> Iterator[Log]:
    """Open the files of one recording for reading.

    Parameters
    ----------
    paths : path or sequence of paths
        The files; tables of all of them together make the log.
    progress : callable, optional
        Called with stage, what is done and the total.

    Yields
    ------
    Log
        Its channels can be read until the block ends.

    Raises
    ------
    InvalidInput
        If a file is absent, of no format that is read, or damaged.
    """
    several = [paths] if isinstance(paths, str | Path) or hasattr(paths, "__fspath__") else paths
    files = [Path(path) for path in several]
    if not files:
        raise InvalidInput("log: no file named; at least one is needed")
    with ExitStack() as stack:
        logs = [_with_joined_stamps(_read(path, stack, progress)) for path in files]
        yield logs[0] if len(logs) == 1 else _joined(logs)


def _read(path: Path, stack: ExitStack, progress: StageProgress | None) -> Log:
    ending = path.suffix.lower()
    report = None if progress is None else partial(progress, path.name)
    if path.is_dir() and (path / "metadata.yaml").exists():
        return read_bag_log(path, stack, report)
    check_file(path)
    if ending in _READERS:
        return _READERS[ending](path, stack)
    if ending == ".dat" and is_kuka_trace(path):
        return read_kuka_trace(path, stack)
    if ending in _STREAMS:
        return _STREAMS[ending](path, stack, report)
    raise InvalidInput(
        f"{path}: {ending or 'no ending'} is no format that is read; logs end in "
        f"{', '.join((*_STREAMS, *_READERS))}"
    )


def _with_joined_stamps(log: Log) -> Log:
    return replace(log, tables=tuple(map(with_joined_stamps, log.tables)))


def _joined(logs: Sequence[Log]) -> Log:
    """Return one log of all tables, which are named by their files."""
    stems = [log.files[0].stem for log in logs]
    tables = []
    for log, stem in zip(logs, stems, strict=True):
        name = stem if stems.count(stem) == 1 else log.files[0].name
        tables += [replace(t, name=f"{name}.{t.name}".rstrip(".")) for t in log.tables]
    return Log(
        tuple(path for log in logs for path in log.files),
        tuple(tables),
        {name: values for log in logs for name, values in log.constants.items()},
        tuple(note for log in logs for note in log.notes),
    )
