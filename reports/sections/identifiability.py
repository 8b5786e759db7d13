"""Combinations of parameters that the data determine least."""

import numpy as np

from estimators.uncertainty.identifiability import Identifiability
from reports import text
from reports.page_elements import (
    Column,
    Number,
    Section,
    Table,
    filled,
    numbers,
    percent_cell,
    table,
)

WEAKEST = 5
"""Directions shown."""


def section(identifiability: Identifiability) -> Section:
    """Return the section."""
    body = filled(
        "identifiability.html.j2",
        identifiability=identifiability,
        limit=text.percent(identifiability.limit),
        directions=direction_table(identifiability),
        prices=price_table(identifiability),
    )
    return Section("weak-directions", "Weak directions", body)


def direction_table(identifiability: Identifiability) -> Table:
    """Return the least certain directions of ln theta, with their main parts."""
    order = np.argsort(-identifiability.direction_std, kind="stable")[:WEAKEST]
    rows = [
        (_std(float(identifiability.direction_std[k])), _mixture(identifiability, int(k)))
        for k in order
    ]
    caption = "Least certain linear combinations of the logarithms, of unit length."
    return table("directions", caption, [*numbers("std [%]"), Column("combination", "words")], rows)


def price_table(identifiability: Identifiability) -> Table:
    """Return the std of each parameter if alone free, and what freeing it costs the others."""
    rows = []
    for i, name in enumerate(identifiability.names):
        std, alone, price = (
            float(a[i]) for a in (identifiability.std, identifiability.alone, identifiability.price)
        )
        rows.append((name, _std(std), _std(alone), Number(text.significant(price), price)))
    columns = [
        Column("parameter", code=True),
        *numbers("std [%]", "std, others fixed [%]", "inflation of the others"),
    ]
    caption = "Standard deviations with all others free and with all others fixed."
    return table("prices", caption, columns, rows)


def _mixture(identifiability: Identifiability, k: int) -> str:
    """Return the main parts of a direction, ``0.72 b1x.stiffness − 0.69 d2.stiffness``."""
    direction = identifiability.directions[k]
    order = np.argsort(-np.round(np.abs(direction), 6), kind="stable")  # ties as the names are
    main = [int(i) for i in order if abs(direction[i]) > 0.2][:4]
    words = ""
    for i in main:
        size, sign = (
            text.fixed(abs(float(direction[i])), 2),
            "+" if direction[i] > 0 else text.MINUS,
        )
        words += (
            f" {sign} {size} {identifiability.names[i]}"
            if words or sign != "+"
            else f"{size} {identifiability.names[i]}"
        )
    return words.strip()


def _std(value: float) -> Number:
    return percent_cell(value, unbounded="undetermined")
