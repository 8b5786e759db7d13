"""What a study warns of before it fits."""

import logging

import pytest

from oed.study.pipeline import fit_study
from oed.study.settings.study_file import load_study
from robotmodels import IdentificationError

STUDY = """\
schema: study/1
robot: moberg_axis1
frequencies: {low: 2, high: 30, count: COUNT, spacing: log}
noise: {relative: 0.03, floor: 0.01}
candidates: {sobol: 4}
design: {experiments: 4}
fit: {residuals: [nls], starts: 1, decades: 0}
output: results
"""


def warned(folder, count, caplog, design=""):
    """Return what is warned of before the fits, and the error that follows, if any."""
    path = folder / "study.yaml"
    path.write_text(STUDY.replace("COUNT", str(count)).replace("ments: 4", f"ments: 4{design}"))
    caplog.clear()
    told: list[str] = []

    def progress(stage, *_):
        if stage.startswith("fit"):
            told.extend(caplog.messages)
            raise KeyboardInterrupt

    with caplog.at_level(logging.WARNING, logger="oed"):
        try:
            fit_study(load_study(path), progress)
        except (KeyboardInterrupt, IdentificationError) as error:
            return (told, "") if told or count > 2 else (caplog.messages, str(error))
    raise AssertionError("no fit began")


@pytest.mark.parametrize("count", [2, 30])
def test_fewer_data_than_parameters_are_said_before_the_design(tmp_path, caplog, count):
    messages, error = warned(tmp_path, count, caplog)
    few = [m for m in messages if m.startswith("frequencies: 2 of 1 responses are 4 real data")]
    assert bool(few) == (count == 2)
    assert bool(error) == (count == 2)
    assert "not identifiable" in error or count > 2


@pytest.mark.parametrize("design", ["", ", solver: newton, robust: {std: 0.1, samples: 2}"])
def test_weak_combinations_are_said_before_the_fits(tmp_path, caplog, design):
    messages, _ = warned(tmp_path, 3, caplog, design)
    assert any(m.startswith("the plan is weak: a3.damping^") for m in messages)
    assert any("more frequencies" in m for m in messages)
