"""The page of ``oed margins``: margins of each motor, all loops at once, what may help."""

from pathlib import Path

from estimators.trust.trust import Trust
from estimators.validation.controller_margins import ControllerMargins
from reports import text
from reports.page_elements import Section, filled, page
from reports.sections.controller import loops_body, remedy_words, stability_body
from reports.sections.verdict import bands_banner
from robotmodels.common.atomic_files import write_text


def write_margins_page(
    margins: ControllerMargins, name: str, spread: str, path: Path, trust: Trust | None = None
) -> None:
    """Write margins as one HTML file that needs nothing else.

    Parameters
    ----------
    spread : str
        What the bands rest on, in words.
    trust : Trust, optional
        Of the fit that predicts; None of a robot file.
    """
    band = margins.band
    remedies = [text.sentence(remedy_words(r, margins.motors)) for r in margins.remedies]
    sections = [
        Section("loops", "Margins", loops_body(margins)),
        Section("stability", "All loops at once", stability_body(margins)),
        Section(
            "remedies", "Proposed changes", filled("margins_remedies.html.j2", remedies=remedies)
        ),
    ]
    lead = (
        f"What the identified parameters say of the controller in "
        f"{text.plural(len(band.positions), 'position')}, with {text.level(band.level)} intervals "
        f"of their remaining uncertainty ({spread}); errors of the model are not in them."
    )
    banner, kicker = bands_banner(band.level, trust), "What this means for the controller"
    write_text(path, page(name, "margins", kicker, lead, sections, banner))
