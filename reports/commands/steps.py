"""``oed design``, ``oed fit``, ``oed sample``: a study as far as one of its results."""

import shlex
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from reports.commands.deflection_study import compute_deflection_study
from reports.commands.options import WORKERS, AsJson, Workers
from reports.commands.studies import (
    Cluster,
    Fresh,
    StudyFile,
    answer_study,
    compute_study,
    study_kind,
)
from reports.commands.visit_study import compute_visit_study

if TYPE_CHECKING:
    from oed.study.stage_cache import Failure

_PURPOSE = {
    "design": "Design the experiment: candidates, optimal positions, numbers of visits, expected "
    "standard deviations; writes design.json and the page design.html.",
    "fit": "Read or simulate the data of a study and fit them; writes design.json and fit.json.",
    "sample": "Compute the uncertainty of a study's fit, by Theorem 1 and emcee; "
    "writes uncertainty.json.",
}
_RESUMED = "Results of earlier commands are reused while their inputs are unchanged."
_WRITTEN = {
    "design": ("design.json", "design.html"),
    "fit": ("fit.json",),
    "sample": ("uncertainty.json",),
}


def register(app: typer.Typer) -> None:
    """Add the commands."""
    for name, purpose in _PURPOSE.items():
        told = f"{purpose}\n\n{_RESUMED}\n\nExample: oed {name} studies/ur10.yaml"
        app.command(name, help=told)(_up_to(name))


def _up_to(name: str) -> Callable[..., None]:
    """Return the command that ends with the result of its name."""

    def command(
        study: StudyFile,
        workers: Workers = WORKERS,
        cluster: Cluster = None,
        fresh: Fresh = False,
        as_json: AsJson = False,
    ) -> None:
        if name == "fit" and study_kind(study) == "movements":
            compute_deflection_study(study, as_json, with_page=False)
            return
        if name == "design" and study_kind(study) == "visits":
            compute_visit_study(study, as_json, with_page=False)
            return
        from oed.study import pipeline

        steps = {
            "design": pipeline.design_study,
            "fit": pipeline.fit_study,
            "sample": pipeline.run_study,
        }
        pages = partial(_design_page, study) if name == "design" else None
        results = compute_study(study, steps[name], workers, fresh, pages, cluster=cluster)
        answer_study(study, results, _WRITTEN[name], as_json)

    return command


def _design_page(study: Path, results: Any, folder: Path, progress: Any) -> "tuple[Failure, ...]":
    from reports.pages.design_page import write_design_page

    write_design_page(results, folder / "design.html", f"oed design {shlex.quote(str(study))}")
    return ()
