"""``oed campaign``: what a person types, reads and gets wrong."""

import json
from pathlib import Path

import pytest
import yaml
from browser import violations_of
from command_line import oed

from robotmodels import load_robot


def status_of(path: str) -> dict:
    """Return what ``oed campaign status --json`` prints."""
    code, out, err = oed("campaign", "status", path, "--json")
    assert code == 0, err
    return json.loads(out)


def test_from_a_template_to_a_status(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = oed("campaign", "init", "manutec_r3", "-o", "c.yaml")
    assert (code, err) == (0, "")
    assert "oed campaign ask c.yaml" in out
    assert yaml.safe_load(Path("c.yaml").read_text())["robot"] == "manutec_r3"
    code, _, err = oed("campaign", "init", "manutec_r3", "-o", "c.yaml")
    assert code == 2
    assert "c.yaml: the file is there already" in err
    content = yaml.safe_load(Path("c.yaml").read_text())
    content |= {
        "robot": "moberg_axis1",
        "targets": {"stiffness": 0.3},
        "limits": {"speed": 5.0, "swing": 0.05},
        "candidates": {"sobol": 4},
        "imperfections": {"angle_noise": 1e-5, "nonlinear_gears": False},
    }
    Path("c.yaml").write_text(yaml.safe_dump(content))
    code, out, err = oed("campaign", "ask", "c.yaml")
    assert code == 0, err
    assert "low level" in out
    assert "oed campaign tell c.yaml 1 RECORDS" in out
    page = Path(status_of("c.yaml")["report"])
    assert "Run visit 1" in page.read_text()
    assert 'id="torques"' not in page.read_text()
    for _ in range(2):
        code, _, err = oed("campaign", "simulate", "c.yaml", "--truth", "moberg_axis1")
        assert code == 0, err
    status = status_of("c.yaml")
    assert [visit["state"] for visit in status["visits"]] == ["measured"] * len(status["visits"])
    content = page.read_text()
    assert "<strong>Next:</strong> oed campaign ask c.yaml" in content
    for words in ("Ask for the next visits", "a2.stiffness"):
        assert words in content
    for section in ("progress", "visits", "torques", "runs"):
        assert f'id="{section}"' in content
    assert content.count("<td>before any fit</td>") == 2
    identified = load_robot(page.parent / "robot.yaml")
    assert identified.file.fitted is not None
    values = [one["value"] for one in status["parameters"]]
    assert identified.parameters.values.tolist() == pytest.approx(values)
    assert {one["name"] for one in status["parameters"]} >= {"a2.stiffness", "a3.damping"}
    code, out, _ = oed("campaign", "status", "c.yaml")
    assert "target" in out
    assert "verdict:" in out
    code, _, err = oed("campaign", "tell", "c.yaml", "1")
    assert code == 2
    assert "visit 1: give its records, or --failed with the reason" in err
    code, out, _ = oed(
        "campaign", "tell", "c.yaml", "1", status["visits"][0]["folder"] + "/records.h5"
    )
    assert "was taken before" in out
    assert violations_of(page) == []
