import subprocess
import sys

import pytest

import oed


def test_every_public_name_exists():
    for name in oed.__all__:
        assert getattr(oed, name).__name__ == name
    assert set(oed.__all__) <= set(dir(oed))


def test_unknown_name():
    with pytest.raises(AttributeError, match="module 'oed' has no attribute 'optimal'"):
        oed.optimal  # noqa: B018


def test_import_is_lazy():
    code = "import sys, oed; sys.exit(any(m in sys.modules for m in ('numpy', 'scipy', 'cvxpy')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
