"""``oed chains``: records to masses, springs and couplings, on one page; mistakes in one line."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from command_line import oed

from estimators.chain_dampers.chains_from_records import measured_chains
from robotmodels.linear.chain_responses import modally_damped
from robotmodels.linear.coupled_chains import CoupledChains
from robotmodels.records.records import Records
from robotmodels.simulation.controller import Controller
from robotmodels.simulation.linear_simulation import simulate_linear

CHAINS = CoupledChains(
    np.array([[1.0, 2.0], [2.0, 1.5]]),
    np.array([[900.0], [2500.0]]),
    np.array([[0, 0.5], [0.5, 0]]),
)
SAMPLES, T, LINES = 1000, 0.005, np.arange(3, 101, 2)


def simulated(blocks=2, second=1.0):
    rng = np.random.default_rng(2)
    phases = np.exp(2j * np.pi * rng.random((blocks, len(LINES), 2)))
    signs = np.array([[1.0, 1.0], [1.0, -1.0]])
    spectrum = np.zeros((blocks, 2, SAMPLES // 2 + 1, 2), dtype=complex)
    spectrum[:, :, LINES] = phases[:, None] * signs[None, :, None, :] * [1.0, second]
    return simulate_linear(
        modally_damped(CHAINS.linear_model(), 0.01),
        np.fft.irfft(spectrum, SAMPLES, axis=2) * SAMPLES / 40,
        Controller(np.array([40.0, 60.0]), np.ones(2), np.full(2, 2.0), T),
        lines=LINES,
        angle_noise=1e-5,
        rng=rng,
        periods=4,
        transient=4,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("chains")
    simulated().save(made / "records.h5")
    return made


@pytest.fixture(scope="module")
def told(folder):
    code, out, err = oed("chains", folder / "records.h5", "-o", folder / "out")
    assert code == 0, err
    return out


def test_summary_proposes_the_number_of_masses(told, folder):
    assert "2 chains of 2 masses (proposed)" in told
    assert re.search(r"K1 +\d", told)
    assert str(folder / "out" / "chains.html") in told
    assert len(told.splitlines()) < 25


def test_numbers_as_a_file(told, folder):
    found = json.loads((folder / "out" / "chains.json").read_text(encoding="utf-8"))
    assert found["names"] == ["m1", "m2", "m3", "m4", "K1", "K2", "m2_4"]
    assert found["values"] == pytest.approx([1, 2, 2, 1.5, 900, 2500, 0.5], rel=0.01)
    assert np.array(found["covariance"]).shape == (7, 7)
    assert found["proposed"]
    assert found["with_dampers"] is not None


def test_the_page_shows_parameters_poles_and_responses(told, folder):
    html = (folder / "out" / "chains.html").read_text(encoding="utf-8")
    for id in ("summary", "parameters", "dampers", "modes", "responses", "order"):
        assert f'<h2 id="{id}">' in html
    assert html.count("<svg") >= 2
    assert not re.search(r'(src|href)="http', html)
    for name in ("m1", "K2", "m2_4", "c1", "friction1", "delay"):
        assert f"<code>{name}</code>" in html
    assert not re.search(r"\bnan\b", re.sub(r"<svg.*?</svg>", "", html, flags=re.S))


def test_json_for_scripts_and_inertias_from_a_data_sheet(folder):
    words = ("--masses", 2, "--motor-inertias", "1,2", "-o", folder / "json", "--json")
    code, out, _ = oed("chains", folder / "records.h5", *words)
    assert code == 0
    found = json.loads(out)
    assert found["std"][0] == found["std"][2] == 0
    assert found["values"][0] == 1
    html = (folder / "json" / "chains.html").read_text(encoding="utf-8")
    assert "given" in html
    assert '<h2 id="order">' not in html


def test_another_number_of_modes_ends_in_one_line_with_a_picture(folder):
    code, out, err = oed("chains", folder / "records.h5", "-n", 3, "-o", folder / "wrong")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert "have 4 resonances, only 2 are found" in err
    picture = folder / "wrong" / "modes.html"
    assert str(picture) in err
    html = picture.read_text(encoding="utf-8")
    assert "2 resonances found, 4 expected" in html
    assert "<svg" in html


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("-n", 1), "n_masses: 1; a chain needs at least 2"),
        (("--position", 2), "position 2; there are positions 1 to 1"),
        (("--motor-inertias", "1;2"), "numbers separated by commas are needed"),
        (("--motor-inertias", "1,-2"), "are not 2 positive numbers"),
    ],
)
def test_mistakes_end_in_one_line(folder, words, message):
    code, _, err = oed("chains", folder / "records.h5", *words, "-o", folder / "no")
    assert code == 2
    assert message in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("blocks", "periods", "experiments", "how"),
    [(1, 1, 2, "local"), (4, 1, 2, "total"), (1, 4, 2, "noise"), (4, 4, 1, "local")],
)
def test_fewer_periods_blocks_or_experiments_still_serve(
    tmp_path, blocks, periods, experiments, how
):
    whole = simulated(blocks=blocks)
    part = replace(
        whole,
        reference=whole.reference[:, :, :experiments],
        torque=whole.torque[:, :, :experiments, :periods],
        angle=whole.angle[:, :, :experiments, :periods],
        saturated=whole.saturated[:, :, :experiments, :periods],
    )
    part.save(tmp_path / "records.h5")
    found = measured_chains(tmp_path / "records.h5", 2)
    assert found.frf.covariance == how
    assert found.identification.structured.values == pytest.approx(
        [1, 2, 2, 1.5, 900, 2500, 0.5], rel=0.01
    )


def test_a_motor_without_torque_is_named(tmp_path):
    records = simulated(blocks=1)
    torque = np.array(records.torque)
    torque[..., 1] = 0.0
    quiet = Records(
        **{
            **{f: getattr(records, f) for f in Records.__dataclass_fields__},
            "torque": torque,
        }
    )
    quiet.save(tmp_path / "records.h5")
    code, _, err = oed("chains", tmp_path / "records.h5")
    assert code == 2
    assert "motor 2 has no torque at any excited line" in err
