"""A user's mistake: one clear line that names the file, exit code 2, nothing half-written."""

import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures.process import BrokenProcessPool

import pytest
from command_line import oed
from conftest import ROBOT, STUDY, write_study

from estimators.sampling.log_posterior import LogPosterior

FOUR_SPRINGS = ROBOT + (
    "  - {name: b3x, joint: elbow_joint, axis: x, stiffness: 5.0e4, damping: 50}\n"
    "  - {name: b3z, joint: elbow_joint, axis: z, stiffness: 5.0e4, damping: 50}\n"
)
ONE_LINE = STUDY.replace("high: 60.0, count: 12", "high: 60.0, count: 1")
ONE_CANDIDATE = ONE_LINE.replace("shoulder_lift_joint: 4, elbow_joint: 5", "elbow_joint: 1")

ENDLESS = STUDY.replace("steps: 400", "steps: 1000000, ess: 1.0e+9")

STUDY_MISTAKES = {
    "unknown robot": ("robot: robot.yaml", "robot: ur11", ["'ur11'", "'ur10'"]),
    "absent robot file": ("robot: robot.yaml", "robot: robt.yaml", ["robt.yaml", "no such file"]),
    "malformed YAML": ("seed: 3", "seed: [3", ["study.yaml:4: not valid YAML"]),
    "unknown key": ("experiments: 5", "experimnts: 5", ["'design.experimnts'", "'experiments'"]),
    "unknown section": ("posterior:", "posteriour:", ["'posteriour'", "'posterior'"]),
    "missing key": ("high: 60.0, ", "", ["missing key 'frequencies.high'"]),
    "wrong type": ("relative: 0.03", "relative: much", ["noise.relative", "'much'"]),
    "empty grid": ("elbow_joint: 5}", "elbow_joint: 0}", ["per_joint.elbow_joint", "0"]),
    "huge grid": ("elbow_joint: 5}", "elbow_joint: 5000000}", ["20000000 positions", "at most"]),
    "far starts": ("decades: 0.2", "decades: 5", ["fit.decades", "less than 3", "5"]),
    "no frequency": ("count: 12", "count: 0", ["frequencies.count", "0"]),
    "falling frequencies": ("high: 60.0", "high: 2.0", ["frequencies", "above low"]),
    "unknown joint": ("elbow_joint: 5}", "elbow: 5}", ["'elbow'", "'elbow_joint'"]),
    "outside limits": ("[-2.5, 2.5]", "[-9.0, 2.5]", ["elbow_joint", "-9"]),
    "unknown residual": ("[lls, nls]", "[lls, mls]", ["fit.residuals", "'mls'"]),
    "residual twice": ("[lls, nls]", "[lls, lls]", ["fit", "once"]),
    "no noise": ("relative: 0.03, floor: 0.01", "relative: 0, floor: 0", ["noise", "positive"]),
    "too few walkers": ("walkers: 16", "walkers: 4", ["posterior.walkers", "4", "8"]),
    "unknown estimator": ("decades: 0.2", "result: LSL, decades: 0.2", ["'LSL'", "lls, nls"]),
    "output is a file": ("output: results/here", "output: robot.yaml", ["output", "folder"]),
}

ROBOT_MISTAKES = {
    "negative stiffness": ("stiffness: 2.5e4", "stiffness: -2.5e4", ["stiffness", "-25000"]),
    "joint not in the URDF": (
        "{name: m3, joint: elbow_joint",
        "{name: m3, joint: elbw_joint",
        ["'elbw_joint'", "'elbow_joint'", "there are shoulder_lift_joint"],
    ),
}


def refused(path, words, stages=()):
    """Run a study that cannot be computed; only the stages before the fault may be left."""
    before = sorted(path.parent.rglob("*"))
    code, out, err = oed("run", path, "--workers", 1)
    assert code == 2
    assert out == ""
    assert err.startswith("error: ")
    assert len(err.splitlines()) == 1
    for word in words:
        assert word in err, err
    if stages:
        assert finished(path) == set(stages)
    else:
        assert sorted(path.parent.rglob("*")) == before


def finished(path):
    """Return the stages of a study that ended early; nothing else may be in its output."""
    output = path.parent / "results" / "here"
    assert [p.name for p in output.iterdir()] == ["stages"]
    return {p.name for p in (output / "stages").iterdir()}


@pytest.mark.parametrize("mistake", STUDY_MISTAKES)
def test_mistake_in_the_study(mistake, tmp_path):
    right, wrong, words = STUDY_MISTAKES[mistake]
    assert right in STUDY
    refused(write_study(tmp_path, STUDY.replace(right, wrong, 1)), words)


@pytest.mark.parametrize("mistake", ROBOT_MISTAKES)
def test_mistake_in_the_robot(mistake, tmp_path):
    right, wrong, words = ROBOT_MISTAKES[mistake]
    assert right in ROBOT
    refused(write_study(tmp_path, robot=ROBOT.replace(right, wrong, 1)), ["robot.yaml", *words])


def test_absent_study(tmp_path):
    refused(tmp_path / "study.yaml", ["study.yaml", "no such file"])


def test_singular_design_names_the_parameters(tmp_path):
    path = write_study(tmp_path, ONE_CANDIDATE, FOUR_SPRINGS)
    refused(path, ["not identifiable", "b3z.damping"], ["candidates", "information"])


def test_too_few_experiments(tmp_path):
    study = ONE_LINE.replace("experiments: 5", "experiments: 1")
    path = write_study(tmp_path, study, FOUR_SPRINGS)
    refused(path, ["not identifiable", "too few", "2"], ["candidates", "information"])


def test_a_run_interrupted_at_once_leaves_nothing(tmp_path, monkeypatch):
    def interrupted(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr("oed.study.pipeline.run_study", interrupted)
    path = write_study(tmp_path)
    code, out, err = oed("run", path, "--workers", 1)
    assert (code, out) == (130, "")
    assert err == "interrupted; run the same command again to continue\n"
    assert {p.name for p in tmp_path.iterdir()} == {"study.yaml", "robot.yaml"}


@pytest.fixture
def endless(small_study, tmp_path):
    """Return a study whose sampling has no end and whose other stages are there already."""
    path = write_study(tmp_path, ENDLESS)
    for stage in (small_study[0] / "stages").iterdir():
        if stage.name not in ("posterior", "profiles", "cross-check"):
            shutil.copytree(stage, tmp_path / "results" / "here" / "stages" / stage.name)
    return path


@pytest.mark.parametrize("workers", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_a_terminated_run_keeps_whole_stages_and_what_the_next_run_goes_on_from(workers, endless):
    command = [sys.executable, "-m", "reports.cli", "run", str(endless), "--workers", str(workers)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
        try:
            while run.poll() is None and not list(endless.parent.rglob("posterior.h5")):
                time.sleep(0.1)
            run.terminate()
        except BaseException:
            run.kill()
            raise
    assert run.returncode == 128 + signal.SIGTERM
    assert {"result", "uncertainty", "posterior.part"} < finished(endless)
    assert "posterior" not in finished(endless)


# The call that the signal meets is one of compiled code, qsort's, which drops exceptions.
MET = """
import ctypes, os, signal, sys
from estimators.sampling.log_posterior import LogPosterior
from reports import cli

density, calls = LogPosterior.__call__, 0
compared = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)

def called_back(a, b):
    os.kill(os.getpid(), signal.SIGTERM)
    sum(range(1000))  # time for a handler
    return 0

def met(*arguments):
    global calls
    calls += 1
    if calls == 50:
        ctypes.CDLL(None).qsort(ctypes.create_string_buffer(2), 2, 1, compared(called_back))
    return density(*arguments)

LogPosterior.__call__ = met
sys.argv = ["oed", "--quiet", "run", PATH, "--workers", "1"]
cli.main()
"""


def test_a_signal_while_compiled_code_calls_back_ends_in_order(endless):
    program = MET.replace("PATH", repr(str(endless)))
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (run.returncode, run.stdout, run.stderr) == (128 + signal.SIGTERM, "", "")
    assert "posterior.part" in finished(endless)
    assert "posterior" not in finished(endless)


def test_an_interrupt_amid_the_sampling_ends_without_a_traceback(endless, monkeypatch):
    calls = 0
    log_probability = LogPosterior.__call__

    def interrupted(*arguments):
        nonlocal calls
        calls += 1
        if calls == 50:
            raise KeyboardInterrupt
        return log_probability(*arguments)

    monkeypatch.setattr(LogPosterior, "__call__", interrupted)
    code, out, err = oed("run", endless, "--workers", 1)
    assert (code, out, err) == (130, "", "interrupted; run the same command again to continue\n")
    assert "posterior.part" in finished(endless)


def test_killed_worker_is_one_line(tmp_path, monkeypatch):
    def killed(*args, **kwargs):
        raise BrokenProcessPool

    monkeypatch.setattr("oed.study.pipeline.run_study", killed)
    code, out, err = oed("run", write_study(tmp_path), "--workers", 1)
    assert (code, out) == (1, "")
    assert err.startswith("error: a worker process was killed")
    assert len(err.splitlines()) == 1


def test_unknown_option_and_command_end_with_2():
    assert oed("run", "--sped", "x")[0] == 2
    assert oed("rnu")[0] == 2
