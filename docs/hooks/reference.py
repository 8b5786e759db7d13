"""MkDocs hook: where a page has ``::: room PACKAGE.ROOM``, all public names of the room.

The names are those of the package's ``__init__.pyi``, in its order: none is left out.
"""

import ast
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
_ROOM = re.compile(r"^::: room (\w+)\.(\w+)$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Put the public names in the place of their room."""
    return _ROOM.sub(lambda room: _documented(room[1], room[2]), markdown)


def _documented(package: str, room: str) -> str:
    return "\n\n".join(f"::: {package}.{name}" for name in public_names(package)[room])


def public_names(package: str) -> dict[str, list[str]]:
    """Return the public names of a package by room."""
    rooms: dict[str, list[str]] = {}
    for node in ast.parse((ROOT / package / "__init__.pyi").read_text()).body:
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [alias.asname or alias.name for alias in node.names]
            rooms.setdefault(node.module.split(".")[0], []).extend(names)
    return rooms
