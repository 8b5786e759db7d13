"""Count the files that one candidate position and one file of records pass through.

    python benchmarks/trace_files.py

A file holds a position if one of its functions ends while a marked number is in its hands: as an
argument, a local variable or the result, in arrays and lists of any depth. It holds an object with
the position if that is in a field of one of these, and carries one if it is a field further down.
One position is of a study file, followed by `oed run` to the page of the report; the other is that
of a file of records, followed by `oed frf` to the page of its FRFs. Templates count as files.
"""

import contextlib
import io
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = tuple(f"{ROOT / name}/" for name in ("robotmodels", "estimators", "oed", "reports"))
MARK = -1.234567890123
"""An angle that no other number equals."""
LEVELS = "held itself", "in a field of an object held", "in a field of such a field"
MOST_ITEMS = 64

ROBOT = (ROOT / "tests" / "engines" / "two_joints.yaml").read_text(encoding="utf-8")
STUDY = f"""\
schema: study/1
robot: robot.yaml
frequencies: {{low: 3.0, high: 60.0, count: 12, spacing: log}}
noise: {{relative: 0.03, floor: 0.01}}
candidates:
  positions: [[{MARK!r}, 1.5], [-0.9, -1.1], [-2.0, 0.4]]
design: {{experiments: 3}}
fit: {{residuals: [nls], decades: 0.2, starts: 1}}
compare: {{runs: 0}}
posterior: {{ensembles: 2, walkers: 16, steps: 50}}
output: results
"""


def holds(value: Any, depth: int) -> bool:
    """Return whether the marked number is in a value, or in fields up to `depth` levels below."""
    if isinstance(value, float):
        return value == MARK
    if isinstance(value, np.ndarray):
        return value.dtype.kind == "f" and bool((value == MARK).any())
    if isinstance(value, tuple | list):
        return any(holds(item, depth) for item in value[:MOST_ITEMS])
    if isinstance(value, dict):
        return len(value) <= MOST_ITEMS and any(holds(item, depth) for item in value.values())
    if depth == 0 or isinstance(value, type):
        return False
    module = getattr(type(value), "__module__", "").partition(".")[0]
    if module not in ("robotmodels", "estimators", "oed", "reports"):
        return False
    return any(holds(item, depth - 1) for item in getattr(value, "__dict__", {}).values())


@contextlib.contextmanager
def traced() -> Iterator[dict[str, int]]:
    """Give the files that the marked number passes through meanwhile, with the least depth."""
    files: dict[str, int] = {}

    def look(frame: FrameType, event: str, value: Any) -> None:
        name = frame.f_code.co_filename
        if event != "return" or not name.startswith(PACKAGES):
            return
        values = [value, *frame.f_locals.values()]
        for depth in range(files.get(name, len(LEVELS))):
            if any(holds(item, depth) for item in values):
                files[name] = depth
                return

    sys.setprofile(look)
    try:
        yield files
    finally:
        sys.setprofile(None)


def run(*words: object) -> None:
    """Run the command line in this process."""
    from reports import cli

    sys.argv = ["oed", *map(str, words)]
    errors = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(errors):
        try:
            cli.main()
        except SystemExit as ended:
            if ended.code:
                raise SystemExit(errors.getvalue()) from None


def show(title: str, files: dict[str, int]) -> None:
    """Print how many files there are, and which."""
    print(title)
    for depth, words in enumerate(LEVELS):
        names = sorted(name for name, least in files.items() if least == depth)
        print(f"  {words}: {len(names)} files")
        for name in names:
            print("    ", Path(name).relative_to(ROOT))


def main() -> None:
    """Trace both in a folder of their own."""
    with tempfile.TemporaryDirectory() as folder:
        there = Path(folder)
        (there / "robot.yaml").write_text(ROBOT, encoding="utf-8")
        (there / "study.yaml").write_text(STUDY, encoding="utf-8")
        with traced() as files:
            run("run", there / "study.yaml", "--workers", 1)
        show("A candidate position, from the study file to the page", files)
        save_records(there)
        with traced() as files:
            run("frf", there / "records.h5", "-o", there, "--robot", there / "robot.yaml")
        show("A file of records, to the page of its FRFs", files)


def save_records(folder: Path) -> None:
    """Write records of two motors in the marked position: white torques, angles of two inertias."""
    from robotmodels import Records

    rng, samples = np.random.default_rng(0), 256
    shape = (1, 3, 2, 2, samples, 2)
    lines = np.arange(1, 64, 2)
    torque = np.fft.irfft(np.where(_excited(samples, lines), 1.0, 0.0), samples) * samples / 16
    signs = np.array([[1.0, 1.0], [1.0, -1.0]])[:, None, None, :]
    torque = np.broadcast_to(signs * torque[:, None], shape) + 1e-3 * rng.standard_normal(shape)
    rate = 2j * np.pi * np.fft.rfftfreq(samples, 1e-3)[:, None]
    squared = np.where(rate == 0, np.inf, rate**2)
    angle = np.fft.irfft(np.fft.rfft(torque, axis=-2) / squared / 3e-4, samples, axis=-2)
    Records(
        positions=np.array([[MARK, 1.5]]),
        sample_time=1e-3,
        reference=np.broadcast_to(torque[..., :1, :, :], (1, 3, 2, 1, samples, 2)),
        torque=torque,
        angle=angle,
        lines=lines,
        detection=np.array([], dtype=int),
        saturated=np.zeros((1, 3, 2, 2, 2), dtype=bool),
    ).save(folder / "records.h5")


def _excited(samples: int, lines: Any) -> Any:
    return np.isin(np.arange(samples // 2 + 1), lines)


if __name__ == "__main__":
    main()
