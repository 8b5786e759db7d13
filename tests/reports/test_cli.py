import sys

import pytest

from reports import cli


@pytest.fixture
def oed(monkeypatch, capsys):
    def run(*words):
        monkeypatch.setattr(sys, "argv", ["oed", *words])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return (ended.value.code or 0, *capsys.readouterr())

    return run


def test_check_shows_parameters_coordinates_and_resonances(oed):
    code, out, err = oed("check", "ur10")
    assert (code, err) == (0, "")
    assert "26 of 36 parameters free" in out
    assert "kN m/rad" in out
    assert "resonances" in out
    assert "shoulder_pan_joint" in out


def test_check_takes_a_position_in_degrees(oed):
    _, there, _ = oed("check", "ur10", "--position", "0,-90,90,0,45,0")
    _, elsewhere, _ = oed("check", "ur10", "--position=0,-30,20,0,45,0")
    assert "position: 0°, -90°, 90°, 0°, 45°, 0°" in there
    first, second = (out[out.index("resonances") :] for out in (there, elsewhere))
    assert first != second


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("check", "ur11"), "'ur10'"),
        (("check", "ur10", "--position", "0,-90"), "2 given, 6 needed"),
        (("check", "ur10", "--position", "0,a"), "'0,a'"),
        (("check", "ur10", "--position", "0,-900,0,0,0,0"), "shoulder_lift_joint"),
        (("check", "absent.yaml"), "absent.yaml"),
    ],
)
def test_mistakes_end_in_one_line(oed, words, said):
    code, out, err = oed(*words)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert len(err.splitlines()) == 1
    assert said in err


def test_help_shows_examples(oed):
    code, out, _ = oed("run", "--help")
    assert code == 0
    assert "oed run studies/ur10.yaml" in out
    code, out, _ = oed("--help")
    assert "check" in out
    assert "run" in out
