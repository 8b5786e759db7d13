"""One recommended interval for each parameter, and one verdict."""

from dataclasses import dataclass

from robotmodels.common.plain_data import json_data

VERDICTS = (
    "not converged",
    "too few blocks",
    "model error",
    "not identifiable",
    "noise understated",
    "noise correlated",
    "trustworthy",
)
"""In the order of precedence: the first that holds is stated."""


class Verdict(str):
    """One of `VERDICTS`, with the reason in one sentence.

    Attributes
    ----------
    reason : str
        Why.
    """

    reason: str

    def __new__(cls, name: str, reason: str) -> "Verdict":
        """Return the verdict `name`."""
        assert name in VERDICTS
        self = super().__new__(cls, name)
        self.reason = reason
        return self

    # str's has one argument; __new__ here has two.
    def __getnewargs__(self) -> tuple[str, str]:  # type: ignore[override]
        return str(self), self.reason

    @property
    def gives_interval(self) -> bool:
        """Whether intervals with this verdict cover the truth."""
        return self not in ("not converged", "model error", "not identifiable")


@dataclass(frozen=True)
class Interval:
    """The recommended 95 % interval of one parameter.

    Attributes
    ----------
    name : str
        Name of the parameter.
    value : float, SI
        Estimate.
    std : float, SI
        Standard deviation of the estimate; that of its logarithm times the value.
    low, high : float, SI, or None
        Ends. Both None where the verdict gives no interval; one None where the parameter is at a
        bound of the fit, and the interval is one-sided.
    method : str
        Where the standard deviation comes from.
    dof : float
        Degrees of freedom of the standard deviation; infinite for declared noise, not a number
        where those of the noise are unknown.
    verdict : Verdict
        Verdict of this parameter, with its reason.
    """

    name: str
    value: float
    std: float
    low: float | None
    high: float | None
    method: str
    dof: float
    verdict: Verdict


def interval_document(interval: Interval) -> dict[str, float | str | None]:
    """Return an interval as plain numbers and words, for JSON; null where there is none."""
    return {
        **json_data(interval),
        "verdict": str(interval.verdict),
        "reason": interval.verdict.reason,
    }
