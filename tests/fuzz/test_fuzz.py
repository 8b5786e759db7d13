"""No file that a command reads ends in more than one line, takes long or much, or does harm.

The long version, with all failures and the figures of each format: ``python tests/fuzz``.
"""

import shutil
from html.parser import HTMLParser

import pytest
from campaign import mutant, run, wrong
from formats import FORMATS
from hostile import CASES
from hypothesis import HealthCheck, given, settings, strategies as st
from runner import Runner

MUTANTS = 20


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz")


@pytest.fixture(scope="module")
def runner(scratch):
    with Runner(scratch / "seeds") as started:
        yield started


class Markup(HTMLParser):
    """Collects what a page must not have."""

    def __init__(self):
        super().__init__()
        self.harmful, self.script = [], False

    def handle_starttag(self, tag, attrs):
        if any(name.startswith("on") for name, _ in attrs) or ("src", "x") in attrs:
            self.harmful.append(self.get_starttag_text())
        self.script = tag == "script"

    def handle_data(self, data):
        if self.script and data.strip() == "alert(1)":
            self.harmful.append(data)


def harm(case, folder, before):
    """Return what a command did that no file may make it do."""
    strays = sorted({path.name for path in folder.parent.iterdir()} - before)
    parser = Markup()
    for page in folder.rglob("*.html"):
        parser.feed(page.read_text(encoding="utf-8"))
    return [*strays, *parser.harmful]


def test_hostile_files_are_refused_or_harmless(runner, scratch):
    faults = []
    for case in CASES:
        folder = scratch / "hostile" / "work"
        shutil.copytree(scratch / "seeds" / case.seed, folder)
        case.change(folder)
        before = {path.name for path in folder.parent.iterdir()}
        outcome = runner.run(case.command.split(), folder)
        fault = wrong(outcome, (2,) if case.says else (0, 2))
        if not fault and case.says not in outcome.err:
            fault = f"says {outcome.err!r}"
        faults += [f"{case.name}: {f}" for f in (fault, *harm(case, folder, before)) if f]
        shutil.rmtree(folder.parent)
    assert not faults, "\n".join(faults)


@settings(
    max_examples=MUTANTS,
    deadline=None,
    database=None,
    print_blob=True,
    suppress_health_check=list(HealthCheck),
)
@given(format=st.sampled_from(FORMATS), rng=st.randoms(use_true_random=False))
def test_changed_files_end_in_order(runner, scratch, format, rng):
    folder = scratch / "work"
    shutil.rmtree(folder, ignore_errors=True)
    made = mutant(format, scratch / "seeds", folder, rng)
    outcome, fault = run(runner, made)
    assert not fault, f"oed {' '.join(made.words)}\n{fault}\n{outcome.err}"


@pytest.mark.slow
def test_whole_files_are_accepted(runner, scratch):
    """That mutants are refused tells nothing of a reader that refuses everything."""
    refused = []
    for format in FORMATS:
        for number, command in enumerate(format.commands):
            folder = scratch / "whole" / f"{format.name} {number}"
            shutil.copytree(scratch / "seeds" / format.seed, folder)
            words = command.replace("{file}", str(format.paths(scratch / "seeds")[0])).split()
            outcome = runner.run(words, folder)
            if wrong(outcome, (0,)):
                refused.append(f"{format.name}: {command}: {outcome.err}")
    assert not refused, "\n".join(refused)


MISBEHAVIOUR = {
    "traceback": "1 / 0",
    "on stderr": "numpy.log(numpy.zeros(3))",
    "traceback: MemoryError": "bytearray(3 << 30)",
    "signal 6": "os.abort()",
    "control character": "print(chr(27) + '[31m')",
    "exit code 1": "sys.exit(1)",
    "2 lines of error": "sys.stderr.write('error: a\\nb\\n'), sys.exit(2)",
    "characters of error": "sys.stderr.write('error: ' + 'a' * 5000 + '\\n'), sys.exit(2)",
    "traceback: PermissionError": "open('../outside', 'w')",
    "no end": "time.sleep(100)",
}


@pytest.mark.parametrize("fault", MISBEHAVIOUR)
def test_misbehaviour_is_noticed(fault, runner, scratch):
    folder = scratch / "control"
    folder.mkdir(exist_ok=True)
    code = f"import numpy, os, sys, time\n{MISBEHAVIOUR[fault]}"
    (folder / "code.py").write_text(code, encoding="utf-8")
    outcome = runner.run(["python:runpy:run_path", "code.py"], folder)
    assert wrong(outcome).startswith(fault) or fault in wrong(outcome)
    assert not (scratch / "outside").exists()
