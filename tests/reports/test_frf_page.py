"""The page of measured FRFs, from records whose linear part and distortion are known."""

import re
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest
from markupsafe import Markup

from estimators.frf.frf_from_records import measured_frf
from reports.figures.frf_figures import decibels
from reports.pages.frf_page import level_table, write_frf_page
from reports.summaries.frf_summary import excess, frf_summary
from robotmodels.common.errors import InvalidInput
from robotmodels.records.records import Records
from robotmodels.simulation.loop_noise import hold_response

SAMPLES, T, BLOCKS, PERIODS = 200, 0.005, 6, 3
LINES, DETECTION = np.array([1, 3, 7, 9, 13, 15, 19]), np.array([5, 11, 17])
NOISE, DISTORTION = 2e-7, 2e-5
VOID = {"meta", "link", "br", "img"}


def records(distortion=0.0, blocks=BLOCKS, periods=PERIODS, positions=1):
    """Return records of two motors in open loop; distortion is the same in every period."""
    rng = np.random.default_rng(8)
    shape = (positions, blocks, 2, SAMPLES // 2 + 1, 2)
    phases = np.exp(2j * np.pi * rng.random((positions, blocks, len(LINES), 2)))
    torque = np.zeros(shape, dtype=complex)
    for experiment, signs in enumerate(([1, 1], [1, -1])):
        torque[:, :, experiment, LINES] = phases * signs * SAMPLES / 2
    omega = 2 * np.pi * np.arange(1, SAMPLES // 2 + 1) / (SAMPLES * T)
    G = np.array([[20.0, -4.0], [-3.0, 9.0]]) * (1 + 0.2j)
    angle = np.zeros_like(torque)
    held = hold_response(omega, T)[:, None] * torque[..., 1:, :]
    angle[..., 1:, :] = -(held @ G.T) / omega[:, None] ** 2
    odd = np.union1d(LINES, DETECTION)
    kick = rng.standard_normal((2, *shape))[..., odd, :]
    angle[..., odd, :] += distortion * (kick[0] + 1j * kick[1]) * SAMPLES / 2
    time = np.fft.irfft(angle, SAMPLES, axis=-2)[:, :, :, None]
    time = time + NOISE * rng.standard_normal((positions, blocks, 2, periods, SAMPLES, 2))
    torques = np.fft.irfft(torque, SAMPLES, axis=-2)[:, :, :, None]
    return Records(
        positions=0.5 * np.arange(positions)[:, None] * [1.0, 0.0],
        sample_time=T,
        reference=torques,
        torque=np.broadcast_to(torques, time.shape),
        angle=time,
        lines=LINES,
        detection=DETECTION,
        saturated=np.zeros((positions, blocks, 2, periods, 2), dtype=bool),
    )


class Outline(HTMLParser):
    def __init__(self):
        super().__init__()
        self.ids, self.links, self.open, self.sources = [], [], [], []

    def handle_starttag(self, tag, attrs):
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        attrs = dict(attrs)
        self.ids += [attrs["id"]] if "id" in attrs else []
        self.links += [attrs["href"]] if tag == "a" else []
        self.sources += [attrs["src"]] if "src" in attrs else []

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def shown(found, folder):
    path = folder / "frf.html"
    write_frf_page(found, folder / "bench.h5", path)
    text = path.read_text(encoding="utf-8")
    outline = Outline()
    outline.feed(text)
    assert outline.open == []
    return text, outline


@pytest.fixture(scope="module")
def distorted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("frf")
    records(DISTORTION, positions=2).save(folder / "bench.h5")
    found = measured_frf(folder / "bench.h5", compare=True, runs=20)
    return found, *shown(found, folder)


@pytest.fixture
def undrawn(monkeypatch):
    """Leave figures empty where only words are looked at."""
    monkeypatch.setattr("reports.page_elements.inline", lambda *_: Markup("<svg></svg>"))


def test_sections_resolve_and_ids_are_unique(distorted):
    _, _, outline = distorted
    assert len(set(outline.ids)) == len(outline.ids)
    assert [link for link in outline.links if not link.startswith("#term-")] == [
        "#content",
        "#summary",
        "#responses",
        "#distortion",
        "#levels",
        "#excitation",
        "#methods",
    ]
    assert {link[1:] for link in outline.links} <= set(outline.ids)
    assert {"frf-1", "frf-2", "detection-1", "detection-2"} <= set(outline.ids)


def test_page_needs_nothing_else(distorted):
    _, text, outline = distorted
    assert all(source.startswith("data:") for source in outline.sources)
    assert "http" not in text.replace("http://www.w3.org/2000/svg", "")
    assert not re.search(r"url\((?!#)", text)
    assert "nan" not in re.sub(r"<[^>]*>", " ", text).lower().split()


def curves(figure, colour):
    """Count the curves of a colour."""
    return sum(
        path.count("M")
        for path in re.findall(rf'd="([^"]*)" fill="none" stroke="var\(--{colour}\)"', figure)
    )


def test_every_element_has_its_curves(distorted):
    _, text, _ = distorted
    figure = text[text.index('id="frf-1"') : text.index('id="frf-2"')]
    for word in ("from motor 1", "from motor 2", "to motor 1", "to motor 2", "frequency [Hz]"):
        assert word in figure
    assert curves(figure, "accent") >= 8  # measured magnitudes and phases
    assert curves(figure, "ink") >= 4  # distortion
    assert "var(--second)" not in figure  # no robot, no model


def test_the_first_run_is_shown(distorted):
    _, text, _ = distorted
    figure = text[text.index('id="first-run"') :]
    figure = figure[: figure.index("</figure>")]
    assert "crest" in figure
    assert "spectrum [N m]" in text


def test_distortion_is_told_from_noise(distorted, tmp_path):
    found, text, _ = distorted
    assert excess(found) > 100
    assert "by friction, backlash and gears" in text
    records(0.0).save(tmp_path / "bench.h5")
    linear = measured_frf(tmp_path / "bench.h5")
    assert 0.5 < excess(linear) < 2
    assert all(level.value > -60 for level in odd_levels(found))
    assert all(level == "in noise" or level.value < -60 for level in odd_levels(linear))


def odd_levels(found):
    shown = level_table(found)
    column = [column.title for column in shown.columns].index("odd [dB]")
    return [row[column] for _, rows in shown.groups for row in rows]


def test_methods_are_ranked(distorted):
    found, text, _ = distorted
    said = frf_summary(found, [])
    order = [line.split()[0] for line in said.splitlines()[-5:]]
    scores = dict(zip(found.comparison.methods, found.comparison.scores, strict=True))
    assert order == sorted(order, key=scores.get)
    assert set(order) == {"ari", "har", "log", "h1", "jio"}
    assert text.index(order[0].upper() + "</th>") < text.index(order[-1].upper() + "</th>")


def test_one_period_has_no_distortion_section(tmp_path):
    records(0.0, periods=1).save(tmp_path / "bench.h5")
    found = measured_frf(tmp_path / "bench.h5")
    text, outline = shown(found, tmp_path)
    assert "distortion" not in outline.ids
    assert "One measured period" in text
    assert "times that of noise" not in frf_summary(found, [])


@pytest.mark.usefixtures("undrawn")
def test_one_block_gives_noise_only(tmp_path):
    records(0.0, blocks=1).save(tmp_path / "bench.h5")
    with pytest.raises(InvalidInput, match="one block"):
        measured_frf(tmp_path / "bench.h5")
    found = measured_frf(tmp_path / "bench.h5", covariance="noise")
    text, _ = shown(found, tmp_path)
    assert "noise only, from periods" in text
    assert "variance, total over noise" not in text


def test_robot_with_other_motors_is_refused(tmp_path):
    records().save(tmp_path / "bench.h5")
    with pytest.raises(InvalidInput, match=r"bench\.h5: 2 motors; .*'moberg_axis1' has 1: m1"):
        measured_frf(tmp_path / "bench.h5", robot="moberg_axis1")


@pytest.mark.usefixtures("undrawn")
def test_missing_experiments_are_counted(tmp_path):
    whole = records(positions=2)
    torque, angle = whole.torque.copy(), whole.angle.copy()
    torque[1, 2, 0] = angle[1, 2, 0] = np.nan
    replace(whole, torque=torque, angle=angle).save(tmp_path / "bench.h5")
    found = measured_frf(tmp_path / "bench.h5")
    text, _ = shown(found, tmp_path)
    assert found.missing == 1
    assert "1 runs are missing" not in text
    assert "1 run missing" in text
    assert any("blocks 3 lack" in warning for warning in found.warnings)


def test_endless_delay_is_refused(tmp_path):
    with pytest.raises(InvalidInput, match="delay"):
        measured_frf(tmp_path / "bench.h5", delay=float("inf"))


def test_decibels_leave_gaps():
    assert decibels(np.array([10.0, 0.0, 0.1])) == pytest.approx([20, np.nan, -20], nan_ok=True)


@pytest.mark.usefixtures("undrawn")
def test_visits_of_a_position_are_one(tmp_path):
    two = records(positions=2)
    part = tmp_path / "bench.h5"
    replace(two, positions=np.zeros((2, 2))).save(part)
    merged = measured_frf(part)
    assert [v.tolist() for v in merged.visits] == [[0, 1]]
    assert merged.estimate.repetitions.tolist() == [2 * BLOCKS]
    two.save(part)
    apart = measured_frf(part)
    assert len(apart.estimate.positions) == len(apart.distortion.positions) == 2
    mean = apart.estimate.response.mean(axis=0)
    assert merged.estimate.response[0] == pytest.approx(mean)
    assert merged.distortion.noise[0] == pytest.approx(apart.distortion.noise.mean(axis=0) / 2)
    text, _ = shown(merged, tmp_path)
    assert "mean of experiments 1 and 2" in text


def test_structure_of_the_covariance(tmp_path):
    records().save(tmp_path / "bench.h5")
    assert measured_frf(tmp_path / "bench.h5").estimate.has_full_covariance
    variances = measured_frf(tmp_path / "bench.h5", structure="diagonal")
    assert not variances.estimate.has_full_covariance


@pytest.mark.usefixtures("undrawn")
def test_one_experiment_for_two_motors_takes_the_local_method(tmp_path):
    whole = records(blocks=4)
    signals = ("reference", "torque", "angle", "saturated")
    replace(whole, **{name: getattr(whole, name)[:, :, :1] for name in signals}).save(
        tmp_path / "bench.h5"
    )
    with pytest.raises(InvalidInput, match="--local"):
        measured_frf(tmp_path / "bench.h5", local=False)
    with pytest.raises(InvalidInput, match=r"would span 7 of 7 lines; .*oed identify"):
        measured_frf(tmp_path / "bench.h5")
    found = measured_frf(tmp_path / "bench.h5", local=True)
    truth = np.array([[20.0, -4.0], [-3.0, 9.0]]) * (1 + 0.2j)
    assert np.abs(found.estimate.response[0] - truth).max() < 0.01
    text, outline = shown(found, tmp_path)
    assert "models of neighbouring lines" in text
    assert "distortion" not in outline.ids


@pytest.mark.usefixtures("undrawn")
def test_positions_of_prismatic_joints_are_in_metres(tmp_path):
    records().save(tmp_path / "bench.h5")
    found = measured_frf(tmp_path / "bench.h5")
    sliding = SimpleNamespace(
        name="crane",
        motor_names=("m1", "m2"),
        output_names=("m1", "m2"),
        output_units=("rad/s^2", "m/s^2"),
        motor_joints=("turn", "slide"),
        elements=SimpleNamespace(prismatic={"slide"}),
    )
    text, _ = shown(replace(found, robot=sliding), tmp_path)
    assert "0\N{DEGREE SIGN}, 0.000\u202fm" in text
