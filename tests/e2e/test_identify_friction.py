"""Coulomb friction of motors from the command line: guesses that are off, levels that are shown."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from command_line import oed
from conftest import drawn
from rubbing_arm import LEVELS, rubbing_arm, rubbing_records

from robotmodels import load_robot, save_robot
from robotmodels.common.arrays import Array
from robotmodels.exports.robot_files import with_friction, with_values

STUDY = """\
schema: study/1
robot: guesses.yaml
data: {records: records.h5, noise: detection, friction: true}
fit: {starts: 1, decades: 0.1}
posterior: {ensembles: 2, walkers: 16, steps: 60}
profiles: 0
output: results
"""
TRUTH = rubbing_arm().parameters.values


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of records, and of guesses that are off by a factor of two, friction by a half."""
    folder = tmp_path_factory.mktemp("friction")
    factors = 2.0 ** np.array([1, -1, 1, -1, 1, -1])
    guesses = with_friction(with_values(rubbing_arm(), factors * TRUTH), 1.5 * LEVELS)
    save_robot(guesses, folder / "guesses.yaml")
    rubbing_records().save(folder / "records.h5")
    return folder


def check_springs(values: Array) -> None:
    np.testing.assert_allclose(values[:3], TRUTH[:3], rtol=1e-3)
    np.testing.assert_allclose(values[3:], TRUTH[3:], rtol=1e-2)


def test_identify(folder: Path) -> None:
    """Springs and levels, printed and in the identified robot."""
    code, out, err = oed(
        *("identify", folder / "guesses.yaml", folder / "records.h5", "--friction"),
        *("--noise", "detection", "--starts", 2, "--decades", 0.1),
    )
    assert (code, err) == (0, "")
    (written,) = re.findall(r"written +(\S+)", out)
    identified = load_robot(written)
    check_springs(identified.parameters.values)
    for motor, level in zip(identified.file.motors, LEVELS, strict=True):
        assert motor.coulomb == pytest.approx(level, rel=0.01)
        (words,) = re.findall(rf"friction of {motor.name} +(.*)", out)
        assert float(words.split()[0]) == pytest.approx(motor.coulomb, abs=1e-4)
        assert words.endswith(f"robot file {1.5 * level:g})")


def test_a_study(folder: Path) -> None:
    """The same by a study, whose data settle by a search from its starts."""
    (folder / "study.yaml").write_text(STUDY)
    code, _, err = oed("fit", folder / "study.yaml", "--workers", 1)
    assert (code, err) == (0, "")
    rows = json.loads((folder / "results" / "fit.json").read_text())["parameters"]
    check_springs(np.array([row["estimate"] for row in rows]))


@pytest.mark.slow
def test_the_page_of_a_study_shows_levels(folder: Path) -> None:
    (folder / "study.yaml").write_text(STUDY)
    with drawn():
        code, _, err = oed("run", folder / "study.yaml", "--workers", 1)
    assert (code, err) == (0, "")
    page = (folder / "results" / "report.html").read_text(encoding="utf-8")
    (rows,) = re.findall(r'id="friction".*?</table>', page, flags=re.DOTALL)
    assert rows.count("<tr>") == 4
    assert all(name in rows for name in ("m0", "m1", "m2"))
