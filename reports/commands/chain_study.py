"""``oed run`` on a study of coupled chains."""

from pathlib import Path

from reports.commands.options import say, warn
from reports.commands.studies import working
from reports.commands.workers import one_thread_each


def compute_chain_study(study: Path, as_json: bool) -> None:
    """Simulate and identify the chains of a study, and write records, numbers and pages."""
    one_thread_each()  # before anything loads the numerics
    from estimators.frf.file_formats import write_frf
    from oed.chain_study.run_chain_study import run_chain_study
    from oed.chain_study.study_file import load_chain_study
    from reports.pages.chain_study_page import write_chain_study_page
    from reports.pages.chains_page import write_chains_page
    from reports.summaries.chain_study_summary import (
        chain_study_json,
        chain_study_summary,
        write_chain_study,
    )
    from robotmodels.common.atomic_files import staged_folder

    content = load_chain_study(study)
    with working(study, 1, None) as (progress, _), staged_folder(content.output) as folder:
        results = run_chain_study(content, folder, progress)
        write_frf(folder / "frf.h5", results.measured.frf.estimate)
        write_chain_study(results, folder / "chain_study.json")
        write_chains_page(results.measured, content.output / "records.h5", folder / "chains.html")
        write_chain_study_page(results, folder / "report.html")
    warn(results.measured.warnings)
    names = ("records.h5", "frf.h5", "chain_study.json", "chains.html", "report.html")
    files = [content.output / name for name in names]
    say(
        lambda: chain_study_summary(results, files),
        lambda: chain_study_json(results, files),
        as_json,
    )
