"""Check that names say what they hold: filler words tell how a thing came about, not what it is.

Run by `make lint`; imports none of the packages it reads. A room has as many of them as `ALLOWED`
says, a package for its other rooms; these numbers may only be lowered.
"""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
FILLERS = {
    *("found", "known", "own", "given", "place", "places", "rest", "kept", "wanted"),
    *("chosen", "held", "left", "apart", "said", "sag"),
}
ADVICE = "name the thing, such as estimate, solution, offset, fixed_parameters"
# None is allowed but where they are still being replaced.
ALLOWED = {
    "robotmodels": 0,
    "estimators": 0,
    "oed": 0,
    "reports": 0,
}
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)


def main() -> int:
    """Print what is too much; return 1 if a room has more than it may."""
    failed = False
    for room, most in ALLOWED.items():
        lines = [line for path in _files(room) for line in faults(path, ROOT)]
        if len(lines) > most:
            failed = True
            print("\n".join(lines))
            print(f"{room}: {len(lines)} filler names, {most} are allowed; {ADVICE}")
        elif len(lines) < most:
            print(f"{room}: {len(lines)} filler names; lower its number in ALLOWED to that")
    return failed


def faults(path: Path, root: Path) -> list[str]:
    """Return one line for each filler word that a file gives to something as its name."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names = sorted(set(_names(tree)))
    return [f"{path.relative_to(root)}:{line}: {name!r} says nothing" for line, name in names]


def _files(room: str) -> list[Path]:
    """Return the files of a room, or of a package those of no room with a number of its own."""
    others = [ROOT / each for each in ALLOWED if each.startswith(f"{room}/")]
    paths = sorted((ROOT / room).rglob("*.py"))
    return [path for path in paths if not any(other in path.parents for other in others)]


def _names(node: ast.AST, paired: bool = False) -> Iterator[tuple[int, str]]:
    """Yield line and name of filler words; `left` beside `right` is a side, not a remainder."""
    for child in ast.iter_child_nodes(node):
        inside = _has_right(child) if isinstance(child, FUNCTIONS) else paired
        for name in _given_names(child):
            word = name.strip("_").lower()
            if word in FILLERS and not (word == "left" and inside):
                yield child.lineno, name
        yield from _names(child, inside)


def _given_names(node: ast.AST) -> list[str]:
    """Return the names that a node gives to something; uses of a name follow from them."""
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
        return [node.name]
    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
        return [node.id]
    if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
        return [node.attr]
    if isinstance(node, ast.arg):
        return [node.arg]
    if isinstance(node, ast.ExceptHandler) and node.name:
        return [node.name]
    return []


def _has_right(function: ast.AST) -> bool:
    return any("right" in _given_names(node) for node in ast.walk(function))


if __name__ == "__main__":
    sys.exit(main())
