"""``oed run`` and ``oed fit`` on a study of movements."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from reports.commands.options import say
from reports.commands.studies import working
from reports.commands.workers import one_thread_each

if TYPE_CHECKING:
    from oed.study.deflection_study import DeflectionResults


def compute_deflection_study(study: Path, as_json: bool, with_page: bool = True) -> None:
    """Fit the movements of a study; write numbers, the identified robot and the page."""
    one_thread_each()  # before anything loads the numerics
    from oed.study.deflection_study import run_deflection_study
    from oed.study.settings.deflection_settings import load_deflection_study
    from reports.summaries.deflection_summary import deflection_json, deflection_summary
    from robotmodels import save_robot
    from robotmodels.common.atomic_files import staged_folder

    content = load_deflection_study(study)
    command = f"oed run {shlex.quote(str(study))}" if with_page else ""
    with working(study, 1, None), staged_folder(content.output) as folder:
        results = run_deflection_study(content)
        files = [content.output / name for name in _write(results, folder, command)]
    fit, shares = results.fit, results.shares
    save_robot(fit.robot(), files[1])  # its paths are relative to where it lies
    say(
        lambda: deflection_summary(fit, shares, files),
        lambda: deflection_json(fit, shares) | {"files": [str(file) for file in files]},
        as_json,
    )


def _write(results: "DeflectionResults", folder: Path, command: str) -> list[str]:
    """Write the files of a study, the page if a `command` made it; return their names."""
    from reports.pages.deflection_page import write_deflection_page
    from reports.summaries.deflection_summary import deflection_json
    from robotmodels.common.plain_data import write_json

    fit = results.fit
    names = ["deflection.json", f"{fit.start.name}_identified.yaml"]
    write_json(folder / names[0], deflection_json(fit, results.shares))
    if command:
        names.append("report.html")
        write_deflection_page(results, folder / names[-1], command)
    return names
