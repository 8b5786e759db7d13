"""The summary: what was asked, what came out, what to beware of."""

import numpy as np

from oed.study.pipeline import StudyResults
from reports import text
from reports.parts import Section
from reports.sections.residuals import times_expected
from reports.template import filled


def section(results: StudyResults) -> Section:
    """Return the section."""
    r = results
    names, order = r.fit.parameters.names, np.argsort(r.std)
    body = filled(
        "summary.html.j2",
        results=r,
        misfit="" if r.residuals.explained else times_expected(r.residuals),
        n_positions=len(r.used),
        n_experiments=int(r.exact.repetitions.sum()),
        best=names[order[0]],
        best_std=text.percent(float(r.std[order[0]])),
        worst=names[order[-1]],
        worst_std=text.percent(float(r.std[order[-1]])),
        r_hat=r.posterior and text.fixed(float(np.max(r.posterior.r_hat)), 3),
        ess=r.posterior and text.count(round(float(np.min(r.posterior.ess)))),
        seconds=text.duration(sum(r.seconds.values())),
    )
    return Section("summary", "Summary", body)
