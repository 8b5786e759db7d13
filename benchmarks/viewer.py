"""What a person waits for in `oed view`: until it starts, is drawn, and follows a move or a click.

    python benchmarks/viewer.py [--repeats 3]

writes `benchmarks/results/viewer.json`. Two studies of a UR10, whose plans are computed first: that
of `studies/ur10.yaml`, and one of about 20 000 candidates. Of each, the least of the repeats:

- start: from the command to the line with the address, by the clock and in processor time; the goal
  is 3 s on a machine that does nothing else;
- drawn: from opening the address in a headless Chromium, which renders without a graphics
  processor, to the words about the position;
- move: a changed position, with modes, FRF, its band and the gain of a visit (processor time);
- click: the candidate nearest to a ray (processor time).
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from linearisation import HERE, machine
from playwright.sync_api import sync_playwright

from oed.study.pipeline import design_study
from oed.study.settings.study_file import load_study
from reports.viewer.view import View
from reports.viewer.viewer import Viewer, serving

STUDY = HERE.parent / "studies" / "ur10.yaml"
RESULTS = HERE / "results" / "viewer.json"
MANY = {"shoulder_pan": 5, "shoulder_lift": 6, "elbow": 6, "wrist_1": 6, "wrist_2": 5, "wrist_3": 5}
"""Angles per joint of the larger study, of which about half are rejected."""
PORT = 8470


def write_study(folder: Path, many: bool) -> Path:
    """Write the study, with more angles per joint if `many`, and design its plan."""
    text = STUDY.read_text(encoding="utf-8").replace("../out/ur10", "out")
    lines = text.splitlines()
    if many:
        for i, line in enumerate(lines):
            name = line.strip().split("_joint: ")[0]
            if name in MANY and "[" not in line:
                lines[i] = f"    {name}_joint: {MANY[name]}"
    path = folder / "study.yaml"
    path.write_text("\n".join(lines), encoding="utf-8")
    subprocess.run([sys.executable, "-m", "reports.cli", "--quiet", "design", path], check=True)
    return path


def started(study: Path, browser: Any) -> dict[str, float]:
    """Return what one start takes [s]."""
    begun = time.perf_counter()
    line = [sys.executable, "-m", "reports.cli", "view", str(study), "--port", str(PORT)]
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True) as viewer:
        address = viewer.stdout.readline().split()[0]
        wall = time.perf_counter() - begun
        fields = Path(f"/proc/{viewer.pid}/stat").read_text().rsplit(")", 1)[1].split()
        cpu = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        begun, page = time.perf_counter(), browser.new_page()
        page.goto(address)
        page.get_by_text("One more visit here").wait_for(timeout=120_000)
        drawn = time.perf_counter() - begun
        page.close()
        viewer.send_signal(signal.SIGINT)
    return {"start_wall_s": wall, "start_cpu_s": cpu, "drawn_wall_s": drawn}


def followed(study: Path) -> dict[str, float]:
    """Return the least processor time of a move and of a click [s]."""
    view, moves, clicks = View.of_study(design_study(load_study(study))), [], []
    with serving(PORT) as server:
        viewer = Viewer(view, server)
        viewer.step(0.0)
        for position in view.candidates[:: len(view.candidates) // 8]:
            begun = time.thread_time()
            viewer.controls.position = position
            viewer.step(0.0)
            moves.append(time.thread_time() - begun)
            begun = time.thread_time()
            viewer._candidates.picked(np.array([2.0, -2.0, 1.0]), np.array([-1.0, 1.0, -0.2]))
            clicks.append(time.thread_time() - begun)
    return {
        "move_cpu_s": min(moves),
        "click_cpu_s": min(clicks),
        "candidates": len(view.candidates),
    }


def main() -> None:
    """Print the table and write the results."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--repeats", type=int, default=3)
    repeats, results = parser.parse_args().repeats, {}
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path="/usr/bin/chromium", args=["--no-sandbox", "--disable-gpu"]
        )
        for name in ("ur10", "many"):
            with tempfile.TemporaryDirectory() as folder:
                study = write_study(Path(folder), name == "many")
                runs = [started(study, browser) for _ in range(repeats)]
                least = {key: min(run[key] for run in runs) for key in runs[0]}
                results[name] = least | followed(study)
            print(name, {key: round(value, 4) for key, value in results[name].items()}, flush=True)
        browser.close()
    RESULTS.parent.mkdir(exist_ok=True)
    content = {"machine": machine(), "repeats": repeats, "studies": results}
    RESULTS.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
