"""Processes that share the work of a command, here or on a cluster."""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError, Executor
from contextlib import AbstractContextManager, contextmanager
from importlib import import_module

from reports.commands.stopping import waking
from robotmodels.common.errors import IdentificationError, InvalidInput
from robotmodels.common.extras import install
from robotmodels.common.process_pool import ProcessPool

RETRIES = 3
"""Times that a task whose worker died begins again, here as on a cluster."""

PATIENCE = 10
"""Seconds in which a cluster's scheduler must answer."""


def available_cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1


def one_thread_each() -> None:
    """Keep BLAS to one thread: the matrices are small and every core has a process."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def shared(
    workers: int, address: str | None = None, modules: Sequence[str] = ()
) -> AbstractContextManager[Executor | None]:
    """Give the executor that a command's options ask for: a cluster's, or that of processes here.

    Raises
    ------
    InvalidInput
        As `cluster`.
    """
    return process_pool(workers, modules) if address is None else cluster(address)


@contextmanager
def process_pool(workers: int, modules: Sequence[str] = ()) -> Iterator[Executor | None]:
    """Give an executor of so many processes; None for one, which is this process.

    Parameters
    ----------
    modules : sequence of str
        What they load at once, if they are sure to be needed.
    """
    if workers == 1:
        yield None
        return
    pool = ProcessPool(workers, RETRIES, modules)
    try:
        with waking(pool.terminate):
            yield pool
    except BaseException:
        pool.terminate()  # their results are not needed any more
        raise
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Give an executor of the workers of a Dask scheduler.

    Raises
    ------
    InvalidInput
        If Dask is not installed, or no scheduler answers.
    IdentificationError
        If a task's workers die again and again, or the scheduler goes away.
    """
    try:
        distributed = import_module("distributed")  # an extra: it may not be there
    except ImportError:
        raise InvalidInput(f"--cluster needs dask.distributed: {install('cluster')}") from None
    try:
        client = distributed.Client(address, timeout=PATIENCE)
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InvalidInput(f"--cluster {address}: no scheduler answers ({reason})") from None
    try:
        yield client.get_executor(retries=RETRIES)
    except (distributed.KilledWorker, CancelledError) as error:
        raise IdentificationError(
            f"--cluster {address}: its workers died, possibly out of memory, or its scheduler "
            "went away; run the same command again to continue from the finished stages"
        ) from error
    finally:
        client.close()
