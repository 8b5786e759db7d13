"""Signals end a command where it can stop, and at once where it cannot."""

import signal
import subprocess
import sys

import pytest

# Steps of compiled code that calls back: qsort drops exceptions of its comparison.
PROGRAM = """
import ctypes, os, signal, sys, threading
from reports.commands import stopping
from reports.commands.stopping import stoppable, stopping_at_steps, waking, watched_signals

# As in a terminal: what runs the tests may ignore signals, as nohup does.
signal.signal(signal.SIGHUP, signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)
compared = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
forever = threading.Event().wait

def met(a, b):
    os.kill(os.getpid(), {number})
    sum(range(1000))  # time for a handler
    {met}
    return 0

def step():
    ctypes.CDLL(None).qsort(ctypes.create_string_buffer(2), 2, 1, compared(met))

def command():
    report = stopping_at_steps(None)
    with stoppable():
        {command}
        while True:
            report("a stage", 1, 2)
            step()

with watched_signals():
    try:
        command()
    finally:
        sys.stdout.write("in order")
        sys.stdout.flush()
"""


def ended(name, met="", command="pass", before=""):
    program = PROGRAM.format(number=int(getattr(signal, name)), met=met, command=command)
    run = subprocess.run(
        [sys.executable, "-c", program.replace("compared =", f"{before}\ncompared =")],
        capture_output=True,
        text=True,
        timeout=300,
    )
    return run.returncode, run.stdout, run.stderr


def test_a_signal_that_compiled_code_meets_ends_at_the_next_step():
    assert ended("SIGTERM") == (143, "in order", "")
    assert ended("SIGHUP") == (129, "in order", "")
    code, out, err = ended("SIGINT")
    assert (code, out) == (-signal.SIGINT, "in order")
    assert err.splitlines()[-1] == "KeyboardInterrupt"


@pytest.mark.parametrize(
    ("name", "said"), [("SIGTERM", ""), ("SIGINT", "interrupted; run the same")]
)
def test_a_second_signal_ends_at_once(name, said):
    code, out, err = ended(name, f"os.kill(os.getpid(), {int(getattr(signal, name))}); forever()")
    assert (code, out) == (128 + getattr(signal, name), "")
    assert err.startswith(said)


def test_patience_has_an_end():
    assert ended("SIGTERM", "forever()", before="stopping.PATIENCE = 0.1") == (143, "", "")


def test_where_nothing_can_be_stopped_a_signal_ends_at_once():
    alone = "from contextlib import nullcontext as stoppable"
    assert ended("SIGTERM", "forever()", before=alone) == (143, "", "")


WAITS = """event = threading.Event()
        with waking(event.set):
            threading.Thread(target=step).start()
            event.wait()
            raise OSError("a process that was ended to wake this one")"""


def test_what_waits_is_woken():
    assert ended("SIGTERM", command=WAITS) == (143, "in order", "")
