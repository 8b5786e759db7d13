"""Optional dependencies: how to install what is missing."""


def install(extra: str) -> str:
    """Return the command that installs an extra of the package, and the one in a clone of it."""
    return f"pip install 'elastic-robot-oed[{extra}]', or in a clone pip install '.[{extra}]'"
