"""Which combinations of parameters the data tell least."""

import numpy as np

from estimators.uncertainty.identifiability import Identifiability
from reports import text
from reports.page_elements import Column, Number, Section, Table, filled, numbers, table

WEAKEST = 5
"""Directions shown."""


def section(found: Identifiability) -> Section:
    """Return the section."""
    body = filled(
        "identifiability.html.j2",
        found=found,
        limit=text.percent(found.limit),
        directions=direction_table(found),
        prices=price_table(found),
    )
    return Section("weak-directions", "Weak directions", body)


def direction_table(found: Identifiability) -> Table:
    """Return the least certain directions of ln theta, with what they consist of."""
    order = np.argsort(-found.direction_std, kind="stable")[:WEAKEST]
    rows = [(_std(float(found.direction_std[k])), _mixture(found, int(k))) for k in order]
    caption = "Least certain directions of the logarithms, of unit length."
    return table("directions", caption, [*numbers("std"), Column("direction", "words")], rows)


def price_table(found: Identifiability) -> Table:
    """Return what each parameter would be known to alone, and what freeing it costs the others."""
    rows = []
    for i, name in enumerate(found.names):
        std, alone, price = (float(a[i]) for a in (found.std, found.alone, found.price))
        rows.append((name, _std(std), _std(alone), Number(text.significant(price), price)))
    columns = [
        Column("parameter", code=True),
        *numbers("std", "std if the others were known", "widens the others by"),
    ]
    caption = "Standard deviations with all others free and with all others known."
    return table("prices", caption, columns, rows)


def _mixture(found: Identifiability, k: int) -> str:
    """Return the main parts of a direction, ``0.72 b1x.stiffness − 0.69 d2.stiffness``."""
    direction = found.directions[k]
    order = np.argsort(-np.round(np.abs(direction), 6), kind="stable")  # ties as the names are
    main = [int(i) for i in order if abs(direction[i]) > 0.2][:4]
    words = ""
    for i in main:
        size, sign = (
            text.fixed(abs(float(direction[i])), 2),
            "+" if direction[i] > 0 else text.MINUS,
        )
        words += (
            f" {sign} {size} {found.names[i]}"
            if words or sign != "+"
            else f"{size} {found.names[i]}"
        )
    return words.strip()


def _std(value: float) -> Number:
    return Number(text.percent(value) if np.isfinite(value) else "unknown", value)
