"""Files of a robot's bodies and joints: URDF as it is, xacro and MJCF turned into it."""

import os
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from robotmodels.common.errors import InvalidInput
from robotmodels.common.fingerprints import file_digest, json_digest
from robotmodels.description.xml_reader import XmlElement, parse_xml, read_xml


@dataclass(frozen=True)
class ModelFile:
    """A URDF, xacro or MJCF file, and how macros in it are expanded.

    Attributes
    ----------
    path : Path
        Path of the file.
    arguments : tuple of (str, str)
        Names and values of xacro arguments.
    packages : tuple of Path
        Folders in which the packages of ``$(find NAME)`` are sought.
    """

    path: Path
    arguments: tuple[tuple[str, str], ...] = ()
    packages: tuple[Path, ...] = ()


ModelSource = Path | ModelFile
"""The path of a file stands for it without arguments."""

_ELSEWHERE = {
    ".sdf": "convert it to MJCF first (sdformat2mjcf of the package sdformat-mjcf)",
    ".world": "convert its robot to MJCF first (sdformat2mjcf of the package sdformat-mjcf)",
    **dict.fromkeys(
        (".usd", ".usda", ".usdc", ".usdz"),
        "convert it to a URDF first (usd_to_urdf of the package nvidia-srl-usd-to-urdf)",
    ),
}
"""Ways round formats that no library at hand reads."""


def path_of(source: ModelSource) -> Path:
    """Return the path of a model file."""
    return source.path if isinstance(source, ModelFile) else source


def read_model(source: ModelSource) -> XmlElement:
    """Return the ``<robot>`` of a URDF, or the one that a xacro or MJCF file amounts to.

    Raises
    ------
    InvalidInput
        Naming the file and what of it cannot be used.
    """
    model = source if isinstance(source, ModelFile) else ModelFile(source)
    refuse_other_formats(model.path)
    root = read_xml(model.path)
    if root.tag == "mujoco":
        _refuse_arguments(model, "an MJCF")
        return parse_xml(_as_urdf(model, _converted), model.path)
    if root.tag == "sdf":
        raise InvalidInput(f"{model.path}: SDF is not read; {_ELSEWHERE['.sdf']}")
    if root.tag != "robot":
        raise InvalidInput(
            f"{model.path}: not a URDF: its root is <{root.tag}>, not <robot> (nor <mujoco>)"
        )
    if has_macros(root) or model.path.suffix.lower() == ".xacro":
        return parse_xml(_as_urdf(model, _expanded), model.path)
    _refuse_arguments(model, "a URDF without macros")
    return root


def is_plain_urdf(source: ModelSource) -> bool:
    """Whether a model file is a URDF as it is."""
    path = path_of(source)
    root = read_xml(path)
    return root.tag == "robot" and not has_macros(root) and path.suffix.lower() != ".xacro"


def files_of(model: ModelFile) -> set[Path]:
    """Return a model file and those that it includes, as far as they are part of its URDF."""
    read_model(model)
    stamps, _ = _remembered.get(model, ({}, ""))
    return {model.path, *stamps}


def gravity_of(source: ModelSource) -> tuple[float, float, float]:
    """Return gravity in a model file [m/s^2]; that of the earth where it says nothing."""
    words = read_model(source).attrib.get("gravity", "0 0 -9.81").split()
    x, y, z = (float(word) for word in words)
    return x, y, z


def model_digest(source: ModelFile) -> str:
    """Return the SHA-256 of a URDF, or of the URDF that a xacro or MJCF file amounts to."""
    if is_plain_urdf(source):
        return file_digest(source.path)
    text = ET.tostring(read_model(source), encoding="unicode")
    return json_digest(text)


def is_mjcf(source: ModelSource) -> bool:
    """Whether a model file is an MJCF."""
    return read_xml(path_of(source)).tag == "mujoco"


def refuse_other_formats(path: Path) -> None:
    """Refuse formats that are not read, by the ending of the file.

    Raises
    ------
    InvalidInput
        Naming the way round.
    """
    ending = path.suffix.lower()
    if ending in _ELSEWHERE:
        raise InvalidInput(f"{path}: {ending[1:].upper()} is not read; {_ELSEWHERE[ending]}")


def has_macros(root: XmlElement) -> bool:
    """Whether an element of a file is one of xacro's."""
    return any("xacro" in element.tag for element in root.iter() if isinstance(element.tag, str))


def _refuse_arguments(model: ModelFile, kind: str) -> None:
    if model.arguments or model.packages:
        raise InvalidInput(f"{model.path}: is {kind}; 'xacro' and its arguments do not apply")


_Stamps = dict[Path, tuple[int, int] | None]

_MOST_REMEMBERED = 8
_remembered: dict[ModelFile, tuple[_Stamps, str]] = {}


def _stamp(path: Path) -> tuple[int, int] | None:
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size


def _as_urdf(model: ModelFile, convert: Callable[[ModelFile], tuple[str, set[Path]]]) -> str:
    """Return the URDF that a file is converted to, anew where it or a file it includes changed."""
    if model in _remembered:
        stamps, text = _remembered[model]
        if all(_stamp(path) == stamp for path, stamp in stamps.items()):
            return text
    text, files = convert(model)
    _remembered.pop(model, None)
    _remembered[model] = {path: _stamp(path) for path in files}, text
    if len(_remembered) > _MOST_REMEMBERED:
        _remembered.pop(next(iter(_remembered)))
    return text


def _expanded(model: ModelFile) -> tuple[str, set[Path]]:
    from robotmodels.description.xacro_file import expand_xacro

    return expand_xacro(model.path, dict(model.arguments), model.packages)


def _converted(model: ModelFile) -> tuple[str, set[Path]]:
    from robotmodels.description.mjcf_file import files_of_mjcf, urdf_of_mjcf

    return urdf_of_mjcf(model.path), set(files_of_mjcf(model.path))
