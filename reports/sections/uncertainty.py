"""Uncertainty: convergence of the posterior, correlations, and its shape."""

import numpy as np

from estimators.sampling.convergence import ESS, R_HAT, TIMES
from estimators.sampling.posterior import Posterior
from estimators.uncertainty.covariance import Uncertainty
from oed.study.results import StudyResults
from reports import text
from reports.figures import corner_figure, posterior_figures, profile_figures, uncertainty_figures
from reports.page_elements import (
    Column,
    Figure,
    Number,
    Section,
    Table,
    figure,
    filled,
    number_cell,
    numbers,
    table,
)

CORNER_PARAMETERS = 6
CORNER_DRAWS = 40_000


def section(results: StudyResults, theorem1: Uncertainty, posterior: Posterior) -> Section:
    """Return the section."""
    body = filled(
        "uncertainty.html.j2",
        results=results,
        posterior=posterior,
        facts={
            "steps": text.count(posterior.steps),
            "r_hat": text.fixed(float(np.max(posterior.r_hat)), 3),
            "ess": text.count(round(float(np.min(posterior.ess)))),
            "tau": text.significant(float(np.max(posterior.autocorrelation_time)), 2),
            "r_hat_limit": text.fixed(R_HAT, 2),
            "ess_limit": text.count(int(ESS)),
            "tau_limit": text.count(int(TIMES)),
            "acceptance": text.percent(float(np.mean(posterior.acceptance))),
        },
        correlation=correlation(theorem1),
        strongest=strongest_correlation(theorem1),
        corner=corner(results, theorem1, posterior),
        corner_names=corner_names(theorem1),
        traces=traces(results, theorem1, posterior),
        profiles=profiles(results, theorem1),
        convergence=convergence_table(posterior),
    )
    return Section("uncertainty", "Uncertainty", body)


def correlation(t: Uncertainty) -> Figure:
    """Return the heat map of correlations."""
    drawing = uncertainty_figures.correlation_map(t.names, t.correlation)
    return figure(
        "correlation", drawing, "Heat map of the correlations between all estimated parameters"
    )


def strongest_correlation(t: Uncertainty) -> tuple[str, str, str]:
    """Return two parameters, and their correlation."""
    size = np.abs(np.triu(t.correlation, 1))
    i, j = np.unravel_index(np.argmax(size), size.shape)
    return t.names[i], t.names[j], text.fixed(float(t.correlation[i, j]), 2)


def corner_names(t: Uncertainty) -> list[str]:
    """Return the least certain parameters, in the order of all."""
    widest = np.sort(np.argsort(-t.std)[:CORNER_PARAMETERS])
    return [t.names[i] for i in widest]


def corner(results: StudyResults, theorem1: Uncertainty, posterior: Posterior) -> Figure:
    """Return the corner plot of the least certain parameters, in per cent of the estimate."""
    names = corner_names(theorem1)
    i = [theorem1.names.index(name) for name in names]
    draws = posterior.draws
    estimate = np.log(results.fits.result.parameters.values)
    shown = 100 * (draws[:: max(len(draws) // CORNER_DRAWS, 1)] - estimate)[:, i]
    truth = 100 * (np.log(results.truth) - estimate)[i]
    covariance = 1e4 * theorem1.covariance[np.ix_(i, i)]
    drawing = corner_figure.corner_plot(names, shown, covariance, truth)
    return figure("corner", drawing, f"Corner plot of the posterior of {text.listed(names)}")


def traces(results: StudyResults, theorem1: Uncertainty, posterior: Posterior) -> Figure:
    """Return traces and ranks of the least certain parameters."""
    names = corner_names(theorem1)
    i = [theorem1.names.index(name) for name in names]
    chains = 100 * (posterior.chains - np.log(results.fits.result.parameters.values))[..., i]
    alt = f"Means of each ensemble along the chain, and ranks of its draws, of {text.listed(names)}"
    return figure("traces", posterior_figures.traces(names, chains), alt)


def profiles(results: StudyResults, theorem1: Uncertainty) -> Figure | None:
    """Return profile likelihoods beside Theorem 1's parabolas; None where there are no profiles."""
    curves = [one for one in results.uncertainty.profiles if one.curve.size]
    if not curves:
        return None
    i = [theorem1.names.index(one.name) for one in curves]
    estimate = results.fits.result.parameters.values[i]
    drawing = profile_figures.profiles(curves, estimate, theorem1.std[i])
    alt = f"Profile likelihoods of {text.listed([one.name for one in curves])}"
    return figure("profiles", drawing, alt)


def convergence_table(p: Posterior) -> Table:
    """Return how well emcee knows each parameter."""
    rows = [
        (
            name,
            number_cell(float(r_hat), text.fixed, 3),
            Number(text.count(round(float(ess))) if np.isfinite(ess) else "–", float(ess)),
            Number(text.significant(float(tau), 3), float(tau)),
        )
        for name, r_hat, ess, tau in zip(
            p.names, p.r_hat, p.ess, p.autocorrelation_time, strict=True
        )
    ]
    columns = [Column("parameter", code=True), *numbers("R-hat", "ESS", "τ [steps]")]
    caption = "R-hat over independent ensembles, effective sample size, autocorrelation time."
    return table("convergence", caption, columns, rows)
