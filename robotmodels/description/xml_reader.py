"""Reading of XML files: guarded against what no robot needs, what is read of them is recorded."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import check_file, reason

MOST_BYTES = 4_000_000
"""Size of a URDF [bytes]."""

_MOST_NESTED = 200


class XmlElement(ET.Element):
    """An element that records which of its attributes were read, and whether its text was."""

    def __init__(self, tag: str, attrib: dict[str, str] | None = None) -> None:
        super().__init__(tag, attrib or {})
        self.attributes_read: set[str] = set()
        self.text_read = False

    def get(self, key: str, default: str | None = None) -> str | None:  # type: ignore[override]
        """Return an attribute."""
        self.attributes_read.add(key)
        return super().get(key, default)

    def read_text(self) -> str:
        """Return the text, without blanks around it."""
        self.text_read = True
        return (self.text or "").strip()

    @property
    def was_read(self) -> bool:
        """Whether an attribute that is there, or the text, was read, here or below."""
        here = self.text_read or not self.attributes_read.isdisjoint(self.keys())
        return here or any(isinstance(child, XmlElement) and child.was_read for child in self)

    def unread(self, path: str = "") -> Iterator[str]:
        """Yield the path of each part below that was not read; this element has `path`.

        An element of which nothing was read is one part, ``link/visual`` say; otherwise each of its
        attributes is, ``joint/limit@effort``, and each of its children.
        """
        if not self.was_read:
            yield path
            return
        yield from (f"{path}@{key}" for key in sorted(set(self.keys()) - self.attributes_read))
        for child in self:
            if isinstance(child, XmlElement):
                yield from child.unread(f"{path}/{child.tag}")


class _GuardedTree(ET.TreeBuilder):
    """Refuses what no robot needs as soon as it begins, and leaves out the default namespace."""

    def __init__(self) -> None:
        super().__init__(element_factory=XmlElement)
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


def read_xml(path: Path, most: int = MOST_BYTES, kind: str = "") -> XmlElement:
    """Return the root of an XML file.

    Parameters
    ----------
    path : Path
        Of the file.
    most : int
        Largest size of the file [bytes].
    kind : str
        What the file is to be, for errors; by default what it looks like.

    Raises
    ------
    InvalidInput
        If it cannot be read, is not well formed, defines entities or nests too deeply.
    """
    check_file(path, most)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be read: {reason(error)}") from None
    return parse_xml(content, path, kind)


def parse_xml(content: bytes | str, path: Path, kind: str = "") -> XmlElement:
    """Return the root of XML text, which errors say is in `path`.

    Raises
    ------
    InvalidInput
        As `read_xml`.
    """
    try:
        root = ET.fromstring(content, parser=ET.XMLParser(target=_GuardedTree()))
    except ET.ParseError as error:
        kind = kind or _apparent_kind(content, path)
        raise InvalidInput(f"{path}: not a well-formed {kind}: {error}") from None
    except (LookupError, ValueError) as error:
        # Of an encoding that Python does not have, or that is none of text.
        kind = kind or _apparent_kind(content, path)
        raise InvalidInput(f"{path}: not a well-formed {kind}: {reason(error)}") from None
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from None
    assert isinstance(root, XmlElement)
    return root


def _apparent_kind(content: bytes | str, path: Path) -> str:
    """Return which kind of model file a text looks like, as far as it goes."""
    text = content if isinstance(content, str) else content.decode(errors="replace")
    if "<mujoco" in text and "<robot" not in text:
        return "MJCF"
    return "xacro file" if path.suffix.lower() == ".xacro" or "<xacro:" in text else "URDF"
