"""The page that puts a study beside the one of Wernholt and Moberg (2008)."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup

import robotmodels
from oed.replication.conclusions import Judged
from oed.replication.local_minima import LocalMinima
from oed.replication.replicate import Replication
from oed.replication.time_domain_comparison import TimeDomainComparison
from oed.study.results import FittedStudy
from oed.study.settings.study_file import ESTIMATORS
from reports import text
from reports.figures import replication_figures as figures
from reports.figures.response_panels import response_panels
from reports.page_elements import Figure, Section, figure, filled, page, page_banner
from reports.pages import replication_tables as tables
from robotmodels.common.atomic_files import write_text

_MEANS = {
    "ari": "the arithmetic mean",
    "har": "the harmonic mean",
    "log": "the geometric mean",
    "h1": "least squares (H1)",
    "jio": "instrumental variables (JIO)",
}
_ELEMENT = 3
"""Figure 8 shows element (4,4), or the last one."""


def write_published(results: FittedStudy, published: Replication, path: Path) -> None:
    """Write the comparison as one HTML file."""
    content = page(
        title=f"{results.robot.name} and an ABB IRB6600",
        kind="a published study repeated",
        kicker="Wernholt and Moberg (2008), section 6, repeated in simulation",
        lead=(
            "Six estimators, the same perturbed starts, one cost to judge all models; the paper's "
            "numbers beside those found here."
        ),
        sections=[
            _conclusions(results, published),
            _models(results, published),
            _parameters(results, published),
            _responses(results, published),
            *([] if published.minima is None else [_minima(published.minima)]),
            *(
                []
                if published.time_domain is None
                else [_time_domain(published.time_domain, published.seconds)]
            ),
        ],
        banner=_banner(published.conclusions),
    )
    write_text(path, content)


def _banner(conclusions: Sequence[Judged]) -> Markup:
    """Return how many of the paper's conclusions the study supports, and which it does not."""
    numbers: dict[str, list[int]] = {}
    for number, one in enumerate(conclusions, start=1):
        numbers.setdefault(one.verdict, []).append(number)
    supported = len(numbers.get("supported", []))
    step = "see the evidence for each conclusion below"
    if "undecided" in numbers:
        step += "; more starts (fit: starts) decide more of the comparisons"
    return page_banner(
        f"{supported} of {text.plural(len(conclusions), 'conclusion')} supported",
        "sound" if supported == len(conclusions) else "doubtful",
        text.sentence("; ".join(f"{one}: {text.ranges(i)}" for one, i in numbers.items())),
        quote="Numbers to quote, with their verdict, are in the report of the study.",
        next_step=step,
    )


def _conclusions(results: FittedStudy, published: Replication) -> Section:
    body = filled(
        "published_conclusions.html.j2",
        results=results,
        published=published,
        models=published.evaluation.user.size,
    )
    return Section("conclusions", "Conclusions", body)


def _models(results: FittedStudy, published: Replication) -> Section:
    e = published.evaluation
    user = figure(
        "figure-3",
        figures.costs(e, e.user_normalised, "cost, user-defined weights", limit=True),
        "Sorted normalised costs with user-defined weights of all models of each estimator",
    )
    optimal = figure(
        "figure-4",
        figures.costs(e, e.optimal_normalised, "cost, optimal weights"),
        "Sorted normalised costs with optimal weights of all models of each estimator",
    )
    other, study = published.as_published, results.study
    body = filled(
        "published_models.html.j2",
        results=results,
        means=_MEANS,
        excitation=study.data.experiment,
        fit=study.fit,
        other=None
        if other is None
        else figure(
            "figure-3-published",
            figures.costs(
                other.evaluation,
                other.evaluation.user_normalised,
                "cost, user-defined weights",
                limit=True,
            ),
            "Sorted normalised costs of all models, with the paper's choices",
        ),
        stopped=0 if other is None else int((other.evaluation.converged == 0).sum()),
        user=user,
        optimal=optimal,
        shares=tables.shares(published),
        within=published.table.within,
        starts=len(results.fits.starts),
    )
    return Section("models", "Costs of all models", body)


def _parameters(results: FittedStudy, published: Replication) -> Section:
    g = published.groups
    truth = np.log(published.reference.parameters.values / results.truth)
    drawn = [
        _parameter_figure(id, published, indices, estimators, what, caption)
        for id, indices, estimators, what, caption in (
            ("figure-5", g.gear_springs, ESTIMATORS, "gearbox springs", "figure 5 of the paper"),
            ("figure-6", g.arm_springs, ESTIMATORS, "arm springs", "figure 6"),
            ("figure-7a", g.gear_dampers, ESTIMATORS[:3], "gearbox dampers", "figure 7, above"),
            ("figure-7b", g.arm_dampers, ESTIMATORS[:3], "arm dampers", "figure 7, below"),
        )
        if indices
    ]
    body = filled(
        "published_parameters.html.j2",
        figures=drawn,
        table=tables.table_1(published, truth / published.theorem1.std),
        paper=tables.paper_table_1(),
    )
    return Section("parameters", "Parameters", body)


def _parameter_figure(
    id: str,
    published: Replication,
    indices: tuple[int, ...],
    estimators: tuple[str, ...],
    what: str,
    like: str,
) -> Figure:
    labels = [published.evaluation.parameters[i].split(".")[0] for i in indices]
    draw = figures.parameters(published.evaluation, indices, estimators, labels)
    alt = f"Values of the {what} over those of the best model, for {', '.join(estimators)}"
    return figure(id, draw, alt, caption=f"{what[0].upper()}{what[1:]}, as {like}.")


def _responses(results: FittedStudy, published: Replication) -> Section:
    """Show the best models in the position that alone says most."""
    e, single = published.evaluation, results.fits.searches["LLS1U"]
    estimate = results.data.frf.subset(single.positions)
    position = estimate.positions
    indices = e.values[e.of("LLS15U"), : figures.best_count(e)]
    models = np.array(
        [
            robotmodels.frequency_response(results.robot, position, estimate.omega, values)[0]
            for values in indices
        ]
    )
    last = min(_ELEMENT, *(side - 1 for side in estimate.response.shape[2:]))
    measured = estimate.response[0]
    several = figure(
        "figure-8",
        figures.best_responses(estimate.omega, models, measured, (last, last)),
        f"Element ({last + 1}, {last + 1}) of the frequency responses of the best models",
    )
    drawing = response_panels(
        estimate.omega,
        measured,
        np.sqrt(estimate.variance[0]),
        models[0],
        results.robot.motor_names,
        outputs=results.robot.output_names,
    )
    alt = "Magnitudes and phases of the measured responses and of the best model"
    body = filled(
        "published_responses.html.j2",
        several=several,
        all=figure("figure-9", drawing, alt, wide=True),
        element=f"({last + 1},{last + 1})",
        count=len(models),
        number=int(single.positions[0]) + 1,
    )
    return Section("responses", "Frequency responses", body)


def _minima(minima: LocalMinima) -> Section:
    body = filled("published_minima.html.j2", minima=minima, table=tables.minima(minima))
    return Section("minima", "Local minima against excitation and time", body)


def _time_domain(comparison: TimeDomainComparison, seconds: dict[str, float]) -> Section:
    body = filled(
        "published_time_domain.html.j2",
        comparison=comparison,
        table=tables.time_domain(comparison),
        seconds=seconds["time-domain"],
    )
    return Section("time-domain", "Fits in time", body)
