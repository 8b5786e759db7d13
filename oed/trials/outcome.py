"""What came of plans that were tried: each beside its promise, and beside the first one."""

from dataclasses import dataclass

import numpy as np

from estimators.uncertainty.covariance import Uncertainty
from estimators.uncertainty.monte_carlo import MonteCarlo
from oed.trials.scatter import clearly_smaller, std_interval
from robotmodels.arrays import Array, BoolArray, IntArray
from robotmodels.notebook import Printed

LEVEL = 0.95


@dataclass(frozen=True, eq=False)
class PlanTrial:
    """A plan, what it promises and what repeated experiments by it gave.

    Attributes
    ----------
    name : str
        Name of the plan.
    support, repetitions : ndarray of int, (k,)
        Candidates it measures in, and experiments in each.
    unidentified : tuple of str
        Parameters that it leaves open; nothing was simulated if there are any.
    information : ndarray or None, (p, p)
        Information at the true values, what the plan promises; None if open.
    promised : Uncertainty or None
        Its covariance ([WM] Theorem 1); None if open.
    found : MonteCarlo or None
        Repeated experiments; None if open.
    """

    name: str
    support: IntArray
    repetitions: IntArray
    unidentified: tuple[str, ...] = ()
    information: Array | None = None
    promised: Uncertainty | None = None
    found: MonteCarlo | None = None

    @property
    def std(self) -> Array:
        """Standard deviations of ln theta over the experiments, (p,); one infinity if open."""
        if self.found is None:
            return np.array([np.inf])
        return self.found.uncertainty().std

    def std_interval(self) -> Array:
        """Return where each true standard deviation lies with 95 %, (p, 2), by chi square."""
        if self.found is None:
            return np.array([[np.inf, np.inf]])
        return std_interval(self.std, len(self.found.estimates), LEVEL)


@dataclass(frozen=True, eq=False)
class PlanComparison(Printed):
    """A plan against its rivals, the plan first.

    Efficiencies say how many experiments of the plan are worth as much as one of a rival, by the
    criterion; the plan's own is one.

    Attributes
    ----------
    criterion : str
        Its name.
    trials : tuple of PlanTrial
        K plans.
    promised : ndarray, (K,)
        Efficiencies by information.
    found : ndarray, (K,)
        Efficiencies by the scatter of repeated experiments; zero where a plan leaves parameters
        open.
    interval : ndarray, (K, 2)
        Where the true ones lie with 95 %, each by itself, of normal estimates.
    held : bool
        Whether fits held the equilibria of the true values.
    """

    criterion: str
    trials: tuple[PlanTrial, ...]
    promised: Array
    found: Array
    interval: Array
    held: bool

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the p parameters."""
        own = self.trials[0].promised
        assert own is not None  # else there would be no comparison
        return own.names

    @property
    def beaten(self) -> tuple[str, ...]:
        """Rivals that the plan beats by more than chance explains."""
        return self._rivals(self.interval[:, 1] < 1)

    @property
    def better(self) -> tuple[str, ...]:
        """Rivals that beat the plan by more than chance explains."""
        return self._rivals(self.interval[:, 0] > 1)

    def more_certain(self, rival: int) -> tuple[int, int, int]:
        """Return how many parameters the plan makes more certain than a rival does.

        The second number counts those where chance does not explain it (F test, 95 %), the third
        those that a rival, by the same measure, makes more certain than the plan.
        """
        own, other = self.trials[0].found, self.trials[rival].found
        assert own is not None
        if other is None:
            return len(self.names), len(self.names), 0
        fewer = own.uncertainty().std < other.uncertainty().std
        clear = clearly_smaller(own, other, LEVEL), clearly_smaller(other, own, LEVEL)
        return int(fewer.sum()), int(clear[0].sum()), int(clear[1].sum())

    def _rivals(self, which: BoolArray) -> tuple[str, ...]:
        pairs = zip(self.trials[1:], which[1:], strict=True)
        return tuple(trial.name for trial, chosen in pairs if chosen)

    def __str__(self) -> str:
        plan = self.trials[0]
        assert plan.found is not None
        rivals = len(self.trials) - 1
        others = f", beaten by {', '.join(self.better) or 'none'}" * (len(self.beaten) < rivals)
        lines = [
            f"{plan.name} beats {len(self.beaten)} of {rivals} rivals by {self.criterion}{others}, "
            f"{len(plan.found.estimates)} simulations each"
        ]
        for k, trial in enumerate(self.trials[1:], start=1):
            low, high = self.interval[k]
            lines.append(
                f"  {trial.name:<12} worth {self.found[k]:.2f} ({low:.2f} to {high:.2f}), "
                f"promised {self.promised[k]:.2f}"
                if not trial.unidentified
                else f"  {trial.name:<12} leaves open {', '.join(trial.unidentified)}"
            )
        return "\n".join(lines)
