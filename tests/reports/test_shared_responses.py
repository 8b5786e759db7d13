"""FRFs of studies laid over each other: which positions and lines, of data or of fits."""

import json
import re
from types import SimpleNamespace

import numpy as np
from robots import HERE

import robotmodels
from reports.sections import shared_responses

ROBOT = robotmodels.load_robot(HERE / "two_joints.yaml")
POSITIONS = np.deg2rad([[-45.0, 20.0], [-90.0, 40.0], [-120.0, -30.0]])
OMEGA = 2 * np.pi * np.array([3.0, 5.0, 8.0, 13.0, 21.0])


def study(seed, positions=POSITIONS, omega=OMEGA, robot=ROBOT, runs=False, factor=1.0):
    """Return what the section reads of a study's results."""
    G = robotmodels.frequency_response(ROBOT, positions, omega)
    noise = np.random.default_rng(seed).standard_normal(G.shape)
    frf = SimpleNamespace(
        positions=positions,
        omega=omega,
        response=G * (1 + 0.01 * noise),
        variance=(0.01 * np.abs(G)) ** 2,
    )
    values = np.asarray(ROBOT.parameters.values) * factor
    return SimpleNamespace(
        robot=robot,
        study=SimpleNamespace(fits_runs=runs),
        data=SimpleNamespace(frf=frf),
        fits=SimpleNamespace(result=SimpleNamespace(parameters=SimpleNamespace(values=values))),
        responses=None,
    )


def read(page):
    return json.loads(re.search(r'class="responses">(.*?)</script>', page)[1])


def test_positions_and_lines_in_common_are_laid_over_each_other():
    other = study(2, POSITIONS[[2, 0]], OMEGA[[1, 3, 4]])
    page = shared_responses.section({"one": study(1), "two": other}).body
    labels = re.findall(r"<h3>(.*?)</h3>", page)
    assert labels == [
        "Position 1 of one, 2 of two: −45°, 20°",
        "Position 3 of one, 1 of two: −120°, −30°",
    ]
    assert page.count("stroke-dasharray") == 4  # magnitudes and phases of the other
    assert "the measured responses" in page
    assert "fitted models" not in page
    content = read(page)
    np.testing.assert_allclose(content["frequency"], OMEGA[[1, 3, 4]] / (2 * np.pi))
    assert content["element"]["names"] == [["one", "two"], ["one", "two"]]
    assert content["element"]["paired"]


def test_of_the_same_data_the_fits_are_drawn():
    page = shared_responses.section({"one": study(1), "two": study(1, factor=1.2)}).body
    assert "fitted models" in page
    content = read(page)
    assert content["measured"] != content["model"]


def test_what_cannot_be_compared_is_told_in_one_line():
    other_motors = SimpleNamespace(motor_names=("a", "b"))
    cases = {
        "they need FRFs, and runs are fitted": study(2, runs=True),
        "their motor names differ": study(2, robot=other_motors),
        "they have no position in common": study(2, POSITIONS + 0.01),
        "they have no frequency in common": study(2, omega=OMEGA * 1.01),
    }
    for reason, other in cases.items():
        page = shared_responses.section({"one": study(1), "two": other}).body
        assert f"responses of one and two are not compared: {reason}.</p>" in page
        assert "<svg" not in page
    page = shared_responses.section({"one": study(1), "two": other, "three": study(3)}).body
    assert "one and two are not compared" in page
    assert len(re.findall("<h3>", page)) == 3
