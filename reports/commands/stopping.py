"""Signals that end a command: noted at once, acted on where a computation can stop.

An exception that a handler raises may rise while compiled code calls back into Python, which drops
it or crashes. So handlers only set a flag: the interpreter writes a signal's number into a pipe, a
thread reads it and wakes what waits for other processes, and the computation ends itself at the
next step that it reports. A second signal ends the process at once, as does the end of `PATIENCE`:
checkpoints outlive that, as they outlive a kill.
"""

import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

PATIENCE = 5.0
"""Time to the next step after a signal [s]."""
INTERRUPTED = "interrupted; run the same command again to continue\n"
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
_END = b"\0"


class _Request:
    """The signal that asked the command to end, and what to do about it."""

    def __init__(self) -> None:
        self.number = 0
        self.computing = False
        self.ending = False  # which the thread may learn before it learns of the signal
        self.wakers: list[Callable[[], object]] = []

    def watch(self, pipe: int) -> None:
        """Wait for signals in a separate thread until the command has ended."""
        number = os.read(pipe, 1)[0]
        if not number:
            return
        if self.computing or self.ending:
            self.number = number
            for wake in list(self.wakers):
                with suppress(Exception):
                    wake()
            if select.select([pipe], [], [], PATIENCE)[0] and os.read(pipe, 1) == _END:
                return
            if number == signal.SIGINT:
                sys.stderr.write(INTERRUPTED)
        os._exit(128 + number)


_request = _Request()


@contextmanager
def watched_signals() -> Iterator[None]:
    """Take the signals that end a command, as far as nobody else has done so (such as nohup)."""
    taken: list[int] = []
    if threading.current_thread() is threading.main_thread():
        defaults = (signal.SIG_DFL, signal.default_int_handler)
        numbers = [getattr(signal, name) for name in _SIGNALS if hasattr(signal, name)]
        taken = [number for number in numbers if signal.getsignal(number) in defaults]
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    thread = threading.Thread(target=_request.watch, args=(reading,), daemon=True)
    before = {number: signal.signal(number, _note) for number in taken}
    descriptor = signal.set_wakeup_fd(writing, warn_on_full_buffer=False) if taken else -1
    thread.start()
    try:
        yield
    finally:
        if taken:
            signal.set_wakeup_fd(descriptor)
        for number, handler in before.items():
            signal.signal(number, handler)
        os.write(writing, _END)
        thread.join()
        os.close(reading)
        os.close(writing)
        _request.number, _request.ending = 0, False


@contextmanager
def stoppable() -> Iterator[None]:
    """Compute something that reports its steps, at each of which it can be stopped.

    Raises
    ------
    KeyboardInterrupt, SystemExit
        Where a signal asked for it.
    """
    _request.computing = True
    try:
        yield
    except Exception:
        check_stop()  # such as processes that were ended to wake this one
        raise
    finally:
        _request.computing = False


@contextmanager
def waking(wake: Callable[[], object]) -> Iterator[None]:
    """Have `wake` called, in another thread, when a signal asks the command to end."""
    _request.wakers.append(wake)
    try:
        yield
    finally:
        _request.wakers.remove(wake)


def check_stop() -> None:
    """End the command if a signal has asked for it; called where Python code is about to go on.

    Raises
    ------
    KeyboardInterrupt, SystemExit
        Where a signal asked for it.
    """
    if not _request.number:
        return
    _request.ending = True
    if _request.number == signal.SIGINT:
        raise KeyboardInterrupt
    raise SystemExit(128 + _request.number)


def stopping_at_steps(progress: Callable[..., object] | None) -> Callable[..., None]:
    """Return the progress function that also stops the command; `progress` may be None."""

    def report(*step: object) -> None:
        check_stop()
        if progress is not None:
            progress(*step)

    return report


def _note(number: int, frame: object) -> None:
    """Note that a signal came; the thread that reads the pipe acts, also if this never runs."""
    _request.number = number
