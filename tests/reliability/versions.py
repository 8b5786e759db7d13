"""Install the wheel with the oldest and the newest libraries allowed, and use it.

Each Python that is at hand gets new environments outside the repository, made by uv. In each the
packages are imported, and the command line explains a robot and computes a small study.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from page import REPOSITORY, table, write_figures

PYTHONS = "3.11", "3.12", "3.13"
RESOLUTIONS = {"lowest-direct": "oldest", "highest": "newest"}
SHOWN = "numpy", "scipy", "numba", "pin", "mujoco", "cvxpy"
PACKAGES = "robotmodels", "estimators", "oed", "reports"
AGREEMENT = 1e-6
"""Relative; estimates of all environments differ by less (the fit's tolerance allows some 1e-8)."""
STUDY = """\
schema: study/1
robot: manutec_r3
seed: 1
frequencies: {low: 2.0, high: 30.0, count: 20, spacing: log}
noise: {relative: 0.03, floor: 0.01}
candidates: {sobol: 8}
design: {criterion: D, experiments: 3, solver: cvxpy}
fit: {residuals: [nls], decades: 0.1, starts: 1}
compare: {runs: 0}
posterior: {ensembles: 2, walkers: 32, steps: 100}
output: results
"""


class Failed(Exception):
    """A step that did not work, with the last lines it printed."""


def run(*words: object, folder: Path | None = None) -> str:
    """Run a command without this repository on its path; return its output."""
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(
        [str(word) for word in words], cwd=folder, env=clean, capture_output=True, text=True
    )
    if done.returncode:
        raise Failed("\n".join((done.stderr or done.stdout).splitlines()[-5:]))
    return done.stdout


def interpreter(version: str) -> str | None:
    """Return the path of a Python that works, from the search path or pyenv."""
    kept = sorted(Path.home().glob(f".pyenv/versions/{version}*/bin/python"))
    for candidate in (*kept, f"python{version}"):
        try:
            run(candidate, "-c", "")
        except (Failed, OSError):
            continue
        return str(candidate)
    return None


def tried(python: str, resolution: str, wheel: Path, folder: Path) -> tuple[dict[str, str], list]:
    """Install and use the wheel in a new environment; return versions and the fit's estimates."""
    bin = folder / "environment" / "bin"
    run("uv", "venv", "--quiet", "--python", python, bin.parent)
    # The lowest versions are those of what the project itself names, not of the wheel alone.
    pinned, project = folder / "requirements.txt", REPOSITORY / "pyproject.toml"
    compiled = "uv", "pip", "compile", "--quiet", "--python", bin / "python"
    run(*compiled, "--resolution", resolution, "--output-file", pinned, project)
    run("uv", "pip", "install", "--quiet", "--python", bin / "python", "-r", pinned, wheel)
    listed = json.loads(run("uv", "pip", "list", "--python", bin / "python", "--format", "json"))
    home = run(
        bin / "python",
        "-c",
        f"import {', '.join(PACKAGES)}; print(*(m.__file__ for m in ({', '.join(PACKAGES)})))",
        folder=folder,
    )
    assert all(path.startswith(str(bin.parent)) for path in home.split()), home
    assert "elbow" in run(bin / "oed", "check", "ur10", folder=folder)
    (folder / "study.yaml").write_text(STUDY, encoding="utf-8")
    run(bin / "oed", "run", "study.yaml", "--workers", 1, folder=folder)
    fit = json.loads((folder / "results" / "fit.json").read_text(encoding="utf-8"))
    return (
        {one["name"]: one["version"] for one in listed},
        [row["estimate"] for row in fit["parameters"]],
    )


def main() -> int:
    """Try all environments, write what came of them, and return how many failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="figures into docs/reliability.md")
    write = parser.parse_args().write
    rows, failures, reference = [], 0, None
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.rmtree(REPOSITORY / "build", ignore_errors=True)  # else its modules get in as well
        run("uv", "build", "--quiet", "--wheel", "--out-dir", folder, REPOSITORY)
        (wheel,) = folder.glob("*.whl")
        for version in PYTHONS:
            python = interpreter(version)
            if python is None:
                rows.append([version, "–", *["–"] * len(SHOWN), "untried: no interpreter at hand"])
                continue
            for resolution, words in RESOLUTIONS.items():
                print(f"Python {version}, {words} libraries ...", flush=True)
                here = folder / f"{version}-{resolution}"
                here.mkdir()
                versions, outcome = dict.fromkeys(SHOWN, "–"), "passed"
                try:
                    versions, estimates = tried(python, resolution, wheel, here)
                    reference = reference or estimates
                    apart = max(abs(a / b - 1) for a, b in zip(estimates, reference, strict=True))
                    if not apart < AGREEMENT:
                        raise Failed(f"estimates differ by {apart:.1e}")
                except (Failed, AssertionError) as error:
                    failures, outcome = failures + 1, "**failed**"
                    print(error, file=sys.stderr)
                rows.append([version, words, *(versions[name] for name in SHOWN), outcome])
    lines = table(["Python", "libraries", *SHOWN, "result"], rows)
    print(*lines, sep="\n")
    if write:
        write_figures("versions", lines)
    return min(failures, 1)


if __name__ == "__main__":
    sys.exit(main())
