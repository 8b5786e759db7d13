"""The command ``oed``: an interrupt ends it quietly even while its modules are being loaded."""

import sys


def main() -> None:
    """Run the command line."""
    try:
        from reports import cli

        cli.main()
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
