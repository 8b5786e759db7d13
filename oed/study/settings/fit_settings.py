"""The section ``fit`` of a study file: estimators and their common starts."""

from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from robotmodels.common.yaml_files import FileSection
from robotmodels.description.ranges import Index, NonNegative

SML: Final = "sml"
"""Maximum likelihood of runs; all other residuals are those of FRFs."""

Residual = Literal["nls", "lls", "lls_magnitude", "sml"]

_ROWS = ("auto", "joint", "row_wise")


class WeightChoice(FileSection):
    """User-defined weights: of elements on and off the diagonal, zero below a frequency [Hz]."""

    diagonal: NonNegative = 1.0
    off_diagonal: NonNegative = 0.1
    low: NonNegative = 0.0


class Estimator(FileSection):
    """An estimator: residual, weights, and which of the data's positions, counted from 0.

    `reweight` repeats the best fit with optimal weights at its own FRF. Weights of runs (sml) say
    whether outputs are weighed jointly, row by row, or jointly if their noise is known well enough;
    each visit to a position is one of theirs.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,40}$")]
    residual: Residual
    weights: Literal["user", "optimal", "combined", "auto", "joint", "row_wise"] = "auto"
    positions: Literal["all", "best"] | Annotated[tuple[Index, ...], Field(min_length=1)] = "all"
    reweight: bool = False

    @model_validator(mode="after")
    def _weights_of_its_data(self) -> Self:
        if (self.weights in _ROWS) != (self.residual == SML):
            needed = ", ".join(_ROWS) if self.residual == SML else "user, optimal, combined"
            raise ValueError(
                f"{self.name}: weights {self.weights!r} are none of {self.residual}, which has "
                f"{needed}"
            )
        if self.reweight and self.residual == SML:
            raise ValueError(f"{self.name}: reweight: only of FRFs are weights evaluated anew")
        return self


class FitChoice(FileSection):
    """Estimators, each from the same starts, perturbed by 10^U(-decades, decades).

    Left out, they are lls and nls for FRFs, sml for records.
    Where a logarithm is taken, elements below `minimum_snr` of their standard deviations have no
    weight. Optimal weights follow `variances` "pooled" over neighbouring lines, or each line's
    "own" and no covariances.
    """

    residuals: Annotated[tuple[Residual, ...], Field(min_length=1)] | None = None
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
        residuals = self.residuals or ()
        if len(set(residuals)) < len(residuals):
            raise ValueError("residuals: each residual can be named once only")
        if self.estimators is not None and residuals:
            raise ValueError("residuals and estimators given; one of them is needed")
        names = [estimator.name for estimator in self.estimators or ()]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"estimators: the name {name!r} is used twice")
        return self

    def estimators_or(self, usual: tuple[Residual, ...]) -> tuple[Estimator, ...]:
        """Return the estimators, those of the `usual` residuals where the file names none.

        A residual stands for its usual weights, all positions. Log residuals start with user
        weights: [WM] section 7 finds that optimal weights, small at resonances, fail from far
        starts where user weights do not.
        """
        return self.estimators or tuple(
            Estimator.model_validate({"name": one, "residual": one, **_USUAL.get(one, _USER)})
            for one in self.residuals or usual
        )


_USER = {"weights": "user", "reweight": True}
_USUAL = {"nls": {"weights": "optimal"}, SML: {"weights": "auto"}}
