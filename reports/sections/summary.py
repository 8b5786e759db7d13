"""The summary: what was asked, what came out, what to beware of."""

from oed.study.results import StudyResults
from reports import text
from reports.page_elements import Section, filled
from reports.sections.plan_labels import cost, counts, data_words, time_words


def section(results: StudyResults) -> Section:
    """Return the section."""
    usable, trust = results.fit_summary.usable, results.trust
    posterior = results.uncertainty_summary.posterior
    body = filled(
        "summary.html.j2",
        results=results,
        plan=results.plan_summary,
        cost=cost(results),
        data=data_words(results),
        counts=counts(results),
        time=time_words(results),
        ends=[
            (trust.names[i], text.percent(float(trust.std[i]))) for i in usable[:1] + usable[-1:]
        ],
        r_hat=posterior and text.fixed(posterior.r_hat, 3),
        ess=posterior and text.count(round(posterior.ess)),
        seconds=text.duration(results.run.total_seconds),
    )
    return Section("summary", "Summary", body)
