"""Provenance: from what the results were computed, with what, and how to do it again."""

from oed.study.parts import SimulatedData
from oed.study.results import FittedStudy, PlannedStudy
from reports import text
from reports.page_elements import Column, Number, Section, Table, filled, numbers, table
from robotmodels.common.fingerprints import file_digest, json_digest
from robotmodels.library.robot_digest import robot_digest


def section(results: PlannedStudy, command: str = "") -> Section:
    """Return the section; `command` is what made the report."""
    seconds = [(stage, Number(text.fixed(s, 1), s)) for stage, s in results.run.seconds.items()]
    versions = list(results.run.versions.items())
    body = filled(
        "provenance.html.j2",
        results=results,
        fitted=isinstance(results, FittedStudy),
        command=command,
        inputs=input_table(results),
        stages=table("stages", "Time per stage.", [Column("stage"), *numbers("time [s]")], seconds),
        versions=table("versions", "Versions.", [Column("of"), *numbers("version")], versions),
    )
    return Section("provenance", "Provenance", body)


def input_table(results: PlannedStudy) -> Table:
    """Return the SHA-256 of all that the results depend on."""
    study = results.study
    rows = [
        ("study", json_digest(study.model_dump(mode="json", by_alias=True, exclude={"output"})))
    ]
    rows.append(("robot file and URDF", robot_digest(results.robot)))
    data = results.data if isinstance(results, FittedStudy) else None
    if isinstance(data, SimulatedData) and data.plant is not results.robot:
        rows.append(("robot behind the data", robot_digest(data.plant)))
    for name in ("records", "frf"):
        path = getattr(study.data, name)
        if path is not None and path.exists():
            rows.append((str(path.name), file_digest(path)))
    caption = "What the results depend on, by the SHA-256 of its content."
    return table("inputs", caption, [Column("input"), Column("SHA-256", code=True)], rows)
