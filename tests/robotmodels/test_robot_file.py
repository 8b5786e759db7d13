"""Mistakes in a robot file: one line each, naming the key, what was found, what is right."""

import re
from pathlib import Path

import pytest
import yaml
from robots import HERE, PENDULUM, SPLIT, changed, with_spring

from robotmodels import InvalidInput, load_robot
from robotmodels.description.robot_file import Hardening, RobotFile, read_robot_file

DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # written in C where there is one


def refusal(path: Path, content: dict | str) -> str:
    """Return what is wrong with a file, without its name in front."""
    path.write_text(content if isinstance(content, str) else yaml.dump(content, Dumper=DUMPER))
    with pytest.raises(InvalidInput) as error:
        load_robot(path)
    line = str(error.value)
    assert "\n" not in line
    place = re.match(rf"{re.escape(str(path))}(:\d+)?: ", line)
    assert place
    return line.removeprefix(place[0])


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "pendulum.urdf").write_text((HERE / "pendulum.urdf").read_text())
    return tmp_path / "robot.yaml"


def test_the_model_file_has_two_names(path: Path) -> None:
    content = changed(PENDULUM, model=PENDULUM["urdf"])
    path.write_text(yaml.dump(without(content, "urdf")))
    assert load_robot(path).file.urdf == PENDULUM["urdf"]
    line = "the keys 'model' and 'urdf' mean the same; one of them is needed"
    assert refusal(path, content) == line


def test_guesses_of_what_is_no_parameter_are_refused(path: Path) -> None:
    path.write_text(yaml.dump(changed(PENDULUM, guessed={"g.damping": 1, "m.inertia": 0.5})))
    assert load_robot(path).file.guessed == {"g.damping": 1.0, "m.inertia": 0.5}
    line = refusal(path, changed(PENDULUM, guessed={"g.dampnig": 1.0}))
    assert (
        line == "guessed: 'g.dampnig' is not a parameter of this robot (did you mean 'g.damping'?)"
    )


def without(content: dict, key: str) -> dict:
    return {k: v for k, v in content.items() if k != key}


def motor(**entries: object) -> dict:
    """Return SPLIT with entries of its third motor replaced; None takes one out."""
    motors = list(SPLIT["motors"])
    motors[2] = {k: v for k, v in (motors[2] | entries).items() if v is not None}
    return changed(SPLIT, motors=motors)


def payload(**entries: object) -> dict:
    return changed(SPLIT, payload=SPLIT["payload"] | entries)


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (
            with_spring(SPLIT, "d4", stiffness=-1),
            "springs[3].stiffness of 'd4': a number of at least 1e-06 is needed, found -1",
        ),
        (
            with_spring(SPLIT, "d4", stiffness=[1, 2]),
            "springs[3].stiffness of 'd4': a number is needed, found [1, 2]",
        ),
        (
            with_spring(SPLIT, "d4", stiffness="stiff"),
            "springs[3].stiffness of 'd4': a number is needed, found 'stiff'",
        ),
        (
            with_spring(SPLIT, "d4", stiffness=float("inf")),
            "springs[3].stiffness of 'd4': a finite number is needed, found inf",
        ),
        (
            with_spring(SPLIT, "d4", stiffness=True),
            "springs[3].stiffness of 'd4': a number is needed, found true",
        ),
        (
            changed(SPLIT, gravity=[0, False, -9.81]),
            "gravity[1]: a number is needed, found false",
        ),
        (
            changed(SPLIT, urdf="."),
            "model file: {folder} is a folder; the file itself is needed",
        ),
        (
            with_spring(SPLIT, "d4", damping=0),
            "springs[3].damping of 'd4': a number of at least 1e-09 is needed, found 0",
        ),
        (
            with_spring(SPLIT, "d2", stiffness={"low": -1, "high": 2, "torque": 3}),
            "springs[1].stiffness.low of 'd2': a number of at least 1e-06 is needed, found -1",
        ),
        (
            with_spring(SPLIT, "d2", stiffness={"low": 1, "high": 2}),
            "missing key 'springs[1].stiffness.torque' of 'd2'",
        ),
        (
            with_spring(SPLIT, "d2", stiffness={"low": 1, "hihg": 2, "torque": 3}),
            "unknown key 'springs[1].stiffness.hihg' of 'd2' (did you mean 'high'?)",
        ),
        (
            with_spring(SPLIT, "d4", stiffness=None, stifness=1),
            "unknown key 'springs[3].stifness' of 'd4' (did you mean 'stiffness'?)",
        ),
        (changed(SPLIT, spring=[]), "unknown key 'spring' (did you mean 'springs'?)"),
        (payload(weight=1), "unknown key 'payload.weight'; known are mass, com, inertia, link"),
        (without(SPLIT, "motors"), "missing key 'motors'"),
        (without(SPLIT, "schema"), "missing key 'schema'"),
        (motor(inertia=None), "missing key 'motors[2].inertia' of 'm3'"),
        (changed(SPLIT, schema="robot/2"), "schema: input should be 'robot/1', found 'robot/2'"),
        (
            motor(gear_ratio=0),
            "motors[2]: motor 'm3': gear_ratio must not be zero, nor below 1e-6 in size",
        ),
        (
            motor(viscous=-1),
            "motors[2].viscous of 'm3': a number of at least 0 is needed, found -1",
        ),
        (
            motor(name="payload"),
            "motors[2].name: 'payload' cannot be a name: one line that has no point and begins "
            "with none of = + - @ is needed, "
            "other than 'payload' and 'universe'",
        ),
        (
            with_spring(SPLIT, "d4", name="d.4"),
            "springs[3].name: 'd.4' cannot be a name: one line that has no point and begins "
            "with none of = + - @ is needed, "
            "other than 'payload' and 'universe'",
        ),
        (
            with_spring(SPLIT, "d4", name=" "),
            "springs[3].name: ' ' cannot be a name: one line that has no point and begins "
            "with none of = + - @ is needed, "
            "other than 'payload' and 'universe'",
        ),
        (
            changed(
                SPLIT,
                accelerometers=[
                    {"name": "a", "link": "tool0", "at": [0, 0, 0], "direction": [0, 0, 0]}
                ],
            ),
            "accelerometers[0]: accelerometer 'a': direction must not be zero",
        ),
        (motor(joint="shoulder_pan_joint"), "joint 'shoulder_pan_joint' has 2 motors; one at most"),
        (motor(name="m1"), "the name 'm1' is used 2 times; names are unique"),
        (motor(name="d1"), "the name 'd1' is used 2 times; names are unique"),
        (with_spring(SPLIT, "a3x", name="a3y"), "the name 'a3y' is used 2 times; names are unique"),
        (
            with_spring(SPLIT, "b2x", axis="z"),
            "joint 'shoulder_lift_joint' has 2 springs about axis 'z'; one at most",
        ),
        (changed(SPLIT, motors=[]), "motors: at least 1 is needed, found []"),
        (changed(SPLIT, springs={}), "springs: a list is needed, found {}"),
        (
            changed(SPLIT, springs=["d1"]),
            "springs[0]: a mapping of keys to values is needed, found 'd1'",
        ),
        (changed(SPLIT, gravity=[0, 1]), "gravity: too few numbers, found [0, 1]"),
        (
            changed(SPLIT, gravity=[0, 0, 1, 0]),
            "gravity: at most 3 are allowed, found [0, 0, 1, 0]",
        ),
        (changed(SPLIT, gravity="down"), "gravity: a list is needed, found 'down'"),
        (payload(mass=-1), "payload.mass: a number of at least 0 is needed, found -1"),
        (
            payload(inertia=[1, 1]),
            "payload.inertia: 3 or 6 numbers are needed (xx, yy, zz, or all six), found 2",
        ),
        (
            with_spring(SPLIT, "d4", at=[0, 0, 1]),
            "springs[3]: spring 'd4': 'at' belongs to a cut through a link, not to a joint",
        ),
        (
            with_spring(SPLIT, "d4", distal={"mass": 1, "com": [0, 0, 0], "inertia": [1, 1, 1]}),
            "springs[3]: spring 'd4': 'distal' belongs to a cut through a link, not to a joint",
        ),
        (
            with_spring(SPLIT, "d4", joint=None),
            "springs[3]: spring 'd4': give either joint or link",
        ),
        (
            with_spring(SPLIT, "a3x", joint="elbow_joint"),
            "springs[11]: spring 'a3x': give either joint or link",
        ),
        (
            with_spring(SPLIT, "a3x", at=None),
            "springs[11]: spring 'a3x': a cut through link 'forearm_link' needs 'at', a point [m]",
        ),
        (
            with_spring(SPLIT, "a3x", axis="drive"),
            "springs[11]: spring 'a3x': a cut has axes x, y, z; 'drive' belongs to a joint",
        ),
        (
            with_spring(SPLIT, "a3x", axis="w"),
            "springs[11].axis of 'a3x': input should be 'drive', 'x', 'y' or 'z', found 'w'",
        ),
        (
            with_spring(SPLIT, "b2x", stiffness={"low": 1, "high": 2, "torque": 3}),
            "springs[8]: spring 'b2x': only a drive spring can be nonlinear",
        ),
    ],
)
def test_mistakes_in_keys_and_values(path: Path, content: dict, line: str) -> None:
    assert refusal(path, content) == line.replace("{folder}", str(path.parent.resolve()))


@pytest.mark.parametrize(
    ("choice", "line"),
    [
        (
            {"fixed": ["d4.stifness"]},
            "'d4.stifness' is not a parameter of this robot (did you mean 'd4.stiffness'?)",
        ),
        (
            {"fixed": ["d2.stiffness"]},
            "'d2.stiffness' is not a parameter of this robot "
            "(did you mean 'd2.stiffness.low' or 'd2.stiffness.high'?)",
        ),
        (
            {"fixed": ["d4"]},
            "'d4' is not a parameter of this robot (did you mean 'd4.stiffness' or 'd4.damping'?)",
        ),
        ({"fixed": ["?"]}, "'?' is not a parameter of this robot; there are d1.stiffness, d2"),
        (
            {"tied": [["d4.stiffness", "d5.stifness"]]},
            "'d5.stifness' is not a parameter of this robot (did you mean 'd5.stiffness'?)",
        ),
        ({"tied": [["d4.damping", "d4.damping"]]}, "'d4.damping' is tied twice; choose one"),
        (
            {"tied": [["d4.damping", "d5.damping"]], "fixed": ["d5.damping"]},
            "'d5.damping' is fixed too; choose one",
        ),
        ({"tied": [["d4.damping"]]}, "parameters.tied[0]: at least 2 is needed, found ['d4.da"),
        ({"tied": [[]]}, "parameters.tied[0]: at least 2 is needed, found []"),
        ({"tied": ["d4.damping"]}, "parameters.tied[0]: a list is needed, found 'd4.damping'"),
        (
            {"extra": ["a3y.at", "c3z.at", "a3x.at"]},
            "parameters.extra: a3y.at and a3x.at are the place of one cut; name one",
        ),
        ({"fix": []}, "unknown key 'parameters.fix' (did you mean 'fixed'?)"),
    ],
)
def test_mistakes_in_the_choice_of_parameters(path: Path, choice: dict, line: str) -> None:
    assert line in refusal(path, changed(SPLIT, parameters=choice))


def test_a_robot_needs_a_free_parameter(path: Path) -> None:
    content = changed(PENDULUM, parameters={"fixed": ["g.stiffness", "g.damping"]})
    assert refusal(path, content) == (
        "parameters: every parameter is fixed; at least one must be free"
    )


@pytest.mark.parametrize(
    ("text", "place", "problem"),
    [
        ("schema: robot/1\nname: [a\nurdf: b\n", ":3", "expected ',' or ']'"),
        ("schema: robot/1\nmotors:\n\t- a\n", ":3", "found character"),
        ("schema: robot/1\nname: a\nname: b\n", ":3", "key 'name' is given twice"),
        ("name: a\x00b\n", ":1", "it has a control character"),
        ("schema: robot/1\nname: 3\n", ":2", "name: text is needed, found 3"),
        ("", "", "a mapping of keys to values is needed, found nothing"),
        ("<robot/>", "", "this is XML, such as a URDF, of which `oed init` makes a robot file"),
        ("- a\n", "", "a mapping of keys to values is needed, found list"),
    ],
)
def test_malformed_yaml_is_named_with_its_line(
    path: Path, text: str, place: str, problem: str
) -> None:
    path.write_text(text)
    with pytest.raises(InvalidInput) as error:
        load_robot(path)
    assert str(error.value).startswith(f"{path}{place}: ")
    assert problem in str(error.value)


def test_a_robot_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"none\.yaml: no such file"):
        load_robot(tmp_path / "none.yaml")
    with pytest.raises(InvalidInput, match=r"cannot be read"):
        load_robot(tmp_path)
    with pytest.raises(
        InvalidInput, match=r"neither a built-in robot \(did you mean 'ur10'\?\) nor"
    ):
        load_robot("ur1O")
    with pytest.raises(
        InvalidInput, match=r"crane\.urdf is a URDF; a robot file \(YAML\) is needed"
    ):
        load_robot(HERE / "crane.urdf")
    (tmp_path / "latin.yaml").write_bytes(b"name: M\xfcller\n")
    with pytest.raises(InvalidInput, match=r"latin\.yaml: cannot be read"):
        load_robot(tmp_path / "latin.yaml")


def test_numbers_as_people_write_them(path: Path) -> None:
    """YAML reads 4e4, without a point, as text."""
    path.write_text(yaml.safe_dump(PENDULUM).replace("5000.0", "5e3"))
    assert "5e3" in path.read_text()
    assert load_robot(path).parameters.values[0] == 5000.0


def test_three_inertias_are_the_diagonal_ones() -> None:
    file = RobotFile.model_validate(payload(inertia=[1.0, 2.0, 2.5]))
    assert file.payload is not None
    assert file.payload.inertia == (1.0, 0.0, 0.0, 2.0, 0.0, 2.5)


def test_a_file_becomes_what_it_says(path: Path) -> None:
    path.write_text(yaml.safe_dump(SPLIT))
    file = read_robot_file(path)
    assert file.springs[1].stiffness == Hardening(low=2e4, high=5e4, torque=150)
    assert file.springs[10].at == (0.0, 0.01, 0.2)
    assert file.gravity == (0.0, 0.0, -9.81)
    assert file.motors[0].coulomb == 0.0
