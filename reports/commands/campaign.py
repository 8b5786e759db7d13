"""``oed campaign``: visits proposed, run and told, until stated accuracies are reached."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from reports.commands.options import AsJson, robot_names, say, warn
from reports.commands.workers import one_thread_each

if TYPE_CHECKING:
    from oed import Campaign, CampaignStatus
    from robotmodels.common.progress import StageProgress

app = typer.Typer(
    no_args_is_help=True,
    help="Identify a robot step by step: ask for visits to run, return their records.",
)
File = Annotated[Path, typer.Argument(help="Campaign file.")]
Number = Annotated[int, typer.Argument(min=1, help="Number of the visit.")]


def register(parent: typer.Typer) -> None:
    """Add the commands."""
    parent.add_typer(app, name="campaign")


@app.command()
def init(
    robot: Annotated[
        str,
        typer.Argument(help="A built-in robot or a robot file.", autocompletion=robot_names),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="File to write; it must not exist.")
    ] = Path("campaign.yaml"),
) -> None:
    """Write a commented campaign file.

    Example: oed campaign init my_study/robot.yaml
    """
    from oed.campaign.template import write_template

    write_template(robot, output)
    typer.echo(f"written  {output}\nnext     replace its limits, then oed campaign ask {output}")


@app.command()
def ask(campaign: File, as_json: AsJson = False) -> None:
    """Print the visits to run; new ones are planned where none is open.

    Example: oed campaign ask campaign.yaml
    """
    with _exclusive(campaign) as (opened, bars):
        from reports.summaries.campaign_summary import visit_json, visits_text

        visits = opened.ask(bars)
        status, say_status = _reported(opened, campaign, bars)
        if visits:
            say(
                lambda: visits_text(visits, status, str(campaign)),
                lambda: [visit_json(visit) for visit in visits],
                as_json,
            )
        else:
            say_status(as_json)


@app.command()
def tell(
    campaign: File,
    visit: Number,
    records: Annotated[
        Path | None, typer.Argument(help="Records: .h5, .mat or .csv, of this visit alone.")
    ] = None,
    failed: Annotated[
        str | None, typer.Option(help="Why it gave no records; another takes its place.")
    ] = None,
) -> None:
    """Read the records of a visit, or note that it failed.

    Example: oed campaign tell campaign.yaml 3 visit_3.h5
    """
    from robotmodels.common.errors import InvalidInput

    with _exclusive(campaign) as (opened, _):
        from reports.summaries.campaign_summary import visit_range

        if (records is None) == (failed is None):
            raise InvalidInput(f"visit {visit}: give its records, or --failed with the reason")
        if records is None:
            opened.fail(visit, failed or "")
            done = "failed"
        else:
            done = "taken" if opened.tell(visit, records) else "was taken before"
        waiting = [one for one in opened.visits if one.state == "open"]
    step = f"run {visit_range(waiting)}" if waiting else f"oed campaign ask {campaign}"
    typer.echo(f"visit {visit} {done}; next  {step}")


@app.command()
def status(campaign: File, as_json: AsJson = False) -> None:
    """Print estimates, their accuracy and the minutes used; write page and identified robot.

    Example: oed campaign status campaign.yaml
    """
    with _exclusive(campaign) as (opened, bars):
        _, say_status = _reported(opened, campaign, bars)
    say_status(as_json)


@app.command()
def simulate(
    campaign: File,
    truth: Annotated[
        str,
        typer.Option(
            help="Robot to simulate: built-in, or a robot file.", autocompletion=robot_names
        ),
    ],
    whole: Annotated[
        bool, typer.Option("--whole", help="Continue until the campaign has ended.")
    ] = False,
) -> None:
    """Carry out the open visits on a simulated robot.

    Example: oed campaign simulate campaign.yaml --truth ur10
    """
    with _exclusive(campaign) as (opened, bars):
        from oed import simulate_visits
        from reports.summaries.columns import plural
        from robotmodels import load_robot

        robot, count = load_robot(truth), 0
        report = None if bars is None else (lambda done, total: bars("simulation", done, total))
        while visits := opened.ask(bars):
            simulate_visits(opened.settings, opened.robot, robot, visits, report)
            count += len(visits)
            if not whole:
                break
    done = f"simulated {plural(count, 'visit')}; " if count else ""
    if visits:
        typer.echo(f"{done}next  oed campaign ask {campaign}")
    else:
        typer.echo(f"{done}the campaign has ended; see  oed campaign status {campaign}")


@contextmanager
def _exclusive(campaign: Path) -> "Iterator[tuple[Campaign, StageProgress | None]]":
    """Give a campaign that no other command changes meanwhile, and progress bars."""
    one_thread_each()
    from estimators.frf.frf_from_records import collected_warnings
    from oed import Campaign
    from reports.summaries.progress import progress_bars
    from robotmodels.common.atomic_files import exclusive_folder

    opened = Campaign.load(campaign)
    with (
        exclusive_folder(opened.settings.output),
        collected_warnings() as warnings,
        progress_bars() as bars,
    ):
        yield opened, bars
    warn(warnings)


def _reported(
    opened: "Campaign", campaign: Path, bars: "StageProgress | None"
) -> "tuple[CampaignStatus, Callable[[bool], None]]":
    """Write the page and the identified robot; return the status and what prints it."""
    from reports.pages.campaign_page import write_campaign_page
    from reports.summaries.campaign_summary import status_json, status_text
    from robotmodels import save_robot

    status, output = opened.status(bars), opened.settings.output
    report = output / "report.html"
    write_campaign_page(opened, status, report, str(campaign))
    if status.estimate is not None:
        save_robot(opened.identified(status.estimate), output / "robot.yaml")

    def say_status(as_json: bool) -> None:
        words = f"report  {report}"
        say(
            lambda: f"{status_text(status, str(campaign))}\n{words}",
            lambda: status_json(status, report),
            as_json,
        )

    return status, say_status
