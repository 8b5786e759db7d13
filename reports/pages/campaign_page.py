"""The page of a campaign, which grows with its visits: what to do next, and what is known."""

from pathlib import Path

import numpy as np

from oed import Campaign, CampaignStatus, Visit
from oed.campaign.estimate import Estimate, fit_at, fitted_visits
from oed.experiment.loop_settings import per_motor
from reports import text
from reports.figures.campaign_figures import accuracies, torque_spectra
from reports.figures.response_panels import lines_drawn
from reports.page_elements import (
    Cell,
    Column,
    Number,
    Row,
    Section,
    Table,
    figure,
    filled,
    numbers,
    page,
    page_banner,
    percent_cell,
    table,
)
from reports.sections import run_spectra
from reports.sections.friction import friction_table
from reports.sections.parameters import kind_of
from reports.sections.verdict import discredited, interval_cells
from reports.summaries.campaign_summary import (
    PURPOSES,
    headline,
    minutes,
    next_command,
    remarks,
    visit_range,
)
from robotmodels.common.arrays import Array
from robotmodels.common.atomic_files import write_text

_LATEST = 6
"""Visits whose spectra are drawn."""


def write_campaign_page(
    campaign: Campaign, status: CampaignStatus, path: Path, command: str
) -> None:
    """Write a campaign as one HTML file that needs nothing else.

    Parameters
    ----------
    command : str
        Campaign file as it was typed.
    """
    sections = [_progress(campaign, status), _visits(campaign, status, command)]
    if status.estimate is not None:
        sections += _spectra(campaign, status.estimate, fitted_visits(status.visits)[-_LATEST:])
    step = next_command(status, command)
    doubtful = status.state in ("in doubt", "out of reach", "minutes used")
    banner = page_banner(
        headline(status),
        "doubtful" if doubtful else "sound",
        _reason(status),
        next_step=step or "use the identified robot in robot.yaml, beside this page",
    )
    content = page(
        title=campaign.robot.name,
        kind="campaign",
        kicker="Identification of an elastic robot, visit by visit",
        lead="Visits to run, identified stiffness and damping, and their uncertainty.",
        sections=sections,
        banner=banner,
    )
    write_text(path, content)


def _reason(status: CampaignStatus) -> str:
    """Return the first remark, or how many targets are reached."""
    if spoken := remarks(status):
        return text.typeset(text.sentence(spoken[0]))
    if status.open:
        return f"{len(status.open)} of {text.plural(len(status.visits), 'visit')} are to be run"
    asked = int(np.isfinite(status.targets).sum())
    return f"{asked - len(status.short_of)} of {asked} accuracies are reached"


def _progress(campaign: Campaign, status: CampaignStatus) -> Section:
    """Return minutes, accuracies and parameters."""
    history, outlook = status.history, status.outlook
    tiles = {
        "state": status.state,
        "used": minutes(status.minutes),
        "visits to run": minutes(status.expected),
        "left": minutes(status.remaining),
    }
    if outlook is not None:
        tiles["needed at least"] = minutes(outlook.needed)
    drawn = None
    if len(history):
        drawing = accuracies(status.names, history.minutes, history.std / status.targets)
        alt = "Standard deviations over their targets, after each fit, over the minutes used"
        drawn = figure("accuracies", drawing, alt)
    body = filled(
        "campaign_progress.html.j2",
        tiles=tiles,
        remarks=remarks(status),
        parameters=parameter_table(campaign, status),
        friction=None if status.estimate is None else friction_table(status.estimate.friction),
        accuracies=drawn,
    )
    return Section("progress", "Progress", body)


def parameter_table(campaign: Campaign, status: CampaignStatus) -> Table | None:
    """Return every parameter with its interval, its accuracy and what was asked for."""
    if status.estimate is None:
        return None
    groups: dict[str, list[Row]] = {}
    borne = status.estimate.bears(status.targets)
    for i, one in enumerate(status.estimate.trust.intervals):
        factor, unit = text.scaled_unit(one.value, campaign.robot.parameters.units[i])
        std, target = float(status.estimate.std[i]), float(status.targets[i])
        decimals = text.decimals_for(std * one.value / factor)
        struck = "" if borne else discredited(one)
        row: Row = (
            one.name,
            Number(text.fixed(one.value / factor, decimals), one.value / factor, struck),
            *interval_cells(one, factor, decimals),
            unit,
            percent_cell(std, struck),
            percent_cell(target),
            _progress_cell(status, i),
            str(one.verdict),
        )
        groups.setdefault(kind_of(one.name), []).append(row)
    columns = (
        Column("parameter", code=True),
        *numbers("estimate", "95 % from", "to"),
        Column("unit", "u"),
        *numbers("std [%]", "target [%]", "std of the last fits [%]"),
        Column("verdict"),
    )
    caption = "Estimates with 95 % intervals, relative standard deviations and their targets."
    rows = tuple((kind, tuple(map(tuple, group))) for kind, group in groups.items())
    return Table("estimates", caption, columns, rows)


def _progress_cell(status: CampaignStatus, i: int) -> Cell:
    """Return the last standard deviations of a parameter, oldest first."""
    std = status.history.std[-3:, i]
    return Number(
        " → ".join(percent_cell(float(value)).text for value in std), 100 * float(std[-1])
    )


def _visits(campaign: Campaign, status: CampaignStatus, command: str) -> Section:
    estimate = status.estimate
    drift = np.nan if estimate is None else estimate.drift
    body = filled(
        "campaign_visits.html.j2",
        campaign=command,
        folder=f"{campaign.settings.output.name}/visits/NUMBER/controller",
        visits=visit_table(campaign, status),
        drift=text.probability(drift) if np.isfinite(drift) else "",
    )
    return Section("visits", "Visits", body)


def visit_table(campaign: Campaign, status: CampaignStatus) -> Table:
    """Return all visits: where, for how long, and what the records of the fitted ones are like."""
    straight = [joint in campaign.robot.elements.prismatic for joint in campaign.robot.motor_joints]
    limits = _limits(campaign)
    numbers_of_fitted = [visit.number for visit in fitted_visits(status.visits)]
    rows: list[Row] = []
    for visit in status.visits:
        index = numbers_of_fitted.index(visit.number) if visit.number in numbers_of_fitted else None
        time = visit.plan.duration / 60
        rows.append(
            (
                Number(str(visit.number), visit.number),
                PURPOSES[visit.purpose],
                ", ".join(text.format_position(visit.plan.positions[0], straight)),
                Number(str(visit.plan.periods), visit.plan.periods),
                Number(text.fixed(time, 1), time),
                visit.state if visit.state != "failed" else f"failed: {visit.failure}",
                *_record_cells(status.estimate, index, limits),
            )
        )
    columns = [
        *numbers("visit"),
        Column("purpose"),
        Column("position"),
        *numbers("periods", "time [min]"),
        Column("state"),
        *numbers("torque / limit", "speed / limit", "cost / expected"),
    ]
    caption = (
        "Visits in the order of proposal. Of those that are fitted the largest torque and speed of "
        "any motor over its limit, and squared residuals over their expectation."
    )
    return table("visits-table", caption, columns, rows)


def _record_cells(estimate: Estimate | None, index: int | None, limits: Array) -> list[Cell]:
    """Return peaks over limits and cost of a fitted visit."""
    if estimate is None or index is None or index >= len(estimate.visit_costs):
        return ["–", "–", "–"]
    ratios = (estimate.peaks[index] / limits).max(axis=1)
    cells: list[Cell] = [
        Number(text.fixed(float(r), 2), float(r)) if r > 0 else "no limit" for r in ratios
    ]
    cost = float(estimate.visit_costs[index])
    return [*cells, Number(text.significant(cost, 3), cost)]


def _limits(campaign: Campaign) -> Array:
    """Return limits of torques and speeds, (2, n), infinite where there are none."""
    motors, limits = tuple(campaign.robot.motor_names), campaign.settings.limits
    choices = (("limits.torque", limits.torque), ("limits.speed", limits.speed))
    return np.array(
        [
            np.full(len(motors), np.inf) if choice is None else per_motor(key, choice, motors)
            for key, choice in choices
        ]
    )


def _spectra(campaign: Campaign, estimate: Estimate, visits: list[Visit]) -> list[Section]:
    """Return torques and outputs of the latest visits."""
    fit = fit_at(estimate, campaign.robot, visits, friction=campaign.settings.friction)
    omega, labels = fit.data.omega, [f"visit {visit.number}" for visit in visits]
    torques = [
        figure(
            f"torques-{visit.number}",
            torque_spectra(omega, np.abs(fit.data.inputs[q, 0]), campaign.robot.motor_names),
            f"Torques of each motor on each line in {labels[q]}",
            label=text.sentence(labels[q]),
        )
        for q, visit in reversed([*enumerate(visits)])
    ]
    lines = lines_drawn((1, len(omega), fit.data.outputs.shape[3], len(visits)))
    shown = (np.moveaxis(s[:, 0], 0, 2)[lines] for s in run_spectra.compared_spectra(fit))
    drawing = run_spectra.drawn_spectra(campaign.robot, omega[lines], shown, labels)
    alt = "Magnitudes and phases of the spectra of outputs, measured and predicted"
    runs = figure("spectra", drawing, alt, label=text.sentence(visit_range(visits)), wide=True)
    body = run_spectra.body(campaign.robot, fit, [runs])
    return [
        Section("torques", "Torques", filled("campaign_torques.html.j2", panels=torques)),
        Section("runs", "Runs", body),
    ]
