"""``oed campaign``: visits proposed, run and told, until stated accuracies are reached."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from reports.commands.options import AsJson, robot_names, say
from reports.commands.workers import one_thread_each

if TYPE_CHECKING:
    from oed import CampaignStatus, Visit

app = typer.Typer(
    no_args_is_help=True,
    help="Identify a robot step by step: ask which visits to run, tell their records.",
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
    one_thread_each()
    from oed import Campaign
    from reports.summaries.progress import progress_bars

    opened = Campaign.load(campaign)
    with progress_bars() as bars:
        visits = opened.ask(bars)
    if visits:
        say(lambda: _visits(visits), lambda: [_visit(visit) for visit in visits], as_json)
    else:
        _say_status(opened.status(), as_json)


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
    """Take the records of a visit, or note that it failed.

    Example: oed campaign tell campaign.yaml 3 visit_3.h5
    """
    from oed import Campaign
    from robotmodels.common.errors import InvalidInput

    opened = Campaign.load(campaign)
    if (records is None) == (failed is None):
        raise InvalidInput(f"visit {visit}: give its records, or --failed with the reason")
    if records is None:
        opened.fail(visit, failed or "")
        typer.echo(f"visit {visit} failed")
    elif opened.tell(visit, records):
        typer.echo(f"visit {visit} taken")
    else:
        typer.echo(f"visit {visit} was taken before")


@app.command()
def status(campaign: File, as_json: AsJson = False) -> None:
    """Print what is known how well, and the minutes used.

    Example: oed campaign status campaign.yaml
    """
    one_thread_each()
    from oed import Campaign
    from reports.summaries.progress import progress_bars

    with progress_bars() as bars:
        current = Campaign.load(campaign).status(bars)
    _say_status(current, as_json)


@app.command()
def simulate(
    campaign: File,
    truth: Annotated[
        str,
        typer.Option(
            help="Robot to simulate: built-in, or a robot file.", autocompletion=robot_names
        ),
    ],
) -> None:
    """Carry out the open visits on a simulated robot: a rehearsal.

    Example: oed campaign simulate campaign.yaml --truth ur10
    """
    one_thread_each()
    from oed import Campaign, simulate_visits
    from reports.summaries.progress import progress_bars
    from robotmodels import load_robot

    opened = Campaign.load(campaign)
    visits = opened.ask()
    with progress_bars() as bars:
        report = None if bars is None else (lambda done, total: bars("simulation", done, total))
        simulate_visits(opened.settings, opened.robot, load_robot(truth), visits, report)
    typer.echo(f"simulated {len(visits)} visits; next  oed campaign ask {campaign}")


def _visits(visits: "tuple[Visit, ...]") -> str:
    from reports.summaries.columns import table, vector

    rows = [
        (
            str(visit.number),
            visit.purpose,
            vector(visit.plan.positions[0], 3),
            str(visit.plan.periods),
            f"{visit.plan.duration:.0f} s",
        )
        for visit in visits
    ]
    header = ("visit", "purpose", "position [rad; m]", "periods", "time")
    folder = visits[0].folder
    return "\n".join(
        [
            *table(header, rows, right=(3, 4)),
            f"files for the controller: {folder / 'controller'}, and so of each visit",
            f"next  oed campaign tell CAMPAIGN {visits[0].number} RECORDS",
        ]
    )


def _visit(visit: "Visit") -> dict[str, Any]:
    return {
        "visit": visit.number,
        "purpose": visit.purpose,
        "position": visit.plan.positions[0].tolist(),
        "periods": visit.plan.periods,
        "duration": visit.plan.duration,
        "folder": str(visit.folder),
    }


def _say_status(current: "CampaignStatus", as_json: bool) -> None:
    say(lambda: _status(current), lambda: _status_document(current), as_json)


def _status(current: "CampaignStatus") -> str:
    from reports.summaries.columns import number, plural, table

    told = sum(visit.state == "told" for visit in current.visits)
    lines = [
        f"{current.state}: {plural(told, 'visit')} in {current.minutes:.1f} of "
        f"{current.budget:g} min"
        + (f", {current.expected:.1f} min asked for" if current.expected else "")
    ]
    estimate = current.estimate
    if estimate is None:
        return "\n".join(lines)
    rows = [
        (
            name,
            number(float(value), 5),
            f"{100 * float(std):.2g} %",
            f"{100 * float(target):.2g} %" if target < float("inf") else "",
            "" if std <= target else "not yet",
        )
        for name, value, std, target in zip(
            current.names, estimate.values, estimate.std, current.targets, strict=True
        )
    ]
    header = ("parameter", "value", "std", "asked for", "")
    lines += [
        *table(header, rows, right=(1, 2, 3)),
        f"verdict: {estimate.verdict}: {estimate.reason}",
    ]
    if estimate.drift == estimate.drift:
        lines.append(f"first visit repeated: p-value of no drift {estimate.drift:.2g}")
    return "\n".join(lines)


def _status_document(current: "CampaignStatus") -> dict[str, Any]:
    estimate = current.estimate
    document: dict[str, Any] = {
        "schema": "campaign_status/1",
        "state": current.state,
        "minutes": current.minutes,
        "expected_minutes": current.expected,
        "budget": current.budget,
        "visits": [{**_visit(visit), "state": visit.state} for visit in current.visits],
    }
    if estimate is not None:
        document |= {
            "verdict": estimate.verdict,
            "reason": estimate.reason,
            "drift": estimate.drift,
            "parameters": [
                {"name": name, "value": value, "relative_std": std, "target": target}
                for name, value, std, target in zip(
                    current.names,
                    estimate.values.tolist(),
                    estimate.std.tolist(),
                    current.targets.tolist(),
                    strict=True,
                )
            ],
        }
    return document
