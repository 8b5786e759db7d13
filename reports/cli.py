"""The command ``oed``: an interrupt ends it quietly even while its modules are being loaded."""

import sys


def main() -> None:
    """Run the command line and end with its exit code, see `reports.application`."""
    try:
        from reports import application

        application.run()
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
