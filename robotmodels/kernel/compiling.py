"""Compile functions: inner ones as part of those that Python calls, each of these once.

`entry` functions are called from Python and stored on disk; `compiled` and `inlined` ones are
called by compiled code only.
"""

# numba's compiler comes without types:
# mypy: allow-subclassing-any, allow-untyped-defs, allow-untyped-calls

import time
from fcntl import LOCK_EX, LOCK_NB, flock
from hashlib import sha256
from pathlib import Path
from typing import IO, Any

from numba import _dynfunc, njit
from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

_PLAIN = "__init__", "cost_kernel", "prepare", "run_kernel", "terminals", "threads"
"""Files of the kernel in which nothing is compiled."""

_PATIENCE = 300.0
"""Seconds to wait for another process to compile a function, in case it is interrupted."""


class _InnerLibrary(JITCodeLibrary):
    """Code of an inner function: optimised and turned into machine code with its callers only.

    numba itself does both for each function, with all that it calls, again and again.
    """

    def _optimize_final_module(self):
        pass

    def _finalize_final_module(self):
        self._finalize_dynamic_globals()
        self._finalized = True


class _InnerCompiler(Compiler):
    """numba's compiler, which makes a library of inner code and no function for Python."""

    def __init__(self, typingctx, targetctx, library, *options):
        library = library or _InnerLibrary(targetctx.codegen(), "inner")
        super().__init__(typingctx, targetctx, library, *options)
        self.state.targetctx.get_executable = _no_executable


def _no_executable(library, fndesc, env):
    """Return what stands for an inner function in numba's registries; nothing calls it."""
    return _dynfunc.make_function(fndesc.lookup_module(), fndesc.qualname, "", 0, env, (library,))


def _sources() -> str:
    folder = Path(__file__).parent
    digest = sha256()
    for file in sorted(set(folder.glob("*.py")) - {folder / f"{name}.py" for name in _PLAIN}):
        digest.update(file.read_bytes())
    return digest.hexdigest()


_SOURCES = _sources()


class _SharedCache(FunctionCache):
    """Machine code of a function on disk, compiled by one process while the others wait for it.

    numba looks for changes in the function's own file only; here it is compiled again when any
    file of the kernel with compiled code has changed.
    """

    _lock: IO[str] | None = None

    def load_overload(self, sig, target_context):
        """Return the stored code, or None once it is this process that has to compile it."""
        self._unlock()
        stored = super().load_overload(sig, target_context)
        if stored is None:
            self._wait()
            stored = super().load_overload(sig, target_context)
        if stored is not None:
            self._unlock()
        return stored

    def save_overload(self, sig, data):
        """Store what was compiled and let waiting processes go on."""
        super().save_overload(sig, data)
        self._unlock()

    def _index_key(self, sig, codegen):
        return *super()._index_key(sig, codegen), _SOURCES

    def _wait(self) -> None:
        end = time.monotonic() + _PATIENCE
        try:
            self._lock = (Path(self.cache_path) / f"{self._impl.filename_base}.lock").open("w")
            while time.monotonic() < end:
                try:
                    return flock(self._lock, LOCK_EX | LOCK_NB)
                except BlockingIOError:
                    time.sleep(0.05)
        except OSError:  # a file system without locks
            return None

    def _unlock(self) -> None:
        if self._lock is not None:
            self._lock.close()
            self._lock = None


# The wrappers of functions that Python does not call would be compiled too.
_INNER: dict[str, Any] = {
    "error_model": "numpy",
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "pipeline_class": _InnerCompiler,
}
inlined: Any = njit(**_INNER, forceinline=True)
compiled: Any = njit(**_INNER)


def entry(function: Any) -> Any:
    """Compile a function that Python calls, and keep it on disk."""
    dispatcher: Any = njit(error_model="numpy", nogil=True)(function)
    dispatcher._cache = _SharedCache(function)
    return dispatcher


def is_stored(function: Any) -> bool:
    """Tell whether machine code of an `entry` function is on disk, for arguments of any types."""
    return any(key[-1] == _SOURCES for key in function._cache._cache_file._load_index())
