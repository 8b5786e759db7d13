"""Random and degenerate designs, each judged in 60 digits by textbook formulas.

`check_design(seed)` draws a problem, designs for it and returns an `Outcome`. The judge sees the
raw matrices and the weights; for E, and where the information that is left is singular, also the
dual point. Nothing of it is the package's own arithmetic.
"""

import time
from dataclasses import dataclass, field

import numpy as np
from flint import acb_mat, arb, arb_mat, ctx
from scipy.optimize import linprog

import oed
from oed.criteria.criteria import objective_of
from oed.design.active_set import solve
from oed.design.optimal_design import allowed_weights
from oed.design.problem import DesignProblem
from robotmodels import IdentificationError, NotIdentifiable

TOLERANCE = 1e-6
# Weights are mixed with so much of equal ones before a singular design's value is taken.
_MIXED = 1e-7
_LARGE = 12  # parameters
_FAMILIES = ("random", "low rank", "polynomial", "factorial", "equal", "nearly equal", "blocks")


@dataclass(frozen=True, eq=False)
class Draw:
    """A problem: matrices (Q, p, p), criterion and the options of `optimal_design`."""

    seed: int
    family: str
    matrices: np.ndarray
    criterion: object
    parts: list  # of (share, kind, combinations (p, m))
    options: dict
    rules: str = "shares"

    @property
    def label(self):
        Q, p = self.matrices.shape[:2]
        name = getattr(self.criterion, "name", self.criterion)
        options = self.options
        return (
            f"{self.seed}: {self.family}, p {p}, Q {Q}, {name}, {options['solver']} "
            f"{options['form']}, {self.rules}{', prior' if 'prior' in options else ''}"
        )


@dataclass(frozen=True)
class Outcome:
    """What became of a draw; `failure` is empty where all is well."""

    label: str
    failure: str = ""
    gap: float = np.nan
    claimed: float = np.nan
    solver: str = ""
    refused: bool = False
    singular: bool = False
    seconds: float = field(default=0.0, compare=False)


def check_design(seed, perturbation=0.0):
    """Draw, design and judge; `perturbation` is relative, of every entry of the matrices."""
    draw = draw_problem(seed)
    if perturbation:
        draw = perturbed(draw, perturbation)
    start = time.process_time()
    info = information(draw.matrices)
    try:
        design = oed.optimal_design(info, draw.criterion, **draw.options)
    except NotIdentifiable as error:
        seconds = time.process_time() - start
        failure = "" if beyond_limits(draw) else f"refused: {error}"
        return Outcome(draw.label, failure, refused=True, seconds=seconds)
    except (IdentificationError, ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        return Outcome(
            draw.label,
            f"{type(error).__name__}: {error}",
            seconds=time.process_time() - start,
        )
    seconds = time.process_time() - start
    failure, gap, singular = judged(draw, design)
    if singular and not failure and design.solver.startswith("newton"):
        # With all its weights the design is regular, and the weights alone say how good it is.
        failure, gap, _ = judged(draw, _all_weights(draw, info))
    return Outcome(draw.label, failure, gap, design.gap, design.solver, False, singular, seconds)


def _all_weights(draw, info):
    prior, constraints = draw.options.get("prior"), draw.options.get("constraints")
    allowed = allowed_weights(constraints, len(info))
    problem = DesignProblem(info, objective_of(draw.criterion, info.names), allowed, prior)
    return solve(problem, TOLERANCE, 50, [oed.Newton()], trim=False)


def information(matrices):
    names = tuple(f"k{i}" for i in range(matrices.shape[-1]))
    return oed.InformationSet(np.arange(len(matrices), dtype=float)[:, None], matrices, names)


def perturbed(draw, size):
    rng = np.random.default_rng(draw.seed)
    noise = 1 + size * rng.standard_normal(draw.matrices.shape)
    matrices = draw.matrices * (noise + np.swapaxes(noise, 1, 2)) / 2
    return Draw(
        draw.seed, draw.family, matrices, draw.criterion, draw.parts, draw.options, draw.rules
    )


def draw_problem(seed):
    """Return the problem of a seed."""
    rng = np.random.default_rng(seed)
    family = _FAMILIES[seed % len(_FAMILIES)]
    J, at = _regressors(rng, family)
    Q, p = J.shape[:2]
    scale = np.ones(p)
    if rng.random() < 0.5:
        scale = np.exp(rng.uniform(-15, 15, p))
    overall = 10.0 ** rng.uniform(-30, 30) if rng.random() < 0.5 else 1.0
    J = J * scale[:, None] * overall
    matrices = J @ np.swapaxes(J, 1, 2)
    kind = rng.choice(["D", "A", "E", "c", "D_s", "A_s", "I", "mixture", "mixture with E"])
    solver, form = [("newton", "primal"), ("cvxpy", "primal"), ("cvxpy", "dual")][rng.integers(3)]
    if p > _LARGE and rng.random() < 0.9:  # cvxpy takes seconds there
        solver, kind = "newton", "D_s" if "E" in kind else kind
    if "E" in kind:
        solver = "cvxpy"
    criterion, parts = _criterion(rng, str(kind), p, at, scale)
    options = {"solver": solver, "form": form}
    rules = "shares"
    if rng.random() < 0.4 and Q > 3:
        options["constraints"], rules = _rules(rng, Q)
    if rng.random() < 0.25:
        G = rng.standard_normal((p, int(rng.integers(1, p + 1)))) * scale[:, None] * overall
        options["prior"] = G @ G.T * 10.0 ** rng.uniform(-3, 1)
    return Draw(seed, family, matrices, criterion, parts, options, rules)


def _regressors(rng, family):
    """Return regressors (Q, p, rank), and those of one more experiment, (p,)."""
    p = int(np.round(np.exp(rng.uniform(0, np.log(30)))))
    if family == "polynomial":
        p = min(p, 7)
        low, high = rng.choice([-1.0, 0.0]), 1.0
        points = np.linspace(low, high, int(rng.integers(p + 1, 202)))
        x = rng.choice([0.0, low, rng.uniform(low, high), high + rng.uniform(0, 1)])
        powers = np.arange(p)
        return (points[:, None] ** powers)[:, :, None], x**powers
    if family == "factorial":
        factors = int(rng.integers(1, 6))
        levels = rng.choice([2, 3])
        axes = np.meshgrid(*[np.linspace(-1, 1, levels)] * factors, indexing="ij")
        points = np.stack(axes, axis=-1).reshape(-1, factors)
        columns = [np.ones(len(points)), *points.T]
        pairs = [points[:, i] * points[:, j] for i in range(factors) for j in range(i)]
        columns += pairs[: int(rng.integers(0, len(pairs) + 1))]
        table = np.stack(columns, axis=1)
        return table[:, :, None], table[int(rng.integers(len(table)))]
    most = max(int(2e5 / p**2), p + 1) if rng.random() < 0.9 else 2000
    Q = int(np.exp(rng.uniform(np.log(p), np.log(min(max(most, p + 1), 2000)))))
    rank = 1 if family == "low rank" else int(rng.integers(1, p + 1))
    Q = max(Q, p // rank + 2)
    lengths = np.exp(0.5 * rng.standard_normal((Q, 1, rank)))
    J = rng.standard_normal((Q, p, rank)) * lengths
    if family == "equal":
        J = J[rng.integers(0, max(Q // 3, -(-p // rank) + 1), Q)]
        J[: -(-p // rank)] = rng.standard_normal((-(-p // rank), p, rank))
    elif family == "nearly equal":
        J = np.concatenate(
            [J, J * (1 + 10.0 ** rng.uniform(-12, -3) * rng.standard_normal(J.shape))]
        )
    elif family == "blocks":
        first = int(rng.integers(0, p))
        J[: Q // 2, first:] = 0.0
    return J, rng.standard_normal(p) if rng.random() < 0.5 else J[int(rng.integers(Q)), :, 0]


def _criterion(rng, kind, p, at, scale):
    """Return a criterion, and its parts as the judge needs them."""
    names = tuple(f"k{i}" for i in range(p))
    some = sorted(rng.choice(p, int(rng.integers(1, p + 1)), replace=False).tolist())
    selector = np.eye(p)[:, some]
    interest = tuple(names[i] for i in some)
    c = at * scale if rng.random() < 0.7 else selector[:, 0]
    c = c if c.any() else np.eye(p)[0]
    simple = {
        "D": ("D", ("D", np.eye(p))),
        "A": ("A", ("A", np.eye(p))),
        "E": ("E", ("E", np.eye(p))),
        "c": (oed.CCriterion(c), ("A", c[:, None])),
        "D_s": (oed.DsCriterion(interest), ("D", selector)),
        "A_s": (oed.AsCriterion(interest), ("A", selector)),
    }
    if kind in simple:
        criterion, part = simple[kind]
        return criterion, [(1.0, *part)]
    if kind == "I":
        g = rng.standard_normal((p, int(rng.integers(1, p + 1)))) * scale[:, None]
        return oed.ICriterion(g @ g.T), [(1.0, "A", g)]
    chosen = ["E" if kind == "mixture with E" else "A", str(rng.choice(["D", "c", "D_s"]))]
    shares = rng.dirichlet(np.ones(2)) * 0.8 + 0.1
    criterion = oed.MixtureCriterion([simple[name][0] for name in chosen], shares.tolist())
    return criterion, [
        (float(share), *simple[name][1]) for share, name in zip(shares, chosen, strict=True)
    ]


def _rules(rng, Q):
    """Return constraints that an interior weight satisfies, with their name."""
    inside = rng.dirichlet(np.ones(Q)) * 10
    kind = str(
        rng.choice(["most", "time", "groups", "linear", "equation", "equations", "mandatory"])
    )
    if kind == "most":
        return oed.Constraints(experiments=10, most=rng.uniform(1.5, 4) * 10 / min(Q, 10)), kind
    durations = rng.uniform(10, 60, Q)
    if kind == "time":
        return oed.Constraints(
            experiments=10, time=float(durations @ inside), durations=durations
        ), kind
    if kind == "groups":
        half = range(Q // 2)
        groups = {"half": oed.Group(half, least=float(inside[: Q // 2].sum()) * 0.9)}
        return oed.Constraints(experiments=10, groups=groups, forbidden=[Q - 1]), kind
    if kind == "mandatory":
        return oed.Constraints(experiments=10, mandatory={0: 1.5}, most=8), kind
    a = rng.standard_normal((2, Q))
    rows = {"a": (a[0], float(a[0] @ inside)), "b": (a[1], float(a[1] @ inside))}
    if kind == "linear":
        return oed.Constraints(experiments=10, linear=rows), kind
    pairs = {}
    for name in list(rows)[: 1 if kind == "equation" else 2]:
        row, bound = rows[name]
        pairs |= {f"{name} most": (row, bound), f"{name} least": (-row, -bound)}
    return oed.Constraints(experiments=10, linear=pairs), kind


# The judge.


def exactly(matrix):
    matrix = np.atleast_2d(matrix)
    return arb_mat(*matrix.shape, matrix.ravel().tolist())


def judged(draw, design):
    """Return a failure or nothing, the true gap, and whether the information is singular."""
    ctx.dps = 100  # scales of 1e60 and e^30 leave 60 of them
    H, w = draw.matrices, design.weights
    Q = len(H)
    constraints = draw.options.get("constraints")
    if not (np.isfinite(w).all() and (w >= 0).all()):
        return "weights that are negative or not finite", np.nan, False
    over = _violation(constraints, w)
    if over > 1e-6:
        return f"constraints violated by {over:.1e}", np.nan, False
    M = _information(draw, w)
    mean = np.abs(np.einsum("qii->qi", H)).mean(axis=0)
    nonsmooth = any(kind == "E" for _, kind, _ in draw.parts)
    singular = _singular(M, mean)
    if not nonsmooth and not singular:
        witness = _derivative(draw, M)
        gap = _most(draw, witness) - 1
    else:
        size = 1.0 if constraints is None else 10.0
        if singular:
            equal = np.full(Q, size / Q)
            M = _information(draw, (1 - _MIXED) * w + _MIXED * equal)
        gap = _gap_by_witness(draw, design, M, mean)
    failure = "" if gap <= TOLERANCE else f"true gap {gap:.2e}, claimed {design.gap:.2e}"
    if gap < -1e-6:
        failure = f"a negative gap {gap:.2e}"
    return failure, gap, singular


def _violation(constraints, w):
    if constraints is None:
        return abs(w.sum() - 1)
    allowed = constraints.polytope(len(w))
    over = (allowed.rows @ w - allowed.bounds) / np.maximum(
        np.abs(allowed.bounds), np.abs(allowed.rows).max(axis=1) * w.sum()
    )
    return max(over.max(), (w - allowed.upper).max(), (allowed.lower - w).max())


def _information(draw, w):
    p = draw.matrices.shape[1]
    used = np.flatnonzero(w)
    total = exactly(w[used]) * exactly(draw.matrices[used].reshape(len(used), -1))
    M = arb_mat(p, p, total.entries())
    return M + exactly(draw.options["prior"]) if "prior" in draw.options else M


def _singular(M, mean):
    """Return whether a pivot of M in units of the mean information is below 1e-12."""
    scales = exactly(np.diag(1 / np.sqrt(mean)))
    pivots = [pivot for pivot, _ in _pivots(scales * M * scales)]
    return min(pivots) < 1e-12 * max(pivots)


def _pivots(A):
    """Return pivots and columns of symmetric elimination, the largest pivot first each time."""
    p = A.nrows()
    rows = [[A[i, j] for j in range(p)] for i in range(p)]
    order, steps = list(range(p)), []
    while order:
        k = max(order, key=lambda i: abs(float(rows[i][i].mid())))
        pivot = rows[k][k].mid()
        if pivot == 0:
            return [*steps, (pivot, [arb(0)] * p)]
        column = [rows[i][k] / pivot if i in order else arb(0) for i in range(p)]
        order.remove(k)
        steps.append((pivot, column))
        for i in order:
            for j in order:
                rows[i][j] = rows[i][j] - column[i] * pivot * column[j]
    return steps


def _semidefinite(A):
    """Return A without its negative pivots, which rounding to double leaves."""
    p, total = A.nrows(), arb_mat(A.nrows(), A.nrows())
    for pivot, column in _pivots(A):
        if pivot > 0:
            v = arb_mat(p, 1, column)
            total = total + v * v.transpose() * pivot
    return total


def _derivative(draw, M):
    """Return the derivative of the log value at M, by textbook formulas."""
    inverse, p = M.inv(), M.nrows()
    total = arb_mat(p, p)
    for share, kind, B in draw.parts:
        Y = inverse * exactly(B)
        C = exactly(B).transpose() * Y
        if kind == "D":
            W = Y * C.inv() * Y.transpose() * (arb(share) / B.shape[1])
        else:
            W = Y * Y.transpose() * (arb(share) / C.trace())
        total = total + W
    return total


def _most(draw, W):
    """Return the largest tr(W M') of all allowed designs, in double once the prices are known."""
    Q, p = draw.matrices.shape[:2]
    weights = arb_mat(p * p, 1, W.entries())
    prices = exactly(draw.matrices.reshape(Q, -1)) * weights
    prices = np.array([float(x.mid()) for x in prices.entries()])
    prior = 0.0
    if "prior" in draw.options:
        prior = float((exactly(draw.options["prior"].reshape(1, -1)) * weights)[0, 0].mid())
    constraints = draw.options.get("constraints")
    if constraints is None:
        return prior + prices.max()
    allowed = constraints.polytope(Q)
    scale = np.abs(allowed.rows).max(axis=1)
    options = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
    best = linprog(
        -prices,
        allowed.rows / scale[:, None],
        allowed.bounds / scale,
        bounds=np.stack([allowed.lower, allowed.upper], axis=1),
        options=options,
    )
    return prior - best.fun


def _gap_by_witness(draw, design, M, mean):
    """Return what the dual point shows the gap of a regular M to be."""
    p = M.nrows()
    log_value, log_polar, total = arb(0), arb(0), arb_mat(p, p)
    scales, inverse_scales = exactly(np.diag(np.sqrt(mean))), exactly(np.diag(1 / np.sqrt(mean)))
    inverse = M.inv()
    for (share, kind, B), W in zip(draw.parts, design.witness, strict=True):
        W = exactly(0.5 * (W + W.T))
        W = inverse_scales * _semidefinite(scales * W * scales) * inverse_scales
        total = total + W
        B, m = exactly(B), B.shape[1]
        C, inner = B.transpose() * inverse * B, B.transpose() * W * B
        if kind == "D":
            log_value -= arb(share) / m * C.det().log()
            polar = m * (inner.det().log() / m).exp()
        elif kind == "E":
            log_value += arb(share) * _eigenvalues(M)[0].log()
            polar = inner.trace()
        elif m == 1:
            log_value -= arb(share) * C[0, 0].log()
            polar = inner[0, 0]
        else:
            log_value -= arb(share) * C.trace().log()
            polar = _trace_of_root(inner) ** 2
        log_polar += arb(share) * (polar / share).log()
    bound = arb(_most(draw, total)).log() - log_polar
    return float((bound - log_value).exp().mid()) - 1


def _scaled_mean(draw):
    mean = draw.matrices.mean(axis=0)
    if "prior" in draw.options:
        mean = mean + draw.options["prior"] / (1 if "constraints" not in draw.options else 10)
    d = np.sqrt(np.diagonal(mean))
    return mean / d[:, None] / d


def _eigenvalues(A):
    """Return the eigenvalues of a symmetric matrix, in rising order."""
    values = [value.real.mid() for value in acb_mat(A).eig(algorithm="approx")]
    return sorted(values, key=float)


def _trace_of_root(A):
    return sum((value.sqrt() for value in _eigenvalues(A) if value > 0), arb(0))


def beyond_limits(draw):
    """Return whether the problem is one that may be refused."""
    mean = _scaled_mean(draw)
    if not np.isfinite(mean).all():
        return True
    eigenvalues = np.linalg.eigvalsh(mean)
    return eigenvalues[0] < 1.2e-10 * eigenvalues[-1]
