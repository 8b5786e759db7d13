"""The summary: what was asked, what came out, what to beware of."""

import numpy as np

from oed.study.results import StudyResults
from reports import text
from reports.page_elements import Section, filled
from reports.sections.plan_labels import cost, counts
from reports.sections.verdict import usable


def section(results: StudyResults) -> Section:
    """Return the section."""
    r = results
    names, std = r.trust.names, r.trust.std
    order = sorted(usable(r.trust), key=lambda i: std[i])
    body = filled(
        "summary.html.j2",
        results=r,
        n_positions=len(r.used),
        cost=cost(r),
        counts=counts(r),
        ends=[(names[i], text.percent(float(std[i]))) for i in order[:1] + order[-1:]],
        r_hat=r.posterior and text.fixed(float(np.max(r.posterior.r_hat)), 3),
        ess=r.posterior and text.count(round(float(np.min(r.posterior.ess)))),
        seconds=text.duration(sum(r.seconds.values())),
    )
    return Section("summary", "Summary", body)
