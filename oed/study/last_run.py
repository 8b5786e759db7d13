"""What a command said last of a study, to say again while nothing that it rests on has changed.

Beside a study's pages lies ``.last-run.json``: what was said, and the SHA-256 of the files that it
rests on and of those that were written. To compare them takes a tenth of a second, to load the
stages and draw the pages again takes seconds. Nothing is remembered of a robot whose meshes are
missing: they may turn up.
"""

import json
import os
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oed.study.stage_cache import versions
from robotmodels.common.atomic_files import write_text
from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import check_file
from robotmodels.common.fingerprints import file_digest, folder_digest, json_digest

if TYPE_CHECKING:
    from oed.study.results import FittedStudy

_RECORD = ".last-run.json"
_MOST_BYTES = 2**24
_PAGES = (".html", ".json")
_PACKAGES = ("robotmodels", "estimators", "oed", "reports")
_UNREADABLE = InvalidInput, OSError, ValueError, RecursionError, KeyError, TypeError, AttributeError


@dataclass(frozen=True)
class Answer:
    """What a command says at its end.

    Attributes
    ----------
    text : str
        Summary for people.
    document : str
        The same as JSON.
    warnings : tuple of str
        What it warned of.
    """

    text: str
    document: str
    warnings: tuple[str, ...]


class LastRun:
    """The last run of one command on a study.

    Parameters
    ----------
    command : str
        The command, as it stands on the pages.
    study : Path
        File.
    output : Path
        Folder of the study's pages and stages.
    """

    def __init__(self, command: str, study: Path, output: Path) -> None:
        self.study, self.output = study, output
        self.begun = time.time()
        code = {"versions": versions(), "code": _code_digest()}
        self.made_by = {"command": command, "output": str(output), **code}

    @property
    def record(self) -> Path:
        """File in which it is remembered."""
        return self.output / _RECORD

    def recall(self) -> Answer | None:
        """Return what was said; None where anything is not as it was, or nothing is remembered."""
        try:
            check_file(self.record, _MOST_BYTES)
            record = json.loads(self.record.read_text(encoding="utf-8"))
            same = record["made_by"] == self.made_by and record["stages"] == self._stages
            same = same and record["files"] == _digests(record["files"])
            answer = Answer(**record["answer"])
            same = same and record["digest"] == json_digest(asdict(answer))
        except _UNREADABLE:
            return None
        return answer if same else None

    def remember(self, results: "FittedStudy", answer: Answer) -> None:
        """Store what is said of results; nothing if a file that they rest on changed meanwhile."""
        inputs = _input_files(self.study, results)
        if inputs is None or any(path.stat().st_mtime >= self.begun for path in inputs):
            return self.record.unlink(missing_ok=True)
        pages = [path for path in self.output.iterdir() if path.suffix in _PAGES]
        files = {*map(str, inputs), *(str(page) for page in pages if page != self.record)}
        record: dict[str, Any] = {
            "made_by": self.made_by,
            "stages": self._stages,
            "files": _digests(files),
            "answer": asdict(answer),
            "digest": json_digest(asdict(answer)),
        }
        return write_text(self.record, json.dumps(record) + "\n")

    @property
    def _stages(self) -> dict[str, str]:
        """SHA-256 of each stage."""
        folders = (path for path in (self.output / "stages").iterdir() if path.is_dir())
        return {path.name: folder_digest(path) for path in folders}


def _digests(files: Iterable[str]) -> dict[str, str]:
    return {file: file_digest(Path(file)) for file in files}


def _input_files(study: Path, results: "FittedStudy") -> set[Path] | None:
    """Return all files that results rest on; None where a mesh is missing."""
    from oed.study.parts import SimulatedData
    from robotmodels.collision.shapes import mesh_files
    from robotmodels.description.model_files import files_of

    settings = results.study
    data = settings.data.records, settings.data.frf, settings.robot, settings.truth
    named = [Path(file) for file in data if file is not None]
    lists = () if settings.candidates is None else settings.candidates.files
    files = {study.resolve(), *(path for path in named if path.is_file()), *lists}
    robots = [results.robot]
    if isinstance(results.data, SimulatedData):
        robots.append(results.data.plant)
    for robot in robots:
        meshes = [path for path in mesh_files(robot).values() if path is not None]
        if len(meshes) < len(mesh_files(robot)):
            return None
        files |= {*files_of(robot.model_file), *meshes}
    return files


def _code_digest() -> str:
    """Return what changes with any file of the packages: they may be a checkout that is edited."""
    stamps = []
    for package in _PACKAGES:
        for folder, names, files in os.walk(Path(__file__).parents[2] / package):
            names[:] = sorted(name for name in names if name != "__pycache__")
            status = ((name, os.stat(os.path.join(folder, name))) for name in sorted(files))
            stamps += [(name, one.st_mtime_ns, one.st_size) for name, one in status]
    return json_digest(stamps)
