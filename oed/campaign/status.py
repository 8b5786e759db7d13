"""Progress of a campaign: estimates, accuracy, minutes."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from oed.campaign.estimate import Estimate, fitted_visits
from oed.campaign.history import History
from oed.campaign.outlook import Outlook
from oed.campaign.visits import Visit
from robotmodels.common.arrays import Array

State = Literal["begun", "identifying", "out of reach", "reached", "in doubt", "minutes used"]


@dataclass(frozen=True, eq=False)
class CampaignStatus:
    """Progress of a campaign: estimates, accuracy, minutes.

    Attributes
    ----------
    names : tuple of str
        The p parameters.
    targets : ndarray, (p,)
        Relative standard deviations asked for; infinite where none is.
    estimate : Estimate or None
        What all records say; None before the first fit.
    outlook : Outlook or None
        What the minutes left can bring; None where that is not known yet, or every accuracy is
        reached.
    visits : tuple of Visit
        All, in the order of proposal.
    minutes : float
        Robot time of the visits that were run, moves included.
    expected : float
        Robot time of the open visits [min].
    budget : float
        Robot time that was allowed [min].
    history : History
        All estimates so far.
    """

    names: tuple[str, ...]
    targets: Array
    estimate: Estimate | None
    outlook: Outlook | None
    visits: tuple[Visit, ...]
    minutes: float
    expected: float
    budget: float
    history: History

    @property
    def state(self) -> State:
        """How far it is.

        "begun" before the first fit; "identifying" on the way; "out of reach" if the minutes left
        do not suffice for every accuracy; "minutes used" if they do not for another visit;
        "reached", or "in doubt" if that is so but something speaks against the numbers.
        """
        if self.estimate is not None and not self.short_of:
            return "in doubt" if self.estimate.doubts(self.targets) else "reached"
        if self.outlook is not None and not self.open and self.remaining < self.outlook.shortest:
            return "minutes used"
        if self.outlook is not None and not self.outlook.reachable:
            return "out of reach"
        return "begun" if self.estimate is None else "identifying"

    @property
    def ended(self) -> bool:
        """Whether no visit is asked for any more.

        After the last accuracy the first visit is repeated, where the minutes allow that.
        """
        if self.open or self.state not in ("reached", "in doubt", "minutes used"):
            return False
        repeated = any(v.purpose == "repeat" and v.state == "measured" for v in self.visits)
        first = fitted_visits(self.visits)[:1]
        return repeated or self.state == "minutes used" or self.remaining < minutes_of(first)

    @property
    def open(self) -> tuple[Visit, ...]:
        """Visits that are to be run."""
        return tuple(visit for visit in self.visits if visit.state == "open")

    @property
    def remaining(self) -> float:
        """Robot time that is left [min]."""
        return max(self.budget - self.minutes, 0.0)

    @property
    def short_of(self) -> dict[str, float]:
        """Parameters that miss their target, and by which factor."""
        if self.estimate is None:
            return {}
        ratio = self.estimate.std / self.targets
        return {name: float(r) for name, r in zip(self.names, ratio, strict=True) if not r <= 1}


def minutes_of(visits: Iterable[Visit]) -> float:
    """Return the robot time of visits [min], moves and settling included."""
    return sum(visit.plan.duration for visit in visits) / 60
