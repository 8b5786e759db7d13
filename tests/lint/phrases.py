"""Check that pages, terminal, help, errors and documentation use the field's terms.

Run by `make lint`. Reads the string constants of the packages, the templates of pages and the
documentation; a phrase of `PHRASES` in one of them fails, with the term to use instead. Docstrings
of public names begin with the name of the thing.
"""

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PHRASES = {
    r"\bcomes? out (as|with)\b": "identified, estimated",
    r"\brivals?\b": "alternatives",
    r"\bat will\b": "continuous (relaxed) design",
    r"\b(is|are|be) worth\b": "relative efficiency",
    r"\bcarry weight|carries weight\b": "non-zero weight",
    r"\bequilibri(a|um) held\b": "equilibrium fixed",
    r"\bfewest effective draws\b": "minimum ESS",
    r"\bin the way\b": "reason for rejection",
    r"\bthe ways between\b": "paths",
    r"\bnoise alone\b|\bchance gives\b|\bnoise makes\b": "p-value, expectation",
    r"\btorques are held\b|\btorques held\b": "zero-order hold",
    r"\bfor want of\b": "out of",
    r"\bgives? way\b": "deflects",
    r"\bgoes on from\b": "continues",
    r"\bask for less\b": "relax",
    r"\b(tell|told) apart\b": "distinguish",
    r"\bbeats?\b|\bbeaten\b": "is better than",
    r"\bpromis(e|es|ed)\b": "predicted, expected",
    r"\bhardly (tells?|told|felt|feels?)\b": "hardly determined, weakly excited",
    r"\b(would|do|does|data) not tell\b": "not determine, not identify",
    r"\btells? the (time|payload)\b": "shows, has",
    r"\bis due\b|\bwill do\b": "is needed",
    r"\bborrows? from\b": "uses too",
    r"\bthe motor feels\b": "the motor's FRF has",
    r"\bare sure of\b|\bis sure of\b": "standard deviations",
    r"\bonce for each\b|\bseveral times for several\b": "repeatable",
    r"\bSo many\b|\bso many (simulations|plans)\b": "Number of",
    r"\bmore certain\b|\bmost certain\b": "more precise, most precise",
    r"\bswings on\b": "becomes unstable",
    r"\b(against|with) the clock,": "counter-clockwise, clockwise",
    r"\bfrom standstill\b": "from zero frequency, from rest",
    r"\bsqueezed\b": "compressed",
    r"\bBeside (them|it)\b": "ratio, for comparison",
    r"\bdeclared noise\b": "stated noise",
    r"\bknown to (\{|\d)": "determined to within",
    r"\bone behind the other\b": "coinciding in this projection, consecutive",
    r"\bthe (stronger|darker|farther|further)\b.* the\b": "deeper colours for larger values",
    r"\bnormal law\b|\bLaw of another\b": "normal distribution, distribution",
    r"\bfall of the (fit's )?cost\b": "decrease in cost",
    r"\b(leaves?|left) open\b": "remaining uncertainty",
    r"\btips? .*over\b": "is unstable under gravity",
    r"\bWho has\b|\bit was to\b": "If you have",
    r"\bum/N\b": "µm/N",
}
FIRST = re.compile(r"(How|What|When|Which)\b")
"""How no docstring of a public name begins: it names the thing."""


def main() -> int:
    """Print each phrase with its term; return 1 if there is one."""
    lines = list(faults(ROOT))
    print("\n".join(lines) or "no phrase that is none of the field's")
    return bool(lines)


def faults(root: Path) -> Iterator[str]:
    """Yield a line for each phrase."""
    for pattern in ("reports/templates/*.j2", "docs/**/*.md", "*.md", "studies/*.yaml"):
        for path in sorted(set(root.glob(pattern)) - {root / "CHANGELOG.md"}):
            for line, text in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
                yield from _in_text(path.relative_to(root), line, text)
    for package in ("robotmodels", "estimators", "oed", "reports"):
        public = _public(root / package)
        for path in sorted((root / package).rglob("*.py")):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            yield from _unnamed(path.relative_to(root), tree, public)
            for line, text in _texts(tree):  # which removes docstrings
                yield from _in_text(path.relative_to(root), line, text)


def _public(package: Path) -> set[str]:
    """Return the public names of a package."""
    stub = package / "__init__.pyi"
    return set(re.findall(r" as (\w+)", stub.read_text("utf-8"))) if stub.exists() else set()


def _unnamed(path: Path, tree: ast.AST, public: set[str]) -> Iterator[str]:
    """Yield a line for each docstring of a public name that does not name the thing."""
    for node in ast.walk(tree):
        named = isinstance(node, (ast.ClassDef, ast.FunctionDef)) and node.name in public
        if named and FIRST.match(first := ast.get_docstring(node) or ""):
            yield f"{path}:{node.lineno}: {first.splitlines()[0]!r}; name the thing"


def _in_text(path: Path, line: int, text: str) -> Iterator[str]:
    shown = re.sub(r"\{\{.*?\}\}|\{%.*?%\}|`[^`\n]*`", "", text)
    for phrase, term in PHRASES.items():
        if match := re.search(phrase, shown):
            yield f"{path}:{line}: {match[0]!r}; the field says: {term}"


def _texts(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield strings that may be printed: no docstrings but those of commands, which help shows."""
    for node in ast.walk(tree):
        is_docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if is_docstring and "Example: oed" not in str(node.value.value):
            node.value.value = ""
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield node.lineno, node.value


if __name__ == "__main__":
    sys.exit(main())
