"""Solve a design over a growing set of candidates until none of the others could help."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from oed.design.certificate import Certificate, bounded
from oed.design.design import Design
from oed.design.interior_point import Newton
from oed.design.multiplicative import NAME, multiplicative
from oed.design.problem import DesignProblem, DesignSolver, ScaledProblem, SolverAnswer
from oed.design.solvers import checked_answer
from oed.design.trimming import trimmed
from oed.design.whitening import Whitening, largest
from robotmodels.common.arrays import Array, IntArray, read_only
from robotmodels.common.errors import InvalidInput, SolverFailed

# Rounds of multiplicative steps that look for the candidates to begin with.
_SCOUTING = 8
# Accuracy of each of these steps' answers.
_SCOUTED = 0.03
# Of the tolerance: gaps that end the search, and excess that brings a candidate in.
_CLOSED, _EXCESS = 0.5, 0.25
_FEASIBLE = 0.3  # by which limits may be violated, of the tolerance
# Of the condition: rounding in white matrices.
_ROUNDING = 1e-15
# For the few candidates at the end: the goal, of the tolerance, and multiplicative steps.
_PRECISE, _STEPS = 1e-3, 1000


@dataclass(frozen=True, eq=False)
class _Round:
    """One active set's answer, its weights complete, with log value and certificate."""

    active: IntArray
    few: ScaledProblem
    answer: SolverAnswer
    value: float
    certificate: Certificate


def solve(
    problem: DesignProblem,
    tolerance: float,
    max_rounds: int,
    solvers: Sequence[DesignSolver],
    trim: bool = True,
) -> Design:
    """Return the design of the smallest gap; the caller decides whether the gap will do.

    Parameters
    ----------
    problem : DesignProblem
        What is maximised.
    tolerance : float
        Gap that ends the search.
    max_rounds : int
        Largest number of active sets.
    solvers : sequence of DesignSolver
        Solvers of the active sets, each where those before it stall.
    trim : bool
        Whether small weights that are not needed are set to zero.

    Raises
    ------
    InvalidInput
        If `max_rounds` is not positive.
    NotIdentifiable
        Naming the parameters that all candidates together leave open.
    SolverFailed
        If no method gives an answer.
    """
    if max_rounds < 1:
        raise InvalidInput(f"max_rounds: {max_rounds!r}; at least 1 is needed")
    search = _Search(Whitening.of(problem), tolerance, max_rounds)
    search.scout()
    stalled: _Round | None = None
    for solver in solvers:
        search.run(Newton(first_goal=0.0) if stalled and isinstance(solver, Newton) else solver)
        answer = search.answer(trim)
        if answer is not None:
            return search.design(answer)
        stalled = min(filter(None, (search.best, stalled)), key=_gap, default=None)
        search.best = None
    if stalled is None:
        raise SolverFailed(f"optimal design: {'; '.join(search.failures)}")
    return search.design(stalled)


class _Search:
    """The growing active set, and the best answer so far."""

    def __init__(self, whitening: Whitening, tolerance: float, max_rounds: int) -> None:
        self.whitening, self.tolerance, self.max_rounds = whitening, tolerance, max_rounds
        self.active = whitening.first_active()
        self.best: _Round | None = None
        self.gaps: list[float] = []
        self.scouted = ""
        self.methods: list[str] = []
        self.failures: list[str] = []

    @property
    def _multiplicative(self) -> bool:
        """Whether there are multiplicative steps: for one smooth group, and a budget alone."""
        objective, allowed = self.whitening.objective, self.whitening.problem.allowed
        limited = len(allowed.rows) > 1 or bool(np.isfinite(allowed.upper).any())
        return objective.smooth and len(objective.groups) == 1 and not limited

    @property
    def closed(self) -> bool:
        """Whether the best answer is good enough."""
        return self.best is not None and self.best.certificate.gap <= _CLOSED * self.tolerance

    def scout(self) -> None:
        """Begin with the candidates that a few multiplicative steps find to matter."""
        if not self._multiplicative:
            return
        self.scouted = f" after {NAME}"
        for _ in range(_SCOUTING):
            few = self.whitening.few(self.active)
            scouted = self._round(few, multiplicative(few, _SCOUTED))
            larger = self._larger(scouted, _SCOUTED)
            if larger is None:
                break
            self.active = larger
        p = len(self.whitening.problem.candidates.names)
        most = scouted.active[largest(scouted.answer.weights, 2 * p)]
        others = largest(self._excess(scouted, most), 4 * p)
        fewer = self.whitening.distinct(np.concatenate([most, others]), len(most) + p)
        if self.whitening.determined(fewer):
            self.active = fewer

    def run(self, solver: DesignSolver) -> None:
        """Solve and grow the active set until no candidate could help.

        From the solver's first goal on, goals fall to the tolerance.
        """
        goal, near = max(solver.first_goal, self.tolerance), None
        for _ in range(self.max_rounds):
            self.gaps.append(np.inf)
            few = self.whitening.few(self.active)
            try:
                current = self._round(few, checked_answer(solver.solve(few, goal, near), few))
            except SolverFailed as error:
                self.failures.append(str(error))
                return
            self._record(current)
            if self.closed:
                return
            larger = self._larger(current, _EXCESS * goal)
            if larger is not None:
                self.active = larger
            elif goal <= self.tolerance:
                return
            goal = max(solver.first_goal * goal if larger is not None else 0.0, self.tolerance)
            near = current.answer if larger is None else None

    def _record(self, current: _Round) -> None:
        """Record a round's gap and method, and its answer if it is the best so far."""
        self.gaps[-1], method = current.certificate.gap, current.answer.method
        if not any(name.startswith(method) for name in self.methods):
            self.methods.append(method + ("" if self.methods else self.scouted))
        if self.best is None or current.certificate.gap < self.best.certificate.gap:
            self.best = current

    def design(self, best: _Round) -> Design:
        """Return an answer as a design."""
        whitening, problem, allowed = (w := self.whitening), w.problem, w.problem.allowed
        weights = whitening.weights(best.active, best.answer.weights)
        information = problem.information(weights)
        rows = best.answer.row_multipliers / whitening.row_scales(best.active)
        value = best.value + whitening.constant
        return Design(
            weights=read_only(weights),
            value=problem.objective.usual_form(value, len(problem.candidates.names)),
            gap=best.certificate.gap,
            support=read_only(np.flatnonzero(weights)),
            information=read_only(information),
            criterion=problem.objective.name,
            names=problem.candidates.names,
            gaps=read_only(np.array(self.gaps)),
            solver=", ".join(self.methods),
            witness=whitening.coordinates.witness(whitening.objective, best.answer.witness),
            sensitivity=read_only(best.certificate.sensitivity),
            multipliers=dict(zip(allowed.names, map(float, rows), strict=True)),
        )

    def _round(self, few: ScaledProblem, answer: SolverAnswer) -> _Round:
        """Complete an answer's weights and certify them over all candidates."""
        # Conic solvers leave weights of no sign; regular information needs every one of them.
        least = 0.01 * self.tolerance / len(self.active)
        weights = few.completed(np.maximum(answer.weights, least))
        information = few.information(weights)
        value = few.objective.log_value(information)
        witnesses = [answer.witness]
        if few.objective.smooth and len(few.objective.groups) == 1:
            derivative = few.objective.witness(information)
            witnesses = [derivative] if answer.mu else [*witnesses, derivative]
        rounds = []
        for witness in witnesses:
            changed = replace(answer, weights=weights, witness=witness)
            certificate = self._certified(changed, value)
            rounds.append(_Round(self.active, few, changed, value, certificate))
            if certificate.gap <= _CLOSED * self.tolerance:
                break
        best, over = min(rounds, key=_gap), few.violation(weights)
        if over <= _FEASIBLE * self.tolerance:
            return best
        # A value beyond the limits is no gap: rough answers are no end.
        gap = max(best.certificate.gap, over / _FEASIBLE)
        return replace(best, certificate=replace(best.certificate, gap=gap))

    def _certified(self, answer: SolverAnswer, value: float) -> Certificate:
        if not np.isfinite([value, *(np.abs(W).max() for W in answer.witness)]).all():
            nothing = np.full(len(self.whitening.units), np.inf)
            return Certificate(np.inf, np.inf, nothing)
        rows = answer.row_multipliers / self.whitening.row_scales(self.active)
        certificate = bounded(self.whitening, value, answer.witness, rows)
        if certificate.gap > _CLOSED * self.tolerance and len(rows) > 1:
            # The solver's multipliers of the rows may be the only thing that lacks precision.
            other = bounded(self.whitening, value, answer.witness, None)
            certificate = min(certificate, other, key=lambda one: one.gap)
        return certificate

    def _larger(self, current: _Round, least: float) -> IntArray | None:
        """Return the active set with the candidates of the largest excess, None if all is small."""
        whitening, active = self.whitening, current.active
        excess = self._excess(current, active)
        worst = largest(excess, 2 * whitening.batch)
        worst = worst[excess[worst] > least]
        if not len(worst):
            return None
        both = np.concatenate([active, worst])
        return whitening.distinct(both, len(active) + whitening.batch)

    def _excess(self, current: _Round, active: IntArray) -> Array:
        """Return each derivative less its cost by the multipliers, (Q,); -inf if active."""
        whitening = self.whitening
        rows = current.answer.row_multipliers / whitening.row_scales(current.active)
        cost = rows @ whitening.problem.allowed.rows
        excess = (current.certificate.sensitivity - cost) * whitening.units
        excess[active] = -np.inf
        excess[whitening.closed] = -np.inf
        return np.asarray(excess)

    def answer(self, trim: bool) -> _Round | None:
        """Return the best answer without small weights that are not needed, or None if it is poor.

        Weights of a smooth objective must be certified by their derivative, which anybody can
        compute from them. Where they leave the information singular there are many, and the
        witness of all weights certifies them.
        """
        if self.best is None or not self.closed:
            return None
        current, singular = self.best, False
        certified = not _unique(current) or current.answer.mu > 0
        while trim and not singular:
            fewer, singular = self._fewer(current, polish=current is self.best)
            if fewer is None:
                break
            current, certified = fewer, True
        return current if certified else self._precise(current, current.answer.weights)

    def _fewer(self, full: _Round, polish: bool) -> tuple[_Round | None, bool]:
        """Return an answer with fewer weights, if one is as good, and whether it is singular.

        Weights of conic solvers are made more precise only where none are precise enough as they
        are, and where that is asked for.
        """
        rounding = _ROUNDING * self.whitening.coordinates.condition
        few, loss = full.few, 0.1 * self.tolerance
        choices = trimmed(few, full.answer, full.value, loss, rounding)
        newton = full.answer.mu > 0
        for polished in (True,) if newton else (False, True) if polish else (False,):
            for weights, value, singular in choices:
                if singular or not _unique(full):
                    return self._bounded_by_all(full, weights, value), singular
                precise = (self._precise if polished else self._derived)(full, weights)
                if precise is not None:
                    return precise, False
        return None, False

    def _bounded_by_all(self, full: _Round, weights: Array, value: float) -> _Round:
        """Return an answer of fewer weights, certified by the witness of all."""
        gap = float(np.expm1(full.certificate.log_bound - self.whitening.constant - value))
        answer = replace(full.answer, weights=weights)
        certificate = replace(full.certificate, gap=gap)
        return replace(full, answer=answer, value=value, certificate=certificate)

    def _precise(self, full: _Round, weights: Array) -> _Round | None:
        """Return an answer of the used candidates that its derivative certifies, if there is one.

        They are solved for alone, more precisely: by the barrier method after itself, by
        multiplicative steps after any other.
        """
        used, newton = np.flatnonzero(weights), full.answer.mu > 0
        few = self.whitening.few(full.active[used])
        better = None
        if newton:
            better = self._derived(
                full,
                _spread(
                    used,
                    weights,
                    _finely(
                        few, replace(full.answer, weights=weights[used], mu=0.0), self.tolerance
                    ),
                ),
            )
        better = better or self._derived(full, weights)
        if better is None and not newton and self._multiplicative:
            answer = multiplicative(few, 0.1 * self.tolerance, weights[used], _STEPS)
            better = self._derived(full, _spread(used, weights, answer.weights))
            if better is not None and NAME not in self.methods:
                self.methods.append(NAME)
        return better

    def _derived(self, full: _Round, weights: Array) -> _Round | None:
        """Return an answer certified by the derivative at its weights, if that is good enough."""
        few, information = full.few, full.few.information(weights)
        answer = replace(full.answer, weights=weights, witness=few.objective.witness(information))
        value = few.objective.log_value(information)
        certificate = self._certified(answer, value)
        if certificate.gap > _CLOSED * self.tolerance:
            return None
        return replace(full, answer=answer, value=value, certificate=certificate)


def _gap(one: _Round) -> float:
    return one.certificate.gap


def _unique(one: _Round) -> bool:
    """Return whether regular information has a unique derivative."""
    return one.few.objective.smooth and len(one.few.objective.groups) == 1


def _finely(few: ScaledProblem, near: SolverAnswer, tolerance: float) -> Array | None:
    """Return precise weights of a few candidates, if the barrier method finds them."""
    try:
        return few.completed(Newton().solve(few, _PRECISE * tolerance, near).weights)
    except SolverFailed:
        return None


def _spread(used: IntArray, weights: Array, precise: Array | None) -> Array:
    """Return weights (n,) with those of the used candidates replaced by `precise` ones, if any."""
    spread = weights.copy()
    if precise is not None:
        spread[used] = precise
    return spread
