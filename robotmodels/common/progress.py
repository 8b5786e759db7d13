"""What long computations call to report how far they are."""

from collections.abc import Callable

Progress = Callable[[int, int], object]
"""Called with the steps done and the steps in all."""

StageProgress = Callable[[str, int, int], object]
"""Called with the stage's name, the steps done and the steps in all (0: no total yet)."""


def tell(progress: Callable[..., object] | None, *steps: object) -> None:
    """Call a `Progress` or `StageProgress` if there is one."""
    if progress is not None:
        progress(*steps)
