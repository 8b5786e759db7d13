"""How samples of theta count: on average, or at worst."""

from robotmodels.common.errors import InvalidInput, nearest

KINDS = ("average", "maximin")


def check_robustness(kind: str) -> None:
    """Refuse an unknown kind.

    Raises
    ------
    InvalidInput
        Naming the kinds there are.
    """
    if kind not in KINDS:
        raise InvalidInput(
            f"kind {kind!r} is not known{nearest(kind, KINDS)}; there are {', '.join(KINDS)}"
        )
