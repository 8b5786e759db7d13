"""Whether a computation fits into the memory of this machine."""

import os

from robotmodels.errors import InvalidInput


def check_memory(needed: float, what: str) -> None:
    """Refuse what needs more than this machine has.

    Parameters
    ----------
    needed : float, bytes
        Estimate.
    what : str
        Whose memory it is, and the keys it grows with.

    Raises
    ------
    InvalidInput
        Naming `what`, the estimate and the memory there is.
    """
    try:
        there = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # not on Windows
        return
    if needed > there:
        raise InvalidInput(
            f"{what}: {needed / 1e9:.3g} GB are needed, this machine has {there / 1e9:.3g} GB"
        )
