"""``oed import``: a controller's log becomes movements in SI units, by a mapping."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from reports.commands.options import AsJson, robot_names, say
from reports.commands.workers import one_thread_each

if TYPE_CHECKING:
    from robotmodels import ElasticRobot
    from robotmodels.common.progress import StageProgress
    from robotmodels.logs.importer import Import
    from robotmodels.logs.log import Log


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("import")(import_log)


def import_log(
    logs: Annotated[list[Path], typer.Argument(help="Files of one recording.")],
    mapping: Annotated[
        Path | None,
        typer.Option(help="What the channels mean (YAML); without it one is proposed."),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(help="Robot (name or file) that was recorded.", autocompletion=robot_names),
    ] = None,
    sample_time: Annotated[
        float | None,
        typer.Option(
            min=1e-9, max=1e9, help="Sample time in s, if the log has no time; for a proposal."
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder; by default the current one.")
    ] = Path(),
    as_json: AsJson = False,
) -> None:
    """Read a controller's log: propose what its channels mean, or convert them by a mapping.

    Example: oed import log.csv --robot robot.yaml, then with --mapping import.yaml
    """
    one_thread_each()
    from reports.summaries.progress import progress_bars
    from robotmodels.library import load_robot
    from robotmodels.logs.open_log import open_log

    target = output.resolve()
    model = None if robot is None else load_robot(robot)
    with progress_bars() as progress, open_log(logs, progress) as log:
        if mapping is None:
            _propose(log, model, robot, sample_time, target, as_json)
        else:
            _convert(log, model, mapping, target, as_json, progress)


def _propose(
    log: "Log",
    robot: "ElasticRobot | None",
    name: str | None,
    sample_time: float | None,
    target: Path,
    as_json: bool,
) -> None:
    from estimators.logs.proposal import propose_mapping
    from reports.pages.import_page import write_import_page
    from reports.summaries.import_summary import mapping_text, proposal_json, proposal_summary
    from robotmodels.common.atomic_files import staged_folder, write_text
    from robotmodels.common.file_paths import robot_reference
    from robotmodels.logs.importer import Import
    from robotmodels.logs.mapping_file import TimeChoice

    proposal = propose_mapping(log, robot, TimeChoice(sample_time=sample_time))
    named = {} if name is None else {"robot": robot_reference(target / "import.yaml", name)}
    mapping = proposal.mapping.model_copy(update=named)
    evidence = [entry.evidence for entry in proposal.entries if entry.signal is not None]
    with staged_folder(target) as folder:
        source = log.files[0].name
        write_text(
            folder / "import.yaml", mapping_text(mapping, evidence, source, proposal.unmapped)
        )
        write_import_page(
            Import(log, mapping, robot), proposal.entries, proposal.findings, folder / "import.html"
        )
    files = [target / "import.yaml", target / "import.html"]
    say(lambda: proposal_summary(proposal, files), lambda: proposal_json(proposal, files), as_json)


def _convert(
    log: "Log",
    robot: "ElasticRobot | None",
    mapping: Path,
    target: Path,
    as_json: bool,
    progress: "StageProgress | None",
) -> None:
    from estimators.logs.completion import complete_mapping
    from estimators.logs.mapping_checks import mapping_findings
    from reports.summaries.import_summary import import_json, import_summary
    from robotmodels.logs.importer import Import
    from robotmodels.logs.importing import mapped_robot
    from robotmodels.logs.mapping_file import read_mapping

    choice = read_mapping(mapping)
    model = robot if robot is not None else mapped_robot(choice, mapping.parent)
    choice, derived = complete_mapping(log, choice, model)
    source = Import(log, choice, model, progress)
    findings = (*derived, *mapping_findings(source))
    files, reasons = _written(source, findings, target)
    told = (*findings, *reasons)
    say(
        lambda: import_summary(source, told, files),
        lambda: import_json(source, told, files),
        as_json,
    )


def _written(
    source: "Import", derived: tuple[str, ...], target: Path
) -> tuple[list[Path], tuple[str, ...]]:
    """Write movements, and records of what is periodic; return files and what was seen."""
    from reports.pages.import_page import write_import_page
    from robotmodels.common.atomic_files import staged_folder
    from robotmodels.logs.importer import write_import
    from robotmodels.logs.periodic import found_records

    records, reasons = found_records(source)
    names = ["movements.h5", "import.html"]
    with staged_folder(target) as folder:
        write_import(source, folder / "movements.h5")
        if records is not None:
            records.save(folder / "records.h5")
            names.insert(0, "records.h5")
        findings = (*derived, *reasons, *source.notes)
        write_import_page(source, (), findings, folder / "import.html")
    return [target / name for name in names], reasons
