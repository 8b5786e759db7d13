"""A study of two joints, small enough to run again and again."""

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from command_line import oed
from markupsafe import Markup

from reports import page_elements
from reports.figures import svg

ROBOT = (Path(__file__).parents[1] / "engines" / "two_joints.yaml").read_text(encoding="utf-8")

STUDY = """\
schema: study/1
robot: robot.yaml
seed: 3
frequencies: {low: 3.0, high: 60.0, count: 12, spacing: log}
noise: {relative: 0.03, floor: 0.01}
candidates:
  per_joint: {shoulder_lift_joint: 4, elbow_joint: 5}
  limits: {shoulder_lift_joint: [-2.5, -0.5], elbow_joint: [-2.5, 2.5]}
design: {criterion: D, experiments: 5, tolerance: 1.0e-6}
fit: {residuals: [lls, nls], decades: 0.2, starts: 2}
compare: {random: 1, runs: 12}
posterior: {ensembles: 2, walkers: 16, steps: 400}
output: results/here
"""


def write_study(folder: Path, study: str = STUDY, robot: str = ROBOT) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.yaml").write_text(robot, encoding="utf-8")
    path = folder / "study.yaml"
    path.write_text(study, encoding="utf-8")
    return path


@contextlib.contextmanager
def drawn(wanted: str = "nothing") -> Iterator[None]:
    """Leave pages without pictures but those whose id begins as the pattern `wanted` says.

    Drawing takes most of a page's time. The small study's report has every picture; of the pages
    of other studies, tests judge the words and want only the pictures that the small one lacks.
    """
    inline = svg.inline

    def maybe(draw, name, alt):
        if re.match(f"in-({wanted})", name):
            return inline(draw, name, alt)
        return Markup('<svg id="{}"></svg>').format(name)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page_elements, "inline", maybe)
        yield


@pytest.fixture(scope="session")
def small_study(tmp_path_factory):
    """Folder of the results, and what the command said."""
    folder = tmp_path_factory.mktemp("study")
    code, out, err = oed("run", write_study(folder), "--workers", 1)
    assert (code, err) == (0, "")
    return folder / "results" / "here", out
