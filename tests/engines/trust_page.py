"""The page of the documentation that states what the simulated studies show."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from trust_cells import BLOCKS, GROUPS, SYSTEMS, Cell

BEGIN, END = "<!-- figures: begin -->", "<!-- figures: end -->"


def write_page(path: Path, document: dict[str, Any]) -> None:
    """Put the figures between the page's marks; the words around them stay."""
    page = path.read_text(encoding="utf-8") if path.exists() else f"{BEGIN}\n{END}\n"
    figures = f"{BEGIN}\n\n{_figures(document)}\n{END}"
    # The figures are no template: backslashes in them stay what they are.
    path.write_text(
        re.sub(f"{BEGIN}.*{END}", lambda _: figures, page, flags=re.DOTALL), encoding="utf-8"
    )


def _figures(document: dict[str, Any]) -> str:
    results = {r["cell"]: r for r in document["cells"]}
    cells = {group: [c for c in listed() if c.name in results] for group, listed in GROUPS.items()}
    short = [r for r in document["cells"] if r["failures"]]
    parts = [
        f"{len(results)} cells of {document['runs']} studies or more, "
        f"{document['minutes']:.0f} minutes on two cores.\n",
        f"### What falls short\n\n{len(short)} of {len(results)} cells.\n",
        _table(
            ("kind", "cell", "studies", "falls short"),
            [(r["group"], r["cell"], r["runs"], "; ".join(r["failures"])) for r in short],
        ),
    ]
    for group, title in (
        ("right model", "Right model, white noise"),
        ("correlated noise", "Right model, noise correlated along lines"),
        ("understated noise", "Right model, noise larger than declared"),
        ("negative control", "Weights and variances of each line itself, as a control that fails"),
        ("complete fit", "Fits run to convergence"),
    ):
        parts.append(f"### {title}\n")
        by_system = group == "right model"
        parts.append(_right(cells[group], results) if by_system else _each(cells[group], results))
    parts.append("### Wrong models\n")
    parts.append(_wrong(cells["wrong model"], results))
    return "\n".join(parts)


def _right(cells: Sequence[Cell], results: dict[str, Any]) -> str:
    """Return a row for each way of fitting, a column for each number of blocks.

    Means over one and several visits, total and noise covariance.
    """
    rows = []
    for name in SYSTEMS:
        for full in (False, True):
            for residual in ("nls", "lls"):
                for weights in ("optimal", "user", "combined"):
                    alike = [
                        c
                        for c in cells
                        if (c.system, c.full, c.residual, c.weights)
                        == (name, full, residual, weights)
                    ]
                    if not alike:
                        continue
                    what = f"{name}, {residual}, {weights}{', full' if full else ''}"
                    columns = [[c for c in alike if c.blocks == B] for B in (0, *BLOCKS)]
                    rows.append((what, *(_cell([results[c.name] for c in one]) for one in columns)))
    return _table(("fit", "declared", *(f"B = {B}" for B in BLOCKS)), rows)


def _cell(results: Sequence[dict[str, Any]]) -> str:
    if not results:
        return ""
    coverage = 100 * np.array([r["coverage"] for r in results])
    width = np.mean([np.median(r["width"]) for r in results])
    alarms = [
        1 - r["verdicts"].get("trustworthy", 0) - r["verdicts"].get("not identifiable", 0)
        for r in results
    ]
    return (
        f"{coverage.mean():.1f} [{coverage.min():.1f}], x {width:.2f}, "
        f"{100 * max(0.0, float(np.mean(alarms))):.1f} %"
    )


def _each(cells: Sequence[Cell], results: dict[str, Any]) -> str:
    rows = []
    for cell in cells:
        r = results[cell.name]
        coverage = 100 * np.array(r["coverage"])
        rows.append(
            (
                cell.name,
                f"{coverage.mean():.1f} [{coverage.min():.1f}]",
                f"{np.median(r['width']):.2f}",
                _verdicts(r),
            )
        )
    return _table(("cell", "coverage [worst] %", "width", "verdicts %"), rows)


def _wrong(cells: Sequence[Cell], results: dict[str, Any]) -> str:
    rows = []
    for cell in cells:
        r = results[cell.name]
        coverage = 100 * np.array(r["coverage"])
        worst = int(np.argmax(r["moved"]))
        given = r["intervals"] > 0.02
        rows.append(
            (
                cell.name,
                f"{r['noncentrality']:.1f}" if r.get("noncentrality") else "",
                _verdicts(r),
                f"{coverage.mean():.0f} [{coverage.min():.0f}]" if given else "",
                f"{r['moved'][worst]:.1f}",
                f"{r['stated_shift'][worst]:.1f}",
            )
        )
    head = ("cell", "z", "verdicts %", "unflagged cover [worst] %", "moved, std", "stated, std")
    return _table(head, rows)


def _verdicts(result: dict[str, Any]) -> str:
    return ", ".join(f"{name} {100 * share:.1f}" for name, share in result["verdicts"].items())


def _table(head: Iterable[str], rows: Sequence[Iterable[Any]]) -> str:
    head = list(head)
    lines = [head, ["---"] * len(head), *([str(v) for v in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
