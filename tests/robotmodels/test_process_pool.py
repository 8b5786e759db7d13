"""Work in processes that are killed is done all the same."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
import wave
from concurrent.futures import ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing import forkserver

import pytest

from robotmodels import ProcessPool
from robotmodels.common.process_pool import behind_others, elsewhere


def square_unless_killed(folder, number, deaths):
    """Return a square; the first process that is asked for 3 dies, `deaths` times."""
    if number == 3:
        for k in range(deaths):
            try:
                (folder / f"death {k}").touch(exist_ok=False)
            except FileExistsError:
                continue
            os.kill(os.getpid(), signal.SIGKILL)
    return number**2


def refused(number):
    raise ValueError(f"{number} is refused")


class BrokenAtOnce:
    """A pool whose processes die before they are given anything."""

    def submit(self, call):
        raise BrokenProcessPool("broken again")

    def shutdown(self, *arguments, **options):
        pass


def wait_for(path):
    while not path.exists():
        time.sleep(0.01)


def process_id(_):
    return os.getpid()


def noted(path, name):
    """Write a name, and wait for a gate to open."""
    with path.open("a") as file:
        file.write(f"{name}\n")
    while not (path.parent / "gate").exists():
        time.sleep(0.01)


def test_lost_work_is_repeated_in_order(tmp_path):
    with ProcessPool(2) as pool:
        found = pool.map(square_unless_killed, [tmp_path] * 8, range(8), [1] * 8)
        assert list(found) == [n**2 for n in range(8)]
        assert len(list(tmp_path.iterdir())) == 1
        # A task's own error is no death, and the pool lives on.
        with pytest.raises(ValueError, match="5 is refused"):
            pool.submit(refused, 5).result()
        assert pool.submit(square_unless_killed, tmp_path, 4, 0).result() == 16
        # What is not wanted any more is left out; nothing has ended when it is told.
        waiting = [pool.submit(wait_for, tmp_path / "cancelled") for _ in range(12)]
        for one in waiting[1:]:
            one.cancel()
        (tmp_path / "cancelled").touch()
        assert sum(not one.cancelled() for one in as_completed(waiting)) < 12


def test_one_death_too_many_is_an_error(tmp_path):
    with ProcessPool(1, restarts=1) as pool:
        future = pool.submit(square_unless_killed, tmp_path, 3, 5)
        with pytest.raises(BrokenProcessPool):
            future.result()
        with pytest.raises(BrokenProcessPool):
            pool.submit(square_unless_killed, tmp_path, 4, 0)


def test_work_that_no_new_process_takes_is_told(tmp_path):
    with ProcessPool(1, restarts=1) as pool:
        pool._make = BrokenAtOnce
        future = pool.submit(square_unless_killed, tmp_path, 3, 1)
        with pytest.raises(BrokenProcessPool, match="broken again"):
            future.result(timeout=300)


def test_the_pool_ends_its_own_processes_only():
    other = multiprocessing.get_context("spawn").Process(
        target=time.sleep, args=(3600,), daemon=True
    )
    other.start()
    with ProcessPool(1) as pool:
        future = pool.submit(time.sleep, 3600)
        pool.terminate()
        with pytest.raises(BrokenProcessPool):
            future.result(timeout=300)
    alive = other.is_alive()
    other.terminate()
    other.join()
    assert alive


def test_processes_have_the_modules_they_are_to_load():
    with ProcessPool(1, modules=("wave",)) as pool:
        assert pool.submit(eval, "'wave' in __import__('sys').modules").result()
    assert elsewhere(None, sorted, [2, 1], reverse=True) == [2, 1]


@pytest.mark.skipif(sys.platform != "linux", reason="processes are copies of one on Linux only")
def test_work_goes_on_without_the_process_that_others_are_copies_of(tmp_path):
    with ProcessPool(2, restarts=9) as pool:
        first = set(pool.map(process_id, range(2)))
        os.kill(forkserver._forkserver._forkserver_pid, signal.SIGKILL)
        assert pool.submit(process_id, 0).result(timeout=300) not in {os.getpid()}
        for process in first & set(pool._pool._processes):
            os.kill(process, signal.SIGKILL)
        assert list(pool.map(abs, (-1, -2, -3))) == [1, 2, 3]
        waiting = [pool.submit(wait_for, tmp_path / "gate") for _ in range(8)]
        os.kill(forkserver._forkserver._forkserver_pid, signal.SIGKILL)
        (tmp_path / "gate").touch()
        assert [one.result(timeout=300) for one in waiting] == [None] * 8


SCRIPT = """
from robotmodels import ProcessPool
with ProcessPool(2) as pool:
    print(list(pool.map(abs, [-1, -2])))
"""


def ran(command, **options):
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    return done.returncode, done.stdout, done.stderr.strip()


def test_a_script_without_a_guard_is_told_so(tmp_path):
    path = tmp_path / "script.py"
    path.write_text(SCRIPT)
    code, out, err = ran([sys.executable, str(path)])
    assert (code, out) == (1, "")
    assert 'must stand under `if __name__ == "__main__":`' in err.splitlines()[-1]
    assert "bootstrapping" not in err  # the tracebacks of the processes that were started in vain
    path.write_text("if __name__ == '__main__':" + SCRIPT.replace("\n", "\n    "))
    assert ran([sys.executable, str(path)]) == (0, "[1, 2]\n", "")


def test_a_script_from_standard_input_is_told_so():
    code, out, err = ran([sys.executable, "-"], input=SCRIPT)
    assert (code, out) == (1, "")
    assert "the script is <stdin>, which new processes cannot read" in err.splitlines()[-1]
    assert ran([sys.executable, "-c", SCRIPT]) == (0, "[1, 2]\n", "")


def test_tasks_behind_let_others_go_first(tmp_path):
    path = tmp_path / "order"
    path.touch()
    with ProcessPool(1) as pool, ThreadPoolExecutor(1) as thread:
        behind = behind_others(pool)
        waiting = thread.submit(
            lambda: list(behind.map(partial(noted, path), [f"behind {k}" for k in range(8)]))
        )
        while not path.read_text():
            time.sleep(0.01)
        other = pool.submit(noted, path, "other")
        (tmp_path / "gate").touch()
        assert len(waiting.result(60)) == 8
        other.result(60)
    order = path.read_text().split("\n")[:-1]
    assert sorted(order) == sorted(["other", *(f"behind {k}" for k in range(8))])
    assert order.index("other") <= 2
    assert behind_others(None) is None
    assert behind_others(thread) is thread


COPIES = """
import os, signal
from multiprocessing import forkserver
from robotmodels import ProcessPool
from robotmodels.common.process_pool import load_ahead
if __name__ == "__main__":
    load_ahead(["wave", "slow"])
    os.kill(forkserver._forkserver._forkserver_pid, signal.SIGINT)
    for value in "12":
        os.environ["GIVEN"] = value
        with ProcessPool(1) as pool:
            print(*pool.map(os.getenv, ["GIVEN", "PYTHONSAFEPATH"]))
            print(*pool.map(eval, ["__import__('wave').__file__", "__import__('slow').__file__"]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="processes are copies of one on Linux only")
def test_copies_have_modules_and_environment_of_their_origin_and_no_interrupt(tmp_path):
    """Neither modules of the working directory nor the environment of the first pool."""
    script, here = tmp_path / "script", tmp_path / "here"
    for folder in (script, here):
        folder.mkdir()
    (script / "run.py").write_text(COPIES)
    (script / "slow.py").write_text("import time; time.sleep(0.3)")
    for name in ("wave", "slow", "robotmodels"):
        (here / f"{name}.py").write_text("print('of the working directory')")
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    done = ran([sys.executable, str(script / "run.py")], cwd=here, env=environment)
    files = f"{wave.__file__} {script / 'slow.py'}"
    assert done == (0, f"1 None\n{files}\n2 None\n{files}\n", "")
