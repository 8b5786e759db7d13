"""xacro files expanded, by xacrodoc: without ROS, packages sought in folders."""

import contextlib
import io
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from pathlib import Path

from robotmodels.common.errors import InvalidInput, check_word
from robotmodels.common.extras import install
from robotmodels.common.printing import printable

_MOST_PACKAGES = 100
"""That one file may need."""


def expand_xacro(
    path: Path, arguments: dict[str, str], folders: Sequence[Path]
) -> tuple[str, set[Path]]:
    """Return the URDF that a xacro file with these arguments stands for, and the files read.

    A package NAME is a folder of that name, or with a ``package.xml`` of that name, in one of
    `folders`, or at or beside a folder above the file; else ROS is asked, where it is installed.

    Raises
    ------
    InvalidInput
        If xacrodoc is not installed, a package is not there, or the macros are at fault.
    """
    try:
        import xacrodoc
        from xacrodoc import packages
    except ImportError:
        raise InvalidInput(
            f"{path}: xacro macros need xacrodoc, which is not installed; run: {install('xacro')}"
        ) from None
    packages.reset()
    packages.update_package_cache(_packages_in(path, folders))
    for _ in range(_MOST_PACKAGES):
        try:
            # Of an included file the folder is known, from which its own includes start.
            with contextlib.redirect_stderr(io.StringIO()):
                document = xacrodoc.XacroDoc.from_includes(
                    [str(path)], subargs=dict(arguments), resolve_packages=False
                )
        except Exception as error:  # whatever expressions in macros raise
            name = _missing_package(error, packages.PackageNotFoundError)
            if name is None:
                raise InvalidInput(f"{path}: {_cause(error, path, arguments)}") from None
            packages.update_package_cache({name: _package_above(path, name, folders)})
        else:
            files = _included(path)
            _check_arguments(path, files, arguments)
            return str(document.dom.toxml()), files
    raise InvalidInput(f"{path}: needs more than {_MOST_PACKAGES} packages")


def _included(path: Path) -> set[Path]:
    """Return the file that xacro read last, and all that it includes or loads."""
    import xacro

    return {path, *(file for file in map(Path, xacro.all_includes) if file.is_file())}


def _check_arguments(path: Path, files: set[Path], arguments: dict[str, str]) -> None:
    """Refuse arguments that neither the file nor one it includes declares; xacro takes any."""
    declared = sorted({name for text in _texts(files) for name in _ARGUMENT.findall(text)})
    for name in arguments:
        check_word(f"{path}:", name, declared, "is not an argument of its macros")


_ARGUMENT = re.compile(r"""<xacro:arg\b[^>]*\bname\s*=\s*["']([^"']+)["'][^>]*""")


def _cause(error: Exception, path: Path, arguments: dict[str, str]) -> str:
    """Return why macros cannot be expanded."""
    cause = printable(" ".join(str(error).split()) or type(error).__name__)
    undeclared = re.search(r"[Uu]ndefined substitution argument '?(\w+)", cause)
    names = [undeclared[1]] if undeclared else []
    if "missing attribute 'default'" in cause:
        declared = [m for text in _texts(_included(path)) for m in _ARGUMENT.finditer(text)]
        names = [m[1] for m in declared if "default" not in m[0] and m[1] not in arguments]
    if not names:
        return f"its macros cannot be expanded: {cause}"
    options = " ".join(f"--argument {name}=VALUE" for name in names)
    return (
        f"{', '.join(map(repr, names))} has no value: {options}, or under 'xacro: arguments' in a "
        "robot file"
    )


def _texts(files: set[Path]) -> list[str]:
    return [file.read_text(encoding="utf-8", errors="replace") for file in files]


def _missing_package(error: BaseException | None, kind: type[Exception]) -> str | None:
    """Return the package that an error, or one that led to it, is about."""
    while error is not None:
        if isinstance(error, kind):
            return str(error.args[0])
        error = getattr(error, "exc", None) or error.__cause__ or error.__context__
    return None


def _packages_in(path: Path, folders: Sequence[Path]) -> dict[str, Path]:
    """Return the packages in `folders` by name, those of the first folder before others."""
    for folder in folders:
        if not folder.is_dir():
            raise InvalidInput(f"{path}: packages: {folder}: no such folder")
    inside = (p for folder in reversed(folders) for p in (folder, *_folders_in(folder)))
    return {name: p for p in inside for name in (p.name, _package_name(p)) if name}


def _package_above(path: Path, name: str, folders: Sequence[Path]) -> Path:
    """Return the folder of a package that a folder above the file is or has beside it."""
    for parent in path.resolve().parents:
        if _package_name(parent) == name or parent.name == name:
            return parent
        if (parent / name).is_dir():
            return parent / name
    sought = ", ".join(map(str, folders)) or "none"
    raise InvalidInput(
        f"{path}: needs the package {name!r}, which is neither around the file nor in a folder "
        f"given (packages: {sought}); get it and name the folder it lies in: --packages FOLDER, or "
        "under 'xacro: packages' in a robot file"
    )


def _folders_in(folder: Path) -> Iterator[Path]:
    yield from sorted(p for p in folder.iterdir() if p.is_dir())


def _package_name(folder: Path) -> str | None:
    """Return the name in the ``package.xml`` of a folder, if there is one."""
    try:
        return (ET.parse(folder / "package.xml").getroot().findtext("name") or "").strip()
    except (OSError, ET.ParseError):
        return None
