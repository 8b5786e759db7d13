"""The command line, run in this process."""

import contextlib
import io
import sys

from reports import cli


def oed(*words: object) -> tuple[int, str, str]:
    """Run the command line here, without progress; return exit code, output and errors."""
    out, err, argv = io.StringIO(), io.StringIO(), sys.argv
    sys.argv = ["oed", *(["--quiet"] if words else []), *map(str, words)]
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            cli.main()
        code = 0
    except SystemExit as ended:
        code = int(ended.code or 0)
    finally:
        sys.argv = argv
    return code, out.getvalue(), err.getvalue()
