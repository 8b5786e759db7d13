"""Reading of XML files: guarded against what no robot needs, a default namespace left out."""

import xml.etree.ElementTree as ET
from pathlib import Path

from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import check_file, reason

MOST_BYTES = 4_000_000
"""Size of a URDF."""

_MOST_NESTED = 32


class _GuardedTree(ET.TreeBuilder):
    """Refuses what no robot needs as soon as it begins, and leaves out the default namespace."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0
        self._default = ""

    def start_ns(self, prefix: str, uri: str) -> None:
        """Note the namespace of names without a prefix: they are a URDF's own."""
        if not prefix:
            self._default = f"{{{uri}}}"

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        """Refuse definitions of entities, which expand without end or name other files."""
        raise InvalidInput("it has a <!DOCTYPE>, which is not read; leave it out")

    def start(self, tag: str, attributes: dict[str, str]) -> ET.Element:
        """Begin an element."""
        self._depth += 1
        if self._depth > _MOST_NESTED:
            raise InvalidInput(f"elements are nested more than {_MOST_NESTED} deep")
        return super().start(self._plain(tag), attributes)

    def end(self, tag: str) -> ET.Element:
        """End an element."""
        self._depth -= 1
        return super().end(self._plain(tag))

    def _plain(self, tag: str) -> str:
        return tag.removeprefix(self._default) if self._default else tag


def read_xml(path: Path, most: int = MOST_BYTES, kind: str = "URDF") -> ET.Element:
    """Return the root of an XML file.

    Parameters
    ----------
    path : Path
        Of the file.
    most : int
        Largest size of the file [bytes].
    kind : str
        What the file is to be, for errors.

    Raises
    ------
    InvalidInput
        If it cannot be read, is not well formed, defines entities or nests too deeply.
    """
    check_file(path, most)
    try:
        return ET.fromstring(path.read_bytes(), parser=ET.XMLParser(target=_GuardedTree()))
    except ET.ParseError as error:
        raise InvalidInput(f"{path}: not a well-formed {kind}: {error}") from None
    except (LookupError, ValueError) as error:
        # Of an encoding that Python does not have, or that is none of text.
        raise InvalidInput(f"{path}: not a well-formed {kind}: {reason(error)}") from None
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be read: {reason(error)}") from None
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from None
