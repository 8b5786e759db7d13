"""Simulated studies of known truth, and how often what is stated about them is true.

A cell is one kind of study: a system, how often its FRF is measured, noise, weights and residual.
Each of its runs simulates the FRFs of all blocks, takes one Gauss-Newton step from the truth and
asks the rule for intervals and a verdict. `estimators.fit` evaluates named weights of log residuals
once more at the model's FRF, so that "lls" and "reweighted lls" are one path, the one taken here.
"""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from trust_systems import NOISE, OUTLIER, WRONG, Linearisation, linearisation, system

import estimators
from estimators.fitting.least_squares import Fit
from estimators.fitting.linearise import linearise
from estimators.fitting.residuals import find_residual
from estimators.fitting.weight_choice import evaluate_weights
from estimators.frf.averaging import contrasts, covariance_of
from estimators.frf.frf_estimate import FrfEstimate, vec
from estimators.frf.repeated_visits import merge_visits
from estimators.trust.directed_tests import DirectedTests
from estimators.trust.intervals import VERDICTS, Verdict
from estimators.trust.line_correlation import white_errors
from estimators.trust.line_scatter import Scatter, line_scatter
from estimators.trust.linearised_fit import LinearisedFit
from estimators.trust.rule import LEVEL, Evidence, gather_evidence, judge, variance_scale

BINS = 2
"""Lines without signal beside each line that tell of the noise."""

ROW_CORRELATION = 0.7
"""Correlation of the errors of one input's outputs where covariances are full."""


@dataclass(frozen=True)
class Cell:
    """One kind of study.

    Attributes
    ----------
    system : str
        As in `trust_systems.system`.
    blocks : int
        Of each visit; 0 where the noise is declared.
    visits : tuple of int
        Of each position.
    covariance : {"total", "noise"}
    residual : {"nls", "lls"}
    weights : {"optimal", "user", "combined"}
    full : bool
        Whether covariances couple elements, whose errors then are correlated.
    correlation : float
        Of the errors of neighbouring lines, of a first-order autoregressive process.
    factor : float
        By which errors are larger than declared.
    wrong : str
        A name of `trust_systems.WRONG`, or "outliers", or none.
    rule : {"recommended", "former"}
        "former": weights and Theorem 1 from each line's own variance, normal quantile, chi-square.
    complete : bool
        Whether fits are run to convergence.
    """

    system: str
    blocks: int
    visits: tuple[int, ...] = (1, 1)
    covariance: str = "total"
    residual: str = "nls"
    weights: str = "optimal"
    full: bool = False
    correlation: float = 0.0
    factor: float = 1.0
    wrong: str = ""
    rule: str = "recommended"
    complete: bool = False

    @property
    def name(self) -> str:
        parts = [
            self.system,
            f"B = {self.blocks}" if self.blocks else "declared",
            *(["visits merged"] if max(self.visits) > 1 else []),
            *(["noise covariance"] if self.covariance == "noise" else []),
            self.residual,
            self.weights,
            *(["full"] if self.full else []),
            *([f"AR {self.correlation:g}"] if self.correlation else []),
            *([f"noise {self.factor:g} x"] if self.factor != 1 else []),
            *([self.wrong] if self.wrong else []),
            *(["former rule"] if self.rule == "former" else []),
            *(["complete fit"] if self.complete else []),
        ]
        return ", ".join(parts)


SYSTEMS = ("moberg", "manutec", "chain")
BLOCKS = (2, 3, 4, 6, 20)
MERGED = (2, 1)
"""Visits of the positions of merged studies; a system with one position has two."""


def right_models() -> Iterator[Cell]:
    """Yield the cells of right models and white noise."""
    for name in SYSTEMS:
        for full in (False, True) if name != "moberg" else (False,):
            for residual in ("nls", "lls"):
                for weights in ("optimal", "user", "combined"):
                    yield Cell(name, 0, residual=residual, weights=weights, full=full)
                    for B in BLOCKS:
                        for visits in ((1, 1), MERGED):
                            for covariance in ("total", "noise"):
                                yield Cell(name, B, visits, covariance, residual, weights, full)


def correlated_noise() -> Iterator[Cell]:
    """Yield the cells of right models and noise correlated along the lines."""
    for name in SYSTEMS:
        for rho in (0.6, 0.9):
            for B in (0, *BLOCKS):
                yield Cell(name, B, correlation=rho)
            for B in (0, 4):
                yield Cell(name, B, correlation=rho, residual="lls")
                yield Cell(name, B, correlation=rho, weights="user")
                if name != "moberg":
                    yield Cell(name, B, correlation=rho, full=True)
            yield Cell(name, 3, MERGED, correlation=rho)
            yield Cell(name, 4, covariance="noise", correlation=rho)


def understated_noise() -> Iterator[Cell]:
    """Yield the cells of right models and noise that is larger than stated."""
    for name in SYSTEMS:
        for factor in (1.5, 3.0):
            for residual in ("nls", "lls"):
                for weights in ("optimal", "user", "combined"):
                    yield Cell(name, 0, residual=residual, weights=weights, factor=factor)


def wrong_models() -> Iterator[Cell]:
    """Yield the cells of wrong models and outliers."""
    errors = {
        "moberg": ("delay .1 ms", "delay .5 ms", "gear ratio +1 %", "Coulomb friction"),
        "manutec": (
            "delay .1 ms",
            "delay .5 ms",
            "payload +5 %",
            "gear ratio +1 %",
            "hardening",
            "Coulomb friction",
            "missing spring, soft",
            "missing spring, medium",
            "missing spring, stiff",
        ),
        "chain": (
            "delay .1 ms",
            "delay .5 ms",
            "missing masses, soft",
            "missing masses, medium",
            "missing masses, stiff",
        ),
    }
    for name in SYSTEMS:
        for wrong in (*errors[name], "outliers"):
            for B in (0, 2, 3, 4, 20):
                yield Cell(name, B, wrong=wrong)
            yield Cell(name, 4, residual="lls", wrong=wrong)
            yield Cell(name, 4, weights="user", wrong=wrong)
            if wrong.startswith("delay"):
                yield Cell(name, 0, wrong=wrong, correlation=0.6)


def negative_controls() -> Iterator[Cell]:
    """Yield the cells of the rule that was in use before, each of which must fail."""
    for name in SYSTEMS:
        for B in (3, 4, 6):
            yield Cell(name, B, rule="former")


def complete_fits() -> Iterator[Cell]:
    """Yield the twelve cells of fits that are run to convergence."""
    for name, B, residual, weights, wrong, rho in (
        ("moberg", 2, "nls", "optimal", "", 0.0),
        ("moberg", 4, "lls", "optimal", "", 0.0),
        ("moberg", 6, "lls", "user", "", 0.0),
        ("moberg", 4, "nls", "combined", "delay .1 ms", 0.0),
        ("moberg", 20, "nls", "optimal", "", 0.6),
        ("chain", 2, "nls", "optimal", "", 0.0),
        ("chain", 3, "lls", "optimal", "", 0.0),
        ("chain", 4, "nls", "combined", "", 0.0),
        ("chain", 0, "nls", "optimal", "", 0.6),
        ("manutec6", 2, "nls", "optimal", "", 0.0),
        ("manutec6", 4, "lls", "user", "", 0.0),
        ("manutec6", 4, "nls", "optimal", "payload +5 %", 0.0),
    ):
        yield Cell(
            name, B, residual=residual, weights=weights, wrong=wrong, correlation=rho, complete=True
        )


GROUPS = {
    "right model": right_models,
    "correlated noise": correlated_noise,
    "understated noise": understated_noise,
    "wrong model": wrong_models,
    "negative control": negative_controls,
    "complete fit": complete_fits,
}
"""All cells, listed before any result is known."""


def simulate(cell: Cell, at: Linearisation, rng: np.random.Generator) -> FrfEstimate:
    """Return the FRFs of one simulated study, estimated as `estimators.estimate_frf` does."""
    plant = system(cell.system)
    truth = at.truth
    Q, m, n = len(truth), *truth.shape[2:]
    visits = cell.visits[:Q]
    index = np.repeat(np.arange(Q), visits)
    variance = NOISE.variance(truth)[index]
    positions = plant.positions[index]
    ones = np.ones(len(index), dtype=int)
    if not cell.blocks:
        error = cell.factor * _errors(cell, rng, variance, 1)[:, 0]
        covariance = _covariance(cell, variance)
        response = truth[index] + error
        if cell.wrong == "outliers":
            response = _with_outliers(response, variance, rng)
        return merge_visits(FrfEstimate(positions, plant.omega, response, covariance, ones))
    B = cell.blocks
    if cell.covariance == "total":
        blocks = np.sqrt(B) * _errors(cell, rng, variance, B)
        error = blocks.mean(axis=1)
        draws = np.einsum("rb,vb...->vr...", contrasts(B), blocks) / np.sqrt(B * (B - 1))
        freedom = B - 1.0
    else:
        error = _errors(cell, rng, variance, 1)[:, 0]
        freedom = float(BINS * B)
        draws = _errors(cell, rng, variance, BINS * B) / np.sqrt(freedom)
    response = truth[index] + error
    if cell.wrong == "outliers":
        response = _with_outliers(response, variance, rng)
    if cell.full and m * n > 1:
        covariance = np.stack([covariance_of(np.moveaxis(one, 0, 1)) for one in draws])
    else:
        covariance = (np.abs(draws) ** 2).sum(axis=1)
    return merge_visits(
        FrfEstimate(
            positions, plant.omega, response, covariance, ones, np.full(len(index), freedom), draws
        )
    )


def _errors(cell: Cell, rng: np.random.Generator, variance: np.ndarray, count: int) -> np.ndarray:
    """Return independent errors (V, count, F, m, n) of FRFs with `variance` (V, F, m, n)."""
    V, F, m, n = variance.shape
    parts = rng.standard_normal((2, V, count, F, m, n)) / np.sqrt(2)
    white = parts[0] + 1j * parts[1]
    if cell.full:
        white = np.einsum("ij,...jn->...in", np.linalg.cholesky(_outputs(m)), white)
    if cell.correlation:
        fresh = np.sqrt(1 - cell.correlation**2)
        for f in range(1, F):
            white[:, :, f] = cell.correlation * white[:, :, f - 1] + fresh * white[:, :, f]
    return np.sqrt(variance)[:, None] * white


def _outputs(m: int) -> np.ndarray:
    return ROW_CORRELATION + (1 - ROW_CORRELATION) * np.eye(m)


def _covariance(cell: Cell, variance: np.ndarray) -> np.ndarray:
    m, n = variance.shape[-2:]
    if not cell.full or m * n == 1:
        return variance
    root = vec(np.sqrt(variance))
    return root[..., :, None] * np.kron(np.eye(n), _outputs(m)) * root[..., None, :]


def _with_outliers(
    response: np.ndarray, variance: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Return FRFs of which one line in twenty is off by ten standard deviations in one element."""
    V, F, m, n = response.shape
    result = response.copy()
    for q in range(V):
        for f in rng.choice(F, size=max(1, F // 20), replace=False):
            i, j = rng.integers(m), rng.integers(n)
            phase = np.exp(2j * np.pi * rng.random())
            result[q, f, i, j] += OUTLIER * np.sqrt(variance[q, f, i, j]) * phase
    return result


def one_step(
    cell: Cell, at: Linearisation, estimate: FrfEstimate
) -> tuple[LinearisedFit, np.ndarray]:
    """Return the fit after one Gauss-Newton step, and the step in ln theta."""
    kind = find_residual(cell.residual)
    weights = evaluate_weights(cell.weights, estimate, kind, at.response)
    model = system(cell.system).model
    values = model.parameters.values * np.exp(at.shift)
    fit = Fit(
        model=model, estimate=estimate, residual=cell.residual, weights=weights,
        parameters=replace(model.parameters, values=values), cost=0.0, start=values,
        bounds=np.stack([values / 1e3, values * 1e3]), status=1, message="", evaluations=1,
        weighting=cell.weights,
    )  # fmt: skip
    linear = linearise(fit.problem, (at.response, at.jacobian))
    step = linear.estimates(linear.rows, linear.residuals)
    return replace(linear, residuals=linear.residuals - linear.jacobian @ step), step


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one study states, and what is true.

    Attributes
    ----------
    verdict : str
        Of the study.
    verdicts : tuple of str
        Of the parameters.
    reason : str
    error : (p,)
        Estimate less truth, of ln theta.
    std, quantile, dof : (p,)
    shift : (p,)
        By how many standard deviations an undetected error of any tested direction may move
        a parameter that it moves most; zero where it is not the one moved most.
    own : (6,)
        Of the error's own direction: estimate, standard deviation, degrees of freedom, number of
        tests, probability, and the shift stated.
    """

    verdict: str
    verdicts: tuple[str, ...]
    reason: str
    error: np.ndarray
    std: np.ndarray
    quantile: np.ndarray
    dof: np.ndarray
    shift: np.ndarray
    own: np.ndarray


def study(cell: Cell, at: Linearisation, rng: np.random.Generator) -> Outcome:
    """Simulate one study and return what the rule states of it."""
    estimate = simulate(cell, at, rng)
    if cell.complete:
        return _complete(cell, estimate)
    fit, step = one_step(cell, at, estimate)
    if cell.rule == "former":
        return _former(cell, at, estimate, step)
    evidence = gather_evidence(fit, at.directions)
    return _outcome(cell, evidence, at.shift + step)


def _outcome(cell: Cell, evidence: Evidence, error: np.ndarray) -> Outcome:
    scatter = evidence.scatter.scaled(variance_scale(evidence))
    return _stated(cell, judge(evidence), scatter, evidence.tests, error)


def _complete(cell: Cell, estimate: FrfEstimate) -> Outcome:
    """Fit from the truth, to convergence."""
    model = system(cell.system).model
    fit = estimators.fit(model, estimate, cell.residual, cell.weights)
    error = np.log(fit.parameters.values / model.parameters.values)
    trust = fit.trust
    verdicts = tuple(interval.verdict for interval in trust.intervals)
    return _stated(cell, verdicts, trust.scatter, trust.tests, error)


def _stated(
    cell: Cell,
    verdicts: tuple[Verdict, ...],
    scatter: Scatter,
    tests: DirectedTests,
    error: np.ndarray,
) -> Outcome:
    gravest = min(verdicts, key=VERDICTS.index)
    shift = np.zeros(len(error))
    np.maximum.at(shift, tests.moved, tests.shift)
    own = np.full(6, np.nan)
    direction = WRONG[cell.wrong].direction if cell.wrong in WRONG else ""
    if direction in tests.names:
        j = tests.names.index(direction)
        own = np.array(
            [
                tests.estimates[j],
                tests.std[j],
                tests.degrees_of_freedom[j],
                len(tests.names),
                tests.probabilities[j],
                tests.shift[j],
            ]
        )
    return Outcome(
        str(gravest), tuple(str(v) for v in verdicts), gravest.reason, error,
        np.sqrt(scatter.variance), scatter.quantile(0.95), scatter.degrees_of_freedom, shift, own,
    )  # fmt: skip


def _former(cell: Cell, at: Linearisation, estimate: FrfEstimate, step: np.ndarray) -> Outcome:
    """Return what Theorem 1 and a chi-square state with each line's own variance."""
    from scipy.stats import chi2

    declared = replace(estimate, degrees_of_freedom=np.inf, deviations=None)
    fit, step = one_step(cell, at, declared)
    std = np.sqrt(line_scatter(fit, fit.rows, white_errors(len(estimate.omega))).variance)
    data = fit.data - len(step)
    large = chi2.sf(2 * fit.squares, data) < LEVEL
    verdict = "noise understated" if large else "trustworthy"
    p = len(step)
    return Outcome(
        verdict, (verdict,) * p, "", at.shift + step, std, np.full(p, 1.959964),
        np.full(p, np.inf), np.zeros(p), np.full(6, np.nan),
    )  # fmt: skip


def known_noise_std(cell: Cell, at: Linearisation) -> np.ndarray:
    """Return the standard deviations of ln theta with these weights and known white noise."""
    quiet = np.random.default_rng(0)
    estimate = simulate(replace(cell, blocks=0, factor=1.0, wrong=""), at, quiet)
    fit, _ = one_step(cell, at, estimate)
    return np.sqrt(line_scatter(fit, fit.rows, white_errors(len(estimate.omega))).variance)


def seed(cell: Cell, run: int) -> list[int]:
    """Return the seed of a run: other cells may come and go beside it."""
    return [zlib.crc32(cell.name.encode()), run]


def runs(cell: Cell, first: int, count: int) -> list[Outcome]:
    """Return the outcomes of runs `first` to `first + count - 1`."""
    at = linearisation_of(cell)
    return [
        study(cell, at, np.random.default_rng(seed(cell, i))) for i in range(first, first + count)
    ]


def linearisation_of(cell: Cell) -> Linearisation:
    return linearisation(cell.system, cell.residual, cell.wrong if cell.wrong in WRONG else "")
