"""``oed run`` on a study of coupled chains: files, page, numbers; the shipped case study."""

import json
import re
import shutil
from pathlib import Path

import pytest
from command_line import oed

from oed.chain_study import paper

STUDY = Path(__file__).parents[2] / "studies" / "coupled_chains.yaml"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The case study of [HBH] from the shipped file, its output beside a copy of it."""
    folder = tmp_path_factory.mktemp("case_study")
    (folder / "studies").mkdir()
    shutil.copy(STUDY, folder / "studies")
    code, out, err = oed("run", folder / "studies" / STUDY.name)
    assert code == 0, err
    (folder / "told.txt").write_text(out, encoding="utf-8")
    return folder


@pytest.mark.parametrize("command", ["design", "fit", "sample"])
def test_other_commands_name_the_one_for_chains(command):
    code, _, err = oed(command, STUDY)
    assert (code, err.count("\n")) == (2, 1)
    assert "coupled chains have neither design nor posterior; use oed run" in err


def test_the_published_parameters_are_found_again(folder):
    numbers = json.loads(
        (folder / "out" / "coupled_chains" / "chain_study.json").read_text(encoding="utf-8")
    )
    printed = [paper.PARAMETERS[name] for name in numbers["names"]]
    assert numbers["simulated"] == pytest.approx([9.0 if v == 8.9 else v for v in printed])
    assert numbers["stepwise"] == pytest.approx(numbers["simulated"], rel=2e-3)
    assert numbers["read_off"] == pytest.approx(numbers["simulated"], rel=0.03)
    resonances = numbers["resonances"]
    assert resonances == pytest.approx(paper.RESONANCES, abs=0.01)
    for found, zeros in zip(numbers["anti_resonances"], paper.ANTI_RESONANCES, strict=True):
        assert found == pytest.approx(zeros, abs=0.02)
    for i, step in enumerate(numbers["steps"]):
        assert step["b11"] == pytest.approx(paper.B11[i], rel=1e-3)
        assert step["first"] == pytest.approx(paper.FIRST_COMPONENTS[i], abs=2e-3)


def test_the_page_has_figures_2_to_5_and_the_printed_numbers(folder):
    html = (folder / "out" / "coupled_chains" / "report.html").read_text(encoding="utf-8")
    for id in ("summary", "responses", "steps", "parameters", "errata"):
        assert f'<h2 id="{id}">' in html
    for number in (2, 3, 4, 5):
        assert f'<figure id="figure-{number}">' in html
    for printed in ("24.63", "1428.6", "509.89", "8.9", "0.7077"):
        assert f">{printed}<" in html
    assert not re.search(r"\bnan\b", re.sub(r"<svg.*?</svg>", "", html, flags=re.S))
    # Everything that a drawing refers to is in it.
    for svg in re.findall(r"<svg.*?</svg>", html, flags=re.S):
        for name in set(re.findall(r'(?:href="#|url\(#)([^")]+)', svg)):
            assert f'id="{name}"' in svg


def test_the_summary_says_how_far_off_each_way_is(folder):
    told = (folder / "told.txt").read_text(encoding="utf-8")
    assert "3 chains of 3 masses" in told
    for way in ("gains read off", "step by step", "most likely"):
        assert re.search(rf"error    {way}: at most [\d.]+ %", told)
    for name in ("records.h5", "frf.h5", "chain_study.json", "chains.html", "report.html"):
        assert (folder / "out" / "coupled_chains" / name).is_file()


def test_mistakes_end_in_one_line(tmp_path):
    text = STUDY.read_text(encoding="utf-8").replace("m3_6:", "m3_7:")
    (tmp_path / "study.yaml").write_text(text, encoding="utf-8")
    code, out, err = oed("run", tmp_path / "study.yaml")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert "'m3_7' does not name two last masses" in err


def test_its_keys_are_described():
    code, out, _ = oed("schema", "chain_study")
    assert code == 0
    schema = json.loads(out)
    assert "masses" in schema["properties"]["chains"]["$ref"] or "$defs" in schema
    definitions = schema["$defs"]
    assert "K_R" in definitions["HoldingController"]["properties"]["stiffness"]["description"]
