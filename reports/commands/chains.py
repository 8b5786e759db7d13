"""``oed chains``: masses, springs and couplings of coupled chains from records."""

from typing import TYPE_CHECKING, Annotated

import typer

from reports.commands.options import AsJson, BesideRecords, Delay, Hold, Records, say, warn
from reports.commands.workers import one_thread_each
from robotmodels.common.errors import InvalidInput

if TYPE_CHECKING:
    from robotmodels.common.arrays import Array


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(chains)


def chains(
    records: Records,
    masses: Annotated[
        int | None,
        typer.Option("-n", "--masses", help="Masses in each chain, N; proposed if not given."),
    ] = None,
    position: Annotated[int, typer.Option(min=1, help="Position to use, from 1.")] = 1,
    motor_inertias: Annotated[
        str | None,
        typer.Option(
            help="Inertias of the motors by their data sheet, in kg m^2: 1.3e-3,1.3e-3,1.2e-3."
        ),
    ] = None,
    delay: Delay = 0.0,
    hold: Hold = True,
    output: BesideRecords = None,
    as_json: AsJson = False,
) -> None:
    """Identify masses, springs and couplings of chains from motor torques and angles.

    Example: oed chains records.h5 --masses 3
    """
    one_thread_each()
    from estimators.chain_dampers.chains_from_records import measured_chains
    from estimators.chains.model_order import WrongModeCount
    from estimators.frf.file_formats import write_frf
    from reports.pages.chains_page import write_chains_page, write_modes_page
    from reports.summaries.chains_summary import chains_json, chains_summary, write_chains
    from reports.summaries.progress import progress_bars
    from robotmodels.common.atomic_files import staged_folder

    target = (records.parent if output is None else output).resolve()
    with progress_bars() as progress:
        try:
            measured = measured_chains(
                records,
                masses,
                position=position - 1,
                delay=delay,
                hold=hold,
                first_masses=_inertias(motor_inertias),
                progress=progress,
            )
        except WrongModeCount as error:
            with staged_folder(target) as folder:
                write_modes_page(error, records, folder / "modes.html")
            raise error.with_picture(target / "modes.html") from None
        with staged_folder(target) as folder:
            write_frf(folder / "frf.h5", measured.frf.estimate)
            write_chains(measured, folder / "chains.json")
            write_chains_page(measured, records, folder / "chains.html")
    warn(measured.warnings)
    files = [target / name for name in ("frf.h5", "chains.json", "chains.html")]
    say(lambda: chains_summary(measured, files), lambda: chains_json(measured, files), as_json)


def _inertias(words: str | None) -> "Array | None":
    """Return the motors' inertias as an array.

    Raises
    ------
    InvalidInput
        If they are not numbers.
    """
    if words is None:
        return None
    import numpy as np

    try:
        return np.array([float(word) for word in words.split(",")])
    except ValueError:
        raise InvalidInput(
            f"--motor-inertias {words!r}: numbers separated by commas are needed, one per motor"
        ) from None
