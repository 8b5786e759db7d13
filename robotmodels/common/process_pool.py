"""A pool of processes that outlives the death of one of them."""

import gc
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import wait
from typing import TYPE_CHECKING, Any, TypeVar

from robotmodels.common.errors import InvalidInput

if TYPE_CHECKING:
    from multiprocessing.synchronize import Event

_NEVER_BEGAN = (
    "processes: they ended before they began. Each reads the script anew: what starts them must "
    'stand under `if __name__ == "__main__":`. If it does, they were killed, possibly out of '
    "memory"
)

_UNTIL_GONE = 0.1
"""From the end of a process's files to that of the process, at most [s]."""

T = TypeVar("T")
Call = Callable[[], Any]


class ProcessesNeverBegan(InvalidInput, BrokenProcessPool):
    """The processes of a pool ended before they could be given work."""


class ProcessPool(Executor):
    """Processes of this machine that share work, for any `executor` argument.

    When a process is killed, out of memory or by hand, `ProcessPoolExecutor` gives up all
    that it has not finished. This one starts new processes instead and repeats what was lost;
    tasks must not mind being begun twice.

    Parameters
    ----------
    workers : int
        Number of processes, which end with this one.
    restarts : int
        Deaths that are made good; the next one is a `BrokenProcessPool` error.
    modules : sequence of str
        What the processes load when they begin. On Linux one process loads them for all, if no
        pool of this program has begun before.

    Raises
    ------
    InvalidInput
        In a script that comes from standard input.
    ProcessesNeverBegan
        From tasks, where a script starts processes outside ``if __name__ == "__main__":``.
    """

    def __init__(self, workers: int, restarts: int = 3, modules: Sequence[str] = ()) -> None:
        _check_script()
        context = multiprocessing.get_context("forkserver" if load_ahead(modules) else "spawn")
        self._begun = context.Event()
        self._make = partial(
            ProcessPoolExecutor,
            workers,
            mp_context=context,
            initializer=_prepare_worker,
            initargs=(self._begun, dict(os.environ)),
        )
        self._pool = self._make()
        self.workers = workers
        self._restarts = restarts
        self._lock = threading.RLock()
        for module in modules:
            self.load(module)

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Return the future result of ``fn(*args, **kwargs)``."""
        outer: Future[T] = Future()
        self._start(outer, partial(fn, *args, **kwargs))
        return outer

    def load(self, module: str) -> None:
        """Let each process load a module that its next tasks need."""
        for _ in range(self.workers):
            self.submit(_load, module)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes when they have done what they were given; deaths now count."""
        with self._lock:
            self._restarts = 0
        self._pool.shutdown(wait, cancel_futures=cancel_futures)

    def terminate(self) -> None:
        """End the processes at once, whatever they do."""
        with self._lock:
            self._restarts = 0
        # As `terminate_workers` of Python 3.14; other children of this process are not the pool's.
        for process in list((self._pool._processes or {}).values()):
            process.terminate()

    def _start(self, outer: "Future[Any]", call: Call) -> None:
        pool = self._pool
        try:
            inner = pool.submit(call)
        except BrokenProcessPool as error:
            if not self._renewed(pool):
                raise self._explained(error) from error
            self._start(outer, call)
            return
        except (EOFError, ConnectionError) as error:
            # The process that others are copies of has just been killed.
            if not self._counted():
                raise self._explained(BrokenProcessPool(str(error))) from error
            time.sleep(_UNTIL_GONE)
            self._start(outer, call)
            return
        outer.add_done_callback(lambda done: inner.cancel() if done.cancelled() else None)
        inner.add_done_callback(partial(self._finish, outer, call, pool))

    def _finish(
        self, outer: "Future[Any]", call: Call, pool: ProcessPoolExecutor, inner: "Future[Any]"
    ) -> None:
        """Hand a result on, or begin again if its process died."""
        if inner.cancelled():
            outer.cancel()
            outer.set_running_or_notify_cancel()
            return
        error = inner.exception()
        if isinstance(error, BrokenProcessPool):
            error = self._explained(error)
        if isinstance(error, BrokenProcessPool) and not outer.cancelled() and self._renewed(pool):
            try:
                self._start(outer, call)
            except RuntimeError as refused:  # meanwhile shut down, or broken once too often
                error = refused
            else:
                return
        if outer.set_running_or_notify_cancel():
            if error is None:
                outer.set_result(inner.result())
            else:
                outer.set_exception(error)

    def _renewed(self, broken: ProcessPoolExecutor) -> bool:
        """Return whether there are living processes again, new ones if need be."""
        with self._lock:
            if self._pool is not broken:
                return True  # for another task that was lost
            if not self._begun.is_set() or not self._counted():
                return False
            # The broken pool ends by itself; to wait for it in its own thread would be for ever.
            self._pool = self._make()
        return True

    def _counted(self) -> bool:
        """Return whether one more death is made good."""
        with self._lock:
            if not self._restarts:
                return False
            self._restarts -= 1
        return True

    def _explained(self, error: BrokenProcessPool) -> Exception:
        """Return the error of processes that never began to work; the same for others."""
        return error if self._begun.is_set() else ProcessesNeverBegan(_NEVER_BEGAN)


def call(module: str, name: str) -> Any:
    """Return the result of a function of a module, which only the process that calls it loads."""
    return getattr(import_module(module), name)()


def _load(module: str) -> None:
    import_module(module)


def load_ahead(modules: Sequence[str]) -> bool:
    """Begin a process of which later ones are copies, and let it load modules.

    Return whether it runs: not where such copies are not safe, which is everywhere but on Linux,
    and not without a place for its socket. One that runs already loads nothing more.
    """
    if sys.platform != "linux":
        return False
    # Without the script, whose threads and locks copies would not survive.
    forkserver.set_forkserver_preload(list(modules))
    try:
        with _inherited():
            forkserver.ensure_running()
    except OSError:
        return False
    return True


@contextmanager
def _inherited() -> Iterator[None]:
    """Let a process begin that takes modules from where this one does, and no interrupt.

    By itself it would look for them in the working directory first.
    """
    resource_tracker.ensure_running()  # which would let interrupts through
    before = dict(os.environ)
    os.environ.update(PYTHONSAFEPATH="1", PYTHONPATH=os.pathsep.join(sys.path))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        _set_environment(before)


def _set_environment(variables: Mapping[str, str]) -> None:
    for name in os.environ.keys() - variables.keys():
        del os.environ[name]
    os.environ.update(variables)


class Behind(Executor):
    """An executor whose tasks let those of others go first: few of them wait at a time.

    It blocks who submits more, and does not end the executor that it gives them to.
    """

    def __init__(self, pool: ProcessPool) -> None:
        self._pool = pool
        self._free = threading.Semaphore(pool.workers + 1)

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Return the future result of ``fn(*args, **kwargs)``, once few others wait."""
        self._free.acquire()
        future = self._pool.submit(fn, *args, **kwargs)
        future.add_done_callback(lambda _: self._free.release())
        return future


def behind_others(executor: Executor | None) -> Executor | None:
    """Return an executor for tasks that may wait, where it is one of processes here."""
    return Behind(executor) if isinstance(executor, ProcessPool) else executor


def elsewhere(executor: Executor | None, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> T:
    """Return ``fn(*args, **kwargs)``, computed by another process where there is an executor."""
    return (
        fn(*args, **kwargs) if executor is None else executor.submit(fn, *args, **kwargs).result()
    )


def _check_script() -> None:
    """Refuse to start processes where they could not begin.

    Each process reads the script that is run anew, up to where it is told what to do.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        sys.exit(1)  # this is such a process: that the first one tells its user is enough
    script = sys.modules["__main__"]
    path = getattr(script, "__file__", None)
    if getattr(script, "__spec__", None) is None and path and not os.path.exists(path):
        raise InvalidInput(
            f"processes: the script is {path}, which new processes cannot read; save it to a file, "
            "or work without a pool"
        )


def collect_rarely() -> None:
    """Let Python look for cycles of dead objects rarely, and never among those alive now.

    Modules and results are many objects that stay: to go through them again and again took a
    tenth of a study's time.
    """
    gc.freeze()
    gc.set_threshold(100_000, 50, 50)


def _prepare_worker(begun: "Event", environment: Mapping[str, str]) -> None:
    """Let an interrupt end a worker without a traceback, and a killed parent take it along."""
    begun.set()
    _set_environment(environment)
    collect_rarely()
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):  # not of Windows, where nothing blocks it
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
