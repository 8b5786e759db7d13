"""Check that no long function grows, and that the packages stay as small as they are.

    python tests/lint/statements.py [--write]

Statements are counted without docstrings. A function of more than `LONG` statements may have as
many as `statements.json` says, the four packages together as many statements and files as it says.
``--write`` takes what is smaller now; what grew has to be written there by hand, with its reason in
the commit.
"""

import ast
import json
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("robotmodels", "estimators", "oed", "reports")
LIMITS = Path(__file__).with_suffix(".json")
LONG = 20
DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def main() -> int:
    """Compare with the limits; return 1 if one is exceeded."""
    limits = json.loads(LIMITS.read_text())
    functions, total, files = counts(ROOT)
    failures = exceeded(limits, functions, total, files)
    if "--write" in sys.argv and not failures:
        LIMITS.write_text(json.dumps(document(functions, total, files), indent=1) + "\n")
    print("\n".join(failures) or f"{total} statements in {files} files, no function grew")
    return bool(failures)


def counts(root: Path) -> tuple[dict[str, int], int, int]:
    """Return statements per function, by file and qualified name; of all; and the files."""
    functions: dict[str, int] = {}
    paths = sorted(path for package in PACKAGES for path in (root / package).rglob("*.py"))
    total = 0
    for path in paths:
        tree = ast.parse(path.read_text())
        total += statements(tree)
        for name, node in _definitions(tree):
            functions[f"{path.relative_to(root)}:{name}"] = statements(node)
    return functions, total, len(paths)


def statements(node: ast.AST) -> int:
    """Return the number of statements in a node, nested ones included, docstrings not."""
    inner = [each for each in ast.walk(node) if each is not node]
    return sum(isinstance(each, ast.stmt) and not _is_text(each) for each in inner)


def exceeded(
    limits: dict[str, object], functions: dict[str, int], total: int, files: int
) -> list[str]:
    """Return a line for each limit that is exceeded."""
    allowed = limits["functions"]
    lines = [
        f"{name}: {count} statements, {allowed.get(name, LONG)} are allowed; split it by subject"
        for name, count in functions.items()
        if count > allowed.get(name, LONG)
    ]
    for what, count in (("statements", total), ("files", files)):
        if count > limits[what]:
            lines.append(
                f"the packages have {count} {what}, {limits[what]} are allowed; look for the "
                f"simpler design, or raise the limit in {LIMITS.name} and say why"
            )
    return lines


def document(functions: dict[str, int], total: int, files: int) -> dict[str, object]:
    """Return the limits that the present counts make."""
    long = {name: count for name, count in functions.items() if count > LONG}
    return {"statements": total, "files": files, "functions": long}


def _definitions(tree: ast.AST, prefix: str = "") -> Iterator[tuple[str, ast.AST]]:
    for node in ast.iter_child_nodes(tree):
        inner = prefix
        if isinstance(node, (*DEFINITIONS, ast.ClassDef)):
            inner = f"{prefix}{node.name}."
        if isinstance(node, DEFINITIONS):
            yield inner.removesuffix("."), node
        yield from _definitions(node, inner)


def _is_text(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


if __name__ == "__main__":
    sys.exit(main())
