"""Recipe, Dockerfile and install page name what pyproject.toml does."""

import re
import tomllib
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CONDA = {"pinocchio": "pin", "mujoco-python": "mujoco", "matplotlib-base": "matplotlib"}


def test_the_recipe_has_the_dependencies_and_the_version():
    recipe = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text(encoding="utf-8"))
    assert recipe["package"]["version"] == PROJECT["version"]
    python, *run = (entry.split(" >=") for entry in recipe["requirements"]["run"])
    assert python == ["python", PROJECT["requires-python"].removeprefix(">=")]
    named = {f"{CONDA.get(name, name)}>={version}".lower() for name, version in run}
    assert named == {dependency.lower() for dependency in PROJECT["dependencies"]}
    entry = recipe["build"]["python"]["entry_points"]
    assert entry == [f"{name} = {target}" for name, target in PROJECT["scripts"].items()]


def test_the_dockerfile_and_the_install_page_name_extras_that_exist():
    extras = PROJECT["optional-dependencies"]
    for file in ("Dockerfile", "docs/install.md"):
        text = (ROOT / file).read_text(encoding="utf-8")
        named = {one for group in re.findall(r"\.\[([\w,]+)\]", text) for one in group.split(",")}
        assert named
        assert named <= set(extras)
    table = set(re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (`.*?) \|", text, re.MULTILINE))))
    assert table == set(extras) - {"bench"}
