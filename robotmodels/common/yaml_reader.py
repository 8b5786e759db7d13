"""YAML 1.2 by its core schema: text, numbers, truth and null, with the line of every value.

PyYAML parses; what a plain word means is decided here, as PyYAML knows YAML 1.1 only, in which
``0100`` is 64, ``1:40`` is 100 and ``on`` is true.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import yaml

from robotmodels.common.printing import unprintable

MOST_NESTED = 32
"""Lists and mappings within each other."""

MOST_VALUES = 1_000_000
"""Values in a file, those that an alias repeats counted each time."""

_MOST_DIGITS = 400  # of a number; Python takes quadratic time to read more
_PARSER = getattr(
    yaml, "CSafeLoader", yaml.SafeLoader
)  # in C where PyYAML has it: six times faster
_CORE = "tag:yaml.org,2002:"


class YamlError(ValueError):
    """What is wrong in a text, and in which line, counted from 1."""

    def __init__(self, line: int, problem: str) -> None:
        super().__init__(problem)
        self.line = line


@dataclass(slots=True)
class Node:
    """A value, and where it is.

    Attributes
    ----------
    line : int
        Line of its key, or of itself in a list, counted from 1.
    content : Any
        Text, number, truth, None, list, or mapping with text as keys.
    children : dict of str or int to Node
        Children of a list or a mapping, by index or key.
    height : int
        Lists and mappings within each other.
    size : int
        Values in it.
    """

    line: int
    content: Any
    children: "dict[str | int, Node]" = field(default_factory=dict)
    height: int = 0
    size: int = 1

    def line_of(self, keys: tuple[str | int, ...]) -> int | None:
        """Return the line of what lies under `keys`, or of the last of them that is there."""
        node = self
        for key in keys:
            node = node.children.get(key, node)
        return None if node is self else node.line


def read_document(text: str) -> Node:
    """Return the one document in `text`.

    Raises
    ------
    YamlError
        If it is not YAML 1.2, is nested too deeply or too long, gives a key twice, has an alias
        without its anchor or a tag or characters that have no place in these files.
    """
    try:
        return _Document(text).root()
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise YamlError(line, str(error.problem or error.context)) from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise YamlError(line, "it has a control character") from None


def reads_as_text(word: str) -> bool:
    """Whether a word without quotes is the text that it shows, no number and no truth."""
    try:
        return bool(read_document(word).content == word)
    except YamlError:
        return False


class _Document:
    def __init__(self, text: str) -> None:
        self._events: Iterator[yaml.Event] = yaml.parse(text, Loader=_PARSER)
        self._anchors: dict[str, Node] = {}
        self._size = 0

    def root(self) -> Node:
        next(self._events)  # the start of the stream
        start = next(self._events)
        if not isinstance(start, yaml.DocumentStartEvent):
            return Node(1, None)
        if start.version not in (None, (1, 2)):
            raise YamlError(_line(start), f"YAML {'.'.join(map(str, start.version))}, not 1.2")
        node = self._node(next(self._events), 0)
        next(self._events)  # the end of the document
        if not isinstance(more := next(self._events), yaml.StreamEndEvent):
            raise YamlError(_line(more), "a second document begins; a file holds one")
        return node

    def _node(self, event: yaml.Event, depth: int) -> Node:
        if isinstance(event, yaml.AliasEvent):
            # An anchor is there once its value is complete: none can hold itself.
            node = self._anchors.get(str(event.anchor))
            if node is None:
                raise YamlError(_line(event), f"alias *{event.anchor} has no anchor before it")
        elif isinstance(event, yaml.ScalarEvent):
            node = Node(_line(event), _scalar(event))
        else:
            assert isinstance(event, yaml.CollectionStartEvent)
            node = self._collection(event, depth)
        self._size += node.size if isinstance(event, yaml.AliasEvent) else 1
        if depth + node.height > MOST_NESTED:
            raise YamlError(_line(event), f"nested more than {MOST_NESTED} deep")
        if self._size > MOST_VALUES:
            raise YamlError(_line(event), f"more than {MOST_VALUES} values")
        if isinstance(event, yaml.NodeEvent) and event.anchor:
            self._anchors[str(event.anchor)] = node
        return node

    def _collection(self, start: yaml.CollectionStartEvent, depth: int) -> Node:
        if depth >= MOST_NESTED:
            raise YamlError(_line(start), f"nested more than {MOST_NESTED} deep")
        mapping = isinstance(start, yaml.MappingStartEvent)
        if start.tag not in (None, "!", _CORE + ("map" if mapping else "seq")):
            raise YamlError(_line(start), f"tag {start.tag} is not used here")
        node = Node(_line(start), {} if mapping else [])
        while not isinstance(event := next(self._events), yaml.CollectionEndEvent):
            key: str | int = len(node.children)
            line = _line(event)
            if mapping:
                key = self._key(event, node)
                event = next(self._events)
            child = self._node(event, depth + 1)
            if mapping:
                node.children[key] = Node(line, child.content, child.children)
                node.content[key] = child.content
            else:
                node.children[key] = child
                node.content.append(child.content)
            node.height = max(node.height, child.height)
            node.size += child.size
        node.height += 1
        return node

    def _key(self, event: yaml.Event, mapping: Node) -> str:
        """Return a key as it is written: a joint may be called ``on`` or ``0100``."""
        if isinstance(event, yaml.AliasEvent) or not isinstance(event, yaml.ScalarEvent):
            raise YamlError(_line(event), "a key is a list, a mapping or an alias; text is needed")
        _check_text(event)
        if event.value in mapping.children:
            raise YamlError(_line(event), f"key {event.value!r} is given twice")
        return event.value


def _scalar(event: yaml.ScalarEvent) -> Any:
    """Return what a scalar means by the core schema (YAML 1.2.2, section 10.3)."""
    text, tag = event.value, event.tag
    _check_text(event)
    if event.implicit[1] or tag in ("!", _CORE + "str"):
        return text
    if not event.implicit[0] and tag not in _CORE_TAGS:
        raise YamlError(_line(event), f"tag {tag} is not used here")
    for kind, pattern, meaning in _CORE_SCHEMA:
        if (tag is None or tag == kind) and pattern.fullmatch(text):
            if len(text) > _MOST_DIGITS:
                raise YamlError(_line(event), f"a number of {len(text)} characters")
            return meaning(text)
    if tag is not None:
        raise YamlError(_line(event), f"{text[:40]!r} is not what its tag {tag} says")
    return text


def _check_text(event: yaml.ScalarEvent) -> None:
    if character := unprintable(event.value):
        raise YamlError(_line(event), f"it has the character {character}, which is not text")


_CORE_SCHEMA: tuple[tuple[str, re.Pattern[str], Callable[[str], Any]], ...] = (
    (_CORE + "null", re.compile("null|Null|NULL|~|"), lambda _: None),
    (_CORE + "bool", re.compile("true|True|TRUE"), lambda _: True),
    (_CORE + "bool", re.compile("false|False|FALSE"), lambda _: False),
    (_CORE + "int", re.compile("[-+]?[0-9]+"), int),
    (_CORE + "int", re.compile("0o[0-7]+"), lambda text: int(text, 8)),
    (_CORE + "int", re.compile("0x[0-9a-fA-F]+"), lambda text: int(text, 16)),
    (
        _CORE + "float",
        re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?"),
        float,
    ),
    (
        _CORE + "float",
        re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"),
        lambda text: float(text.replace(".", "")),
    ),
)
_CORE_TAGS = tuple(kind for kind, _, _ in _CORE_SCHEMA)


def _line(event: yaml.Event) -> int:
    return event.start_mark.line + 1 if event.start_mark else 1
