import json

import pytest
from command_line import oed

from reports import application, cli


def test_check_shows_parameters_coordinates_and_resonances():
    code, out, err = oed("check", "ur10")
    assert (code, err) == (0, "")
    assert "26 of 36 parameters free" in out
    assert "kN m/rad" in out
    assert "resonances" in out
    assert "shoulder_pan_joint" in out


def test_an_interrupt_while_the_command_loads_ends_it_quietly(monkeypatch, capsys):
    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr(application, "run", interrupted)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert (ended.value.code, *capsys.readouterr()) == (130, "", "")


def test_check_takes_a_position_in_degrees():
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
        (("rnu",), "did you mean 'run'?); see oed --help"),
        (("run",), "missing argument 'study'; see oed run --help"),
        (("run", "x", "--workers", "0"), "--workers"),
        (("run", "x", "--sped", "1"), "--sped"),
        (("run", "x", "--workers", "two"), "'--workers': a whole number is needed; see"),
        (("schema", "sutdy"), "'study', 'experiment', 'robot'"),
    ],
)
def test_mistakes_end_in_one_line(words, said):
    code, out, err = oed(*words)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert len(err.splitlines()) == 1
    assert said in err


def test_a_long_key_leaves_file_and_remedy_to_be_read(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text(f"schema: robot/1\nname: long\n? {'x' * 20_000}\n: 1\n", encoding="utf-8")
    code, out, err = oed("check", str(path))
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert len(err) < 1100
    assert f"{path}:3: unknown key 'xxx" in err
    assert "known are schema, name" in err


ROBOT, STUDY = "schema: robot/1\nname: a\n", "schema: study/1\nrobot: ur10\n"
EXPERIMENT = "schema: experiment/1\nrobot: ur10\n"


@pytest.mark.parametrize(
    ("command", "content", "said"),
    [
        ("run", ROBOT, ("a robot file (schema: robot/1), which `oed check` takes", "study/1")),
        ("report", EXPERIMENT, ("which `oed simulate` takes", "a study (YAML, schema: study/1)")),
        ("check", STUDY, ("a study (schema: study/1), which `oed run` takes", "robot/1")),
        ("init", STUDY, ("a study (schema: study/1)", "a robot file")),
        ("simulate", STUDY, ("which `oed run` takes", "an experiment (YAML, schema")),
        ("run", "# Title\n\nSome: text: here\n", (":3: not valid YAML", "a study (YAML, ")),
        ("run", "schema: study/2\n", ("schema: input should be 'study/1'",)),
    ],
)
def test_a_file_of_another_kind_is_told_with_the_command_that_takes_it(
    tmp_path, command, content, said
):
    path = tmp_path / "given.yaml"
    path.write_text(content, encoding="utf-8")
    code, out, err = oed(command, str(path))
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    for words in ("given.yaml", *said):
        assert words in err


def test_the_folder_of_a_study_is_no_study(tmp_path):
    (tmp_path / "study.yaml").write_text(STUDY, encoding="utf-8")
    code, _, err = oed("run", str(tmp_path))
    assert code == 2
    assert f"did you mean {tmp_path / 'study.yaml'}?" in err


def test_init_says_which_files_it_takes(tmp_path):
    (tmp_path / "README.md").write_text("# Title\n", encoding="utf-8")
    code, _, err = oed("init", str(tmp_path / "README.md"))
    assert code == 2
    assert "a URDF (.urdf), xacro (.xacro), MJCF (.xml) or robot file (.yaml) is needed" in err


def test_help_shows_examples():
    code, out, _ = oed("run", "--help")
    assert code == 0
    assert "oed run studies/ur10.yaml" in out
    code, out, _ = oed("--help")
    assert "check" in out
    assert "run" in out


@pytest.mark.parametrize(
    "command",
    [
        "init",
        "check",
        "run",
        "design",
        "fit",
        "sample",
        "report",
        "simulate",
        "import",
        "frf",
        "schema",
    ],
)
def test_every_command_shows_an_example(command):
    code, out, err = oed(command, "--help")
    assert (code, err) == (0, "")
    assert f"Example: oed {command}" in out


@pytest.mark.parametrize("kind", ["study", "experiment", "robot", "import"])
def test_schemas_describe_the_files(kind):
    code, out, _ = oed("schema", kind)
    schema = json.loads(out)
    assert code == 0
    assert schema["properties"]["schema"]["const"] == f"{kind}/1"
    assert schema["additionalProperties"] is False


def test_version_and_nothing():
    assert oed("--version")[1].startswith("oed 0.")
    code, out, err = oed()
    assert (code, err) == (2, "")
    assert "frf" in out


def test_json_is_all_there_is():
    code, out, err = oed("check", "ur10", "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["robot"] == "ur10"


def test_the_shell_completes_commands_and_robots(monkeypatch):
    monkeypatch.setenv("_OED_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "oed check man")
    monkeypatch.setenv("COMP_CWORD", "2")
    assert "manutec_r3_26" in oed()[1].split()
