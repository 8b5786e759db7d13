"""The section ``fit`` of a study file: estimators and their common starts."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from robotmodels.common.errors import nearest
from robotmodels.common.yaml_files import FileSection
from robotmodels.description.ranges import Index, NonNegative

Residual = Literal["nls", "lls", "lls_magnitude"]


class WeightChoice(FileSection):
    """User-defined weights: of elements on and off the diagonal, zero below a frequency [Hz]."""

    diagonal: NonNegative = 1.0
    off_diagonal: NonNegative = 0.1
    low: NonNegative = 0.0


class Estimator(FileSection):
    """An estimator: residual, weights, and which of the plan's positions, counted from 0.

    `reweight` repeats the best fit with optimal weights at its own FRF.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,40}$")]
    residual: Residual
    weights: Literal["user", "optimal", "combined"]
    positions: Literal["all", "best"] | Annotated[tuple[Index, ...], Field(min_length=1)] = "all"
    reweight: bool = False


class FitChoice(FileSection):
    """Estimators, each from the same starts, perturbed by 10^U(-decades, decades).

    Where a logarithm is taken, elements below `minimum_snr` of their standard deviations have no
    weight. Optimal weights follow `variances` "pooled" over neighbouring lines, or each line's
    "own" and no covariances.
    """

    residuals: Annotated[tuple[Residual, ...], Field(min_length=1)] = ("lls", "nls")
    estimators: Annotated[tuple[Estimator, ...], Field(min_length=1, max_length=100)] | None = None
    decades: Annotated[float, Field(ge=0, lt=3)] = 0.3  # fits seek within three decades
    starts: Annotated[int, Field(ge=1, le=10_000)] = 4
    user_weights: WeightChoice = WeightChoice()
    minimum_snr: NonNegative = 10.0**0.5  # 10 dB, as of named weights
    variances: Literal["pooled", "own"] = "pooled"
    minimiser: Literal["trust_region", "quasi_newton"] = "trust_region"
    result: str | None = None
    prior: Literal["none", "robot"] = "none"

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        if len(set(self.residuals)) < len(self.residuals):
            raise ValueError("residuals: each residual can be named once only")
        if self.estimators is not None and "residuals" in self.model_fields_set:
            raise ValueError("residuals and estimators given; one of them is needed")
        names = [estimator.name for estimator in self.used]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"estimators: the name {name!r} is used twice")
        if self.result is not None and self.result not in names:
            raise ValueError(
                f"result: {self.result!r} is none of the estimators{nearest(self.result, names)}; "
                f"there are {', '.join(names)}"
            )
        return self

    @property
    def used(self) -> tuple[Estimator, ...]:
        """The estimators; a residual stands for its usual weights, all positions.

        Log residuals start with user weights: [WM] section 7 finds that optimal weights, small at
        resonances, fail from far starts where user weights do not.
        """
        if self.estimators is not None:
            return self.estimators
        return tuple(
            Estimator(name=residual, residual=residual, weights="optimal")
            if residual == "nls"
            else Estimator(name=residual, residual=residual, weights="user", reweight=True)
            for residual in self.residuals
        )
