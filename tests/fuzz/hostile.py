"""Files that mean harm, or once did harm: each is a change of a seed and what must become of it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

Change = Callable[[Path], None]
"""Changes files of a folder."""

BOMB = "x0: &x0 [a, a, a, a, a, a, a, a, a, a]\n" + "".join(
    f"x{i + 1}: &x{i + 1} [{', '.join([f'*x{i}'] * 10)}]\n" for i in range(10)
)
ENTITIES = '<!ENTITY a0 "aaaaaaaaaa">' + "".join(
    f'<!ENTITY a{i + 1} "{f"&a{i};" * 10}">' for i in range(10)
)
RED = "\\x1b[31mred"
SCRIPT = "<script>alert(1)</script><img src=x onerror=alert(1)>"


@dataclass(frozen=True)
class Case:
    """A hostile file.

    Attributes
    ----------
    name : in a few words.
    seed : folder of whole files.
    change : what is done to a copy of it.
    command : that reads it.
    says : what its line of error says; nothing where the command may succeed.
    """

    name: str
    change: Change
    command: str
    says: str = ""
    seed: str = "inputs"


def replaced(file: str, old: str, new: str) -> Change:
    """Return the change of a text in a file, which must be there."""

    def change(folder: Path) -> None:
        text = (folder / file).read_text(encoding="utf-8")
        if old not in text:
            raise ValueError(f"{file} has no {old!r}")
        (folder / file).write_text(text.replace(old, new), encoding="utf-8")

    return change


def written(file: str, content: str | bytes) -> Change:
    """Return the change of a whole file."""
    data = content.encode() if isinstance(content, str) else content

    def change(folder: Path) -> None:
        (folder / file).write_bytes(data)

    return change


def entity(declaration: str, use: str) -> Change:
    """Return a URDF that declares entities and uses one."""

    def change(folder: Path) -> None:
        path = folder / "arm.urdf"
        text = path.read_text(encoding="utf-8")
        head = f'<?xml version="1.0"?>\n<!DOCTYPE robot [{declaration}]>'
        text = text.replace('<?xml version="1.0"?>', head).replace('name="arm"', f'name="{use}"')
        path.write_text(text, encoding="utf-8")

    return change


def hdf5(file: str, edit: Callable[[h5py.File], None]) -> Change:
    """Return a change inside an HDF5 file."""

    def change(folder: Path) -> None:
        (folder / "secret.h5").write_bytes((folder / file).read_bytes())
        with h5py.File(folder / file, "r+") as opened:
            edit(opened)

    return change


def _external(file: h5py.File) -> None:
    del file["position_00000/torque"]
    file["position_00000/torque"] = h5py.ExternalLink("secret.h5", "/position_00000/torque")


def _external_group(file: h5py.File) -> None:
    del file["position_00000"]
    file["position_00000"] = h5py.ExternalLink("secret.h5", "/position_00000")


def _raw_bytes_of_another(file: h5py.File) -> None:
    shape = file["position_00000/torque"].shape
    del file["position_00000/torque"]
    length = 8 * int(np.prod(shape))
    file.create_dataset("position_00000/torque", shape, "f8", external=[("secret.h5", 0, length)])


def _circle(file: h5py.File) -> None:
    del file["position_00000"]
    file["position_00000"] = h5py.SoftLink("/position_00000")


def _zeros(file: h5py.File) -> None:
    del file["position_00000/torque"]
    shape = (2, 2, 2, 10**11, 2)
    file.create_dataset("position_00000/torque", shape, "f8", chunks=True, compression="gzip")


def _pickle(folder: Path) -> None:
    np.save(folder / "taught.npy", np.array([Path("x"), None], dtype=object), allow_pickle=True)


def _script_everywhere(folder: Path) -> None:
    """Put markup into every name that a page shows."""
    robot, study = folder / "robot.yaml", folder / "rich_study.yaml"
    name = f"'{SCRIPT.replace('.', '')}'"
    text = robot.read_text(encoding="utf-8")
    for old in ("name: arm", "name: m1", "name: d1"):
        text = text.replace(old, f"name: {name[:-1]}{old[-2:]}'")
    robot.write_text(text, encoding="utf-8")
    text = study.read_text(encoding="utf-8").replace("name: wall", f"name: {name}")
    text = text.replace("folded:", f"{name}:").replace("d1.stiffness", f"{name[1:-1]}d1.stiffness")
    text = text.replace(f"{name[1:-1]}d1.stiffness", f"'{name[1:-1]}d1.stiffness'")
    study.write_text(text, encoding="utf-8")


def _formulas(folder: Path) -> None:
    robot = folder / "robot.yaml"
    text = robot.read_text(encoding="utf-8").replace("name: d1", 'name: "=1+1"')
    robot.write_text(text.replace("name: m1", 'name: "@SUM(A1)"'), encoding="utf-8")


CHECK, DESIGN = "check robot.yaml", "design study.yaml --workers 1"
FRF = "frf records.h5 -o new"

CASES = (
    Case("aliases of aliases", written("robot.yaml", BOMB), CHECK, "robot.yaml"),
    Case("anchor in itself", replaced("robot.yaml", "name: arm", "name: &a [*a]"), CHECK, "alias"),
    Case("nesting", written("robot.yaml", "[" * 1500 + "]" * 1500), CHECK, "robot.yaml"),
    Case(
        "nesting in JSON",
        written("design.json", "[" * 10**5),
        "simulate rich_experiment.yaml",
        "design",
    ),
    Case("list as a key", replaced("robot.yaml", "name: arm", "{[1]: 2}: 3"), CHECK, "robot.yaml"),
    Case("no date", replaced("study.yaml", "seed: 3", "seed: 2001-13-45"), DESIGN, "seed"),
    Case("octal number", replaced("robot.yaml", "gear_ratio: 100", "gear_ratio: 0100"), CHECK),
    Case(
        "sexagesimal",
        replaced("robot.yaml", "gear_ratio: 100", "gear_ratio: 1:40"),
        CHECK,
        "gear_ratio",
    ),
    Case(
        "tag of Python",
        replaced("robot.yaml", "name: arm", "name: !!python/name:os.system x"),
        CHECK,
        "robot.yaml",
    ),
    Case(
        "half a character",
        replaced("robot.yaml", "name: arm", 'name: "\\ud800"'),
        CHECK,
        "robot.yaml:2",
    ),
    Case(
        "null in a path",
        replaced("robot.yaml", "urdf: arm.urdf", 'urdf: "arm\\0.urdf"'),
        CHECK,
        "robot.yaml:3",
    ),
    Case("terminal in a name", replaced("robot.yaml", "name: arm", f'name: "{RED}"'), CHECK),
    Case(
        "terminal in a key",
        replaced("robot.yaml", "name: arm", f'"{RED}": arm'),
        CHECK,
        "robot.yaml:2",
    ),
    Case(
        "terminal in a joint",
        replaced("robot.yaml", "joint: elbow,", f'joint: "{RED}",'),
        CHECK,
        "robot.yaml:7",
    ),
    Case(
        "terminal in a link",
        replaced("arm.urdf", 'link name="fore"', 'link name="&#x9b;31m"'),
        CHECK,
        "arm.urdf",
    ),
    Case(
        "terminal in a group",
        replaced("rich_study.yaml", "folded:", f'"{RED}":'),
        "design rich_study.yaml --workers 1",
    ),
    Case("bidirectional name", replaced("robot.yaml", "name: arm", 'name: "a\\u202eb"'), CHECK),
    Case(
        "huge number",
        replaced("robot.yaml", "gear_ratio: 100", "gear_ratio: 1e300"),
        CHECK,
        "gear_ratio",
    ),
    Case(
        "400 digits",
        replaced("study.yaml", "experiments: 3", f"experiments: {'9' * 400}"),
        DESIGN,
        "experiments",
    ),
    Case("many starts", replaced("study.yaml", "starts: 2", "starts: 100000000"), DESIGN, "starts"),
    Case(
        "many walkers",
        replaced("study.yaml", "walkers: 16", "walkers: 100000000"),
        DESIGN,
        "walkers",
    ),
    Case(
        "many frequencies", replaced("study.yaml", "count: 6", "count: 1000000000"), DESIGN, "count"
    ),
    Case("device", replaced("robot.yaml", "urdf: arm.urdf", "urdf: /dev/zero"), CHECK, "/dev/zero"),
    Case(
        "device as data", replaced("of_frf_csv.yaml", "frf.csv", "/dev/zero"), "fit of_frf_csv.yaml"
    ),
    Case(
        "file of passwords",
        replaced("robot.yaml", "urdf: arm.urdf", "urdf: /etc/passwd"),
        CHECK,
        "passwd",
    ),
    Case(
        "out of the package",
        replaced("robot.yaml", "arm.urdf", "example-robot-data:../../../../../../../../etc/passwd"),
        CHECK,
        "robot.yaml",
    ),
    Case(
        "out of the stages",
        replaced("rich_study.yaml", "name: first", "name: ../../../../first"),
        "fit rich_study.yaml --workers 1",
        "name",
    ),
    Case(
        "signals from elsewhere",
        replaced("plan.yaml", "signals: plan.h5", "signals: ../../../../etc/passwd"),
        "python:oed.experiment.experiment_plan:ExperimentPlan.load plan.yaml",
        "signals",
    ),
    Case(
        "external entity",
        entity('<!ENTITY x SYSTEM "file:///etc/passwd">', "&x;"),
        CHECK,
        "arm.urdf",
    ),
    Case(
        "external types",
        entity('<!ENTITY % x SYSTEM "http://127.0.0.1:9/x"> %x;', "arm"),
        CHECK,
        "arm.urdf",
    ),
    Case("entities of entities", entity(ENTITIES, "&a10;"), CHECK, "arm.urdf"),
    Case(
        "unknown encoding",
        replaced("arm.urdf", '"1.0"?>', '"1.0" encoding="bogus"?>'),
        CHECK,
        "arm.urdf",
    ),
    Case("deep XML", written("arm.urdf", "<a>" * 10**5 + "</a>" * 10**5), CHECK, "arm.urdf"),
    Case("number of Python", replaced("arm.urdf", 'ixx="0.05"', 'ixx="0.0_5"'), CHECK, "0.0_5"),
    Case("Arabic number", replaced("arm.urdf", 'ixx="0.05"', 'ixx="٣"'), CHECK, "٣"),
    Case("trailing space", replaced("arm.urdf", 'ixx="0.05"', 'ixx="0.05\u00a0"'), CHECK, "0.05"),
    Case("external link", hdf5("records.h5", _external), FRF, "records.h5"),
    Case("external group", hdf5("records.h5", _external_group), FRF, "records.h5"),
    Case("external bytes", hdf5("records.h5", _raw_bytes_of_another), FRF, "records.h5"),
    Case("link to itself", hdf5("records.h5", _circle), FRF, "records.h5"),
    Case("zeros beyond all memory", hdf5("records.h5", _zeros), FRF, "records.h5"),
    Case("pickled positions", _pickle, "design rich_study.yaml --workers 1", "taught.npy"),
    Case(
        "measured beyond any joint",
        replaced("records.csv", "# positions: [[0.5", "# positions: [[1e300"),
        "frf records.csv -o new --local",
        "positions",
    ),
    Case(
        "comment of another type",
        replaced("records.csv", "# axes: [", '# axes: ["'),
        "frf records.csv",
    ),
    Case("markup in names", _script_everywhere, "run rich_study.yaml --workers 1"),
    Case("formulas as names", _formulas, "run of_frf_h5.yaml --workers 1"),
    Case(
        "stage without seconds",
        replaced("results/stages/data/stage.json", '"seconds"', '"second"'),
        "run study.yaml --workers 1",
        seed="finished",
    ),
    Case(
        "nested record of a stage",
        written("results/stages/data/stage.json", "[" * 10**5),
        "run study.yaml --workers 1",
        seed="finished",
    ),
)
