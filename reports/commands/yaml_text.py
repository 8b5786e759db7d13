"""Words and numbers as every reader of YAML takes them."""

import json
import re

from robotmodels.common.yaml_reader import reads_as_text

_TRUTH = ("y", "n", "yes", "no", "on", "off")


def yaml_word(word: str) -> str:
    """Return a text that YAML reads as one, quoted where it must be."""
    plain = re.fullmatch(r"[A-Za-z_./][\w./-]*(:[\w./-]+)*", word)
    # Readers of YAML 1.1, such as most editors, take some words for truth.
    return (
        word if plain and reads_as_text(word) and word.lower() not in _TRUTH else json.dumps(word)
    )


def yaml_number(value: float, digits: int = 2) -> str:
    """Return a number, rounded, that YAML reads as one."""
    return _yaml(f"{float(f'{value:.{digits - 1}e}'):g}" if digits < 3 else f"{value:.{digits}f}")


def yaml_exact(value: float) -> str:
    """Return a number, every digit of it, that YAML reads as one."""
    return _yaml(repr(float(value)))


def _yaml(word: str) -> str:
    mantissa, e, exponent = word.partition("e")
    return word if not e else f"{mantissa if '.' in mantissa else mantissa + '.0'}e{exponent}"
