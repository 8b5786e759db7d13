"""Robot, study, experiment and URDF files with seeded mistakes: read, or refused in one line."""

import random
import re
from pathlib import Path

import pytest
import yaml
from robots import CRANE, HERE, SPLIT

from oed.experiment.experiment_file import load_experiment
from oed.study.settings.study_file import load_study
from robotmodels import IdentificationError, load_robot
from robotmodels.collision.shapes import robot_shapes
from robotmodels.description.urdf import locate
from robotmodels.simulation.plant_model import build_plant

STUDIES = Path(__file__).parents[2] / "studies"
MUTANTS = 60
"""Of each kind."""

YAML_WORDS = [
    "on",
    "0100",
    "1:40",
    "1_000",
    "0x_",
    "2001-13-45",
    "~",
    "true",
    "[]",
    "{}",
    "''",
    "-1",
    "0",
    "1e300",
    "1e-300",
    ".nan",
    ".inf",
    "1e23",
    "5.9",
    "&x",
    "*x",
    "<<",
    "'",
    "[",
    "{",
    "|",
    "---",
    "@",
    "`",
    "٣",
    "=1+1",
    "../../etc/passwd",
    "/dev/zero",
    "~nobody/x",
    "<b>x</b>",
    "'1.0'",
    "0.2_0",
]
YAML_WORDS += ["9" * 400, "1" * 5000, "!!float abc", "[1, [2]]", "{a: b}", "a: &x [*x]", "a" * 300]
YAML_WORDS += ['"\\0"', '"\\ud800"', '"\\e[31m"', "\x00", "\x9b", "\u00a0", "\t", "[" * 1500]
XML_WORDS = ["0.2_0", "٣", "1\u00a0", "1e300", "nan", "", "0", "-1", "1 2", "&#x9b;", "&lol;", "a"]
XML_WORDS += ["floating", "../x", "package://", "package:///etc/passwd", "0 0 1e-200", "<", "\x1b"]


def replaced(text: str, pattern: str, words: list[str], rng: random.Random) -> str:
    place = rng.choice([*re.finditer(pattern, text)])
    return text[: place.start()] + rng.choice(words) + text[place.end() :]


def mutated_yaml(text: str, rng: random.Random) -> str:
    for _ in range(rng.randint(1, 3)):
        lines = text.split("\n")
        line, other = rng.randrange(len(lines)), rng.randrange(len(lines))
        match rng.randrange(8):
            case 0:
                del lines[line]
            case 1:
                lines.insert(line, lines[other])
            case 2:
                lines[line], lines[other] = lines[other], lines[line]
            case 3:
                lines[line] = lines[line][: rng.randrange(len(lines[line]) + 1)]
            case _:
                text = replaced(text, r"(?<=[:,\[{ -] )[^\s,\[\]{}:#]+", YAML_WORDS, rng)
                continue
        text = "\n".join(lines)
    return text


def mutated_xml(text: str, rng: random.Random) -> str:
    for _ in range(rng.randint(1, 3)):
        match rng.randrange(6):
            case 0:
                text = replaced(text, r"<[^>]*>", [""], rng)
            case 1:
                text = replaced(text, r"(?=<[^>]*/>)", ["<mass value='1'/>", "<a>", "</a>"], rng)
            case 2:
                text = replaced(text, r'[a-z]+(?==")', ["xyz", "value", "ixx", "name", "link"], rng)
            case _:
                text = replaced(text, r'(?<==")[^"]*', XML_WORDS, rng)
    return text


def read_robot(path: Path) -> None:
    robot = load_robot(path)
    robot_shapes(robot)
    build_plant(robot.file, locate(robot.file.urdf, robot.folder))


def read_urdf(path: Path) -> None:
    robot = path.with_suffix(".yaml")
    robot.write_text(yaml.safe_dump(CRANE | {"urdf": path.name}))
    read_robot(robot)


KINDS = {
    "robot": ("robot.yaml", yaml.safe_dump(SPLIT), mutated_yaml, read_robot),
    "urdf": ("arm.urdf", (HERE / "crane.urdf").read_text(), mutated_xml, read_urdf),
    "study": ("study.yaml", (STUDIES / "ur10.yaml").read_text(), mutated_yaml, load_study),
    "experiment": (
        "experiment.yaml",
        (STUDIES / "manutec_r3_experiment.yaml").read_text(),
        mutated_yaml,
        load_experiment,
    ),
}


@pytest.mark.parametrize("kind", KINDS)
def test_mutated_files_are_read_or_refused_in_one_line(kind: str, tmp_path: Path) -> None:
    name, text, mutate, read = KINDS[kind]
    refused = 0
    for seed in range(MUTANTS):
        mutant = mutate(text, random.Random(seed))
        (tmp_path / name).write_text(mutant, encoding="utf-8")
        try:
            read(tmp_path / name)
        except IdentificationError as error:
            refused += 1
            line = str(error)
            assert "\n" not in line, f"seed {seed}"
            assert str(tmp_path) in line or line.startswith(("urdf:", "study:")), f"seed {seed}"
        except Exception as error:
            pytest.fail(f"seed {seed}: {type(error).__name__}: {error}")
    assert MUTANTS / 5 < refused < MUTANTS  # most mistakes are some; a few change nothing
