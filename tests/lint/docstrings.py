"""Fail where a docstring's sections do not parse as numpydoc or name what is not there.

Run by `make lint`; imports none of the packages it reads.
"""

import logging
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import griffe

PACKAGES = ("robotmodels", "estimators", "oed", "reports")
ROOT = Path(__file__).parents[2]
NAMED = {"parameters", "other parameters", "attributes"}
LISTED = re.compile(r"^(\w+)(?:, \w+)* : ", re.MULTILINE)
REMARKS = {"note", "notes", "references", "see-also", "warnings"}
# A type is no sentence: `name : the length of it.` has its text in the wrong line.
PROSE = re.compile(r"\b(?:the|a|an|is|are|that|which|whether|as|see)\b|[.;]$")


def faults(folder: Path, packages: tuple[str, ...] = PACKAGES) -> list[str]:
    """Return one line per fault: place and reason."""
    complaints = _Complaints()
    logger = logging.getLogger("griffe")
    logger.addHandler(complaints)
    try:
        for package in packages:
            tree = griffe.load(package, search_paths=[folder], allow_inspection=False)
            for documented in _documented(tree):
                complaints.lines += [f"{documented.path}: {fault}" for fault in _faults(documented)]
    finally:
        logger.removeHandler(complaints)
    return complaints.lines


class _Complaints(logging.Handler):
    """Collects what griffe's parser warns of."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())


def _documented(node: griffe.Object) -> Iterator[griffe.Object]:
    if node.docstring is not None:
        yield node
    for member in node.members.values():
        if not member.is_alias:
            yield from _documented(member)


def _faults(node: griffe.Object) -> Iterator[str]:
    for section in griffe.parse_numpy(node.docstring):
        kind = section.kind.value
        if kind == "text":
            for name in LISTED.findall(section.value):
                if _has(node, name):
                    yield f"{name} is described outside a section"
        if kind == "admonition" and section.value.kind not in REMARKS:
            yield f"{section.title!r} is no section of numpydoc"
        if kind not in NAMED:
            continue
        for item in section.value:
            written = str(item.annotation or "")
            if not item.description.strip():
                yield f"{kind}: {item.name} has no text below its type"
            if PROSE.search(re.sub(r"\{.*\}", "", written)):
                yield f"{kind}: {item.name} has text where its type belongs: {written}"
            if kind == "attributes":
                for name in item.name.split(", "):
                    if not _has(node, name):
                        yield f"attributes: {name} is no attribute"


def _has(node: griffe.Object, name: str) -> bool:
    """Return whether a class, its bases in these packages included, or a function has the name."""
    if isinstance(node, griffe.Function):
        return name in node.parameters
    return name in node.members or name in node.inherited_members


if __name__ == "__main__":
    lines = faults(ROOT)
    print("\n".join(lines), end="\n" if lines else "")
    sys.exit(bool(lines))
