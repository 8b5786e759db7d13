"""Compiled functions: one process compiles while others wait for what it stores."""

from concurrent.futures import ThreadPoolExecutor, TimeoutError

import numba
import pytest
from numba import int64

from robotmodels.kernel.compiling import compiled, entry


@compiled
def _one_more(x):
    return x + 1


def _two_more(x):
    return _one_more(_one_more(x))


def test_others_wait_for_the_one_that_compiles(tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    first, second = entry(_two_more), entry(_two_more)  # as in two processes
    load = second._cache.load_overload
    assert first._cache.load_overload((int64,), first.targetctx) is None
    with ThreadPoolExecutor(1) as pool:
        other = pool.submit(load, (int64,), second.targetctx)
        with pytest.raises(TimeoutError):
            other.result(0.2)
        code = first._compiler.compile((int64,), None)
        first._cache.save_overload((int64,), code)
        assert other.result(60) is not None
    assert second(3) == 5
    assert not second.stats.cache_misses


def test_a_failed_compilation_is_waited_for_no_longer(tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr("robotmodels.kernel.compiling._PATIENCE", 0.1)
    first, second = entry(_two_more), entry(_two_more)
    assert first._cache.load_overload((int64,), first.targetctx) is None
    assert second(3) == 5
    assert first(4) == 6
