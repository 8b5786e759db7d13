"""The schema of a study file: which robot, where it may be put, how to measure and to fit.

    schema: study/1
    robot: ur10                  # a built-in robot, or the path of a robot file
    truth: hardening.yaml        # left out: the same; the robot that the data are simulated with
    seed: 1                      # of all that is random
    frequencies:                 # of the design and of data simulated by the noise law
      low: 2.0                   # [Hz]
      high: 80.0                 # [Hz]
      count: 80                  # how many
      spacing: log               # or linear
    noise:                       # standard deviations of an element of an FRF
      relative: 0.03             # part of the element
      floor: 0.01                # part of the largest element at that frequency
    candidates: {...}            # positions to choose from, `candidates_settings`
    design: {...}                # criterion and limits, `design_settings`
    compare:                     # the plan in repeated simulations, beside alternatives
      random: 5                  # plans of as many experiments in random candidates
      grid: {elbow_joint: 5}     # a grid by hand; left out: spread evenly over all joints' ranges
      runs: 200                  # simulations of each plan; 0: no comparison
    data:                        # left out: FRFs with that noise; one of the first three
      experiment: {...}          # simulated in closed loop, keys as in an experiment file
      records: records.h5        # measured torques and angles
      frf: frf.h5                # measured FRFs
      noise: auto                # or blocks, periods, detection: where that of runs is seen; or
                                 # standard deviations of samples, [torque, angle]
      method: ari                # or har, log, h1, jio: of the FRFs from records
      covariance: total          # or noise, which misses distortion
      structure: diagonal        # or full, over the elements of an FRF
      delay: 0.0                 # of the angles after the torques, in records [s]
      hold: true                 # whether torques of records are held, as commanded ones are
      coulomb_speeds: file       # rms speeds at which Coulomb friction counts as dampers: those of
                                 # the robot file, of the motors in the data (of records or an
                                 # experiment; `data`), or a list [rad/s, on the shafts]
      friction: false            # of residual sml: whether the levels of the motors' Coulomb
                                 # friction are estimated along
    fit:                         # from several starts, by several estimators
      starts: 4                  # the same for all estimators,
      decades: 0.3               # each value multiplied by 10^U(-0.3, 0.3)
      residuals: [lls, nls]      # lls with user weights, nls with optimal ones; sml of records
      estimators:                # in place of residuals: each with its weights and positions
        - {name: LLS15U, residual: lls, weights: user}
        - {name: LLS1U, residual: lls, weights: user, positions: best}    # or all, or [0, 3]
      user_weights: {diagonal: 1.0, off_diagonal: 0.1, low: 3.0}    # zero below `low` [Hz]
      minimum_snr: 3.16          # elements below have no weight where a logarithm is taken
      variances: pooled          # of optimal weights: over neighbouring lines, or each line's own
      minimiser: trust_region    # or quasi_newton, by gradients alone
      result: LLS15U             # left out: the likelihood, from where the estimators ended
      prior: none                # or robot: the standard deviations in the robot file's `fitted`
    posterior:                   # sampled by emcee
      ensembles: 4               # independent ones, which R-hat compares
      walkers: 64                # in each, at least twice the number of parameters
      steps: 20000               # at most, of each walker
      r_hat: 1.01                # below which sampling may stop
      ess: 4000                  # effective draws above which sampling may stop
    profiles: 3                  # likelihoods, of the least precise parameters
    validation: {count: 3}       # positions that check predictions; left out: none. Of measured
                                 # data  {positions: [0, 4]}  or  {share: 0.2},  then not fitted
    compare_with: wernholt_moberg_2008    # left out, except to repeat the study of that paper
    as_published: true           # with it: once more with the paper's excitation, mean and search
    time_domain: {starts: 3, decades: [0.1, 1.0]}    # with it: fits in time, a case of their own
    local_minima: {amplitudes: [0.1, 1.0], blocks: [2, 8]}    # with it: fits of less excitation
    output: ../out/ur10          # relative to this file, as every path in it

Records are fitted as runs, by maximum likelihood (sml), unless the file names residuals of FRFs
(lls, nls, lls_magnitude) or options of FRFs (method, covariance, structure; user_weights,
minimum_snr, variances). A study has runs or FRFs, not both.

With measured data, the positions are those of the data: `candidates` is left out, and `design` but
for `tolerance` and `solver` of the optimum over the positions measured. Plans are compared where
data are simulated by the noise law; where `compare` is given, with others too, but always with FRFs
of `robot` and errors by the noise law. Limits of the design bind the plan, not its alternatives.
"""

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from oed.experiment.settings_files import read_settings
from oed.study.settings.candidates_settings import CandidatesChoice
from oed.study.settings.data_settings import DataChoice, ValidationChoice
from oed.study.settings.design_settings import DesignChoice
from oed.study.settings.fit_settings import SML, Estimator, FitChoice, Residual
from robotmodels.common.errors import nearest
from robotmodels.common.file_paths import existing_file, robot_reference
from robotmodels.common.yaml_files import FileSection
from robotmodels.description.ranges import Hertz, Positive, Seed

MOST_DRAWS = 10**9
"""Steps of all walkers of a posterior; a thousandth of them takes some minutes."""


_OF_FRFS = {
    "data": ("method", "covariance", "structure"),
    "fit": ("user_weights", "minimum_snr", "variances"),
}
"""Keys that say how FRFs are estimated from records, and how they are weighed."""

ESTIMATORS = ("LLSM15U", "LLS15U", "LLS15O", "NLS15U", "NLS15O", "LLS1U")
"""Of [WM]. M: magnitude only; 15 or 1: positions; U or O: user-defined or optimal weights."""


class Frequencies(FileSection):
    """The frequency grid [Hz], ends included."""

    low: Hertz
    high: Hertz
    count: Annotated[int, Field(ge=1, le=10_000)]
    spacing: Literal["log", "linear"] = "log"

    @model_validator(mode="after")
    def _rising(self) -> Self:
        if self.high <= self.low:
            raise ValueError(f"high ({self.high:g} Hz) must be above low ({self.low:g} Hz)")
        return self


class Noise(FileSection):
    """The noise law of `RelativeNoise`: parts of the element and of the largest element [-]."""

    relative: Annotated[float, Field(ge=0, le=1e3)]
    floor: Annotated[float, Field(ge=0, le=1e3)]

    @model_validator(mode="after")
    def _positive(self) -> Self:
        if max(self.relative, self.floor) < 1e-9:
            raise ValueError(
                "relative and floor are both zero; one must be positive, 1e-9 at least"
            )
        return self


class PosteriorChoice(FileSection):
    """Independent ensembles of emcee walkers, and when they have done enough steps.

    They stop when R-hat is at most `r_hat` and the effective sample size of every parameter at
    least `ess`, or after `steps` each.
    """

    ensembles: Annotated[int, Field(ge=2, le=64)] = 4
    walkers: Annotated[int, Field(ge=1, le=10_000)] = 64
    steps: Annotated[int, Field(ge=1, le=10_000_000)] = 20_000
    r_hat: Annotated[float, Field(gt=1, le=10)] = 1.01
    ess: Positive = 4000.0

    @model_validator(mode="after")
    def _not_too_long(self) -> Self:
        draws = self.ensembles * self.walkers * self.steps
        if draws > MOST_DRAWS:
            raise ValueError(
                f"steps: {draws:.3g} steps of all walkers; at most {MOST_DRAWS:.3g} can be taken"
            )
        return self


class CompareChoice(FileSection):
    """Alternatives to the plan, and how many experiments are simulated by each plan."""

    random: Annotated[int, Field(ge=0, le=100)] = 3
    grid: Annotated[dict[str, Annotated[int, Field(ge=1, le=1000)]], Field(min_length=1)] | None = (
        None
    )
    runs: Annotated[int, Field(ge=0, le=100_000)] | None = None


class TimeDomainChoice(FileSection):
    """How many starts of the fit in the time domain, at each distance from the truth [decades]."""

    starts: Annotated[int, Field(ge=1, le=1000)] = 3
    decades: Annotated[
        tuple[Annotated[float, Field(gt=0, le=1.4)], ...], Field(min_length=1, max_length=20)
    ] = (
        0.1,
        1.0,
    )


class LocalMinimaChoice(FileSection):
    """With which parts of the amplitude and how many blocks searches are repeated.

    They are measured in the first `positions` of the plan and fitted from the first `starts`.
    """

    positions: Annotated[int, Field(ge=1, le=1000)] = 5
    amplitudes: Annotated[
        tuple[Annotated[float, Field(gt=0, le=1)], ...], Field(min_length=1, max_length=20)
    ] = (0.2, 0.5, 1.0)
    blocks: Annotated[
        tuple[Annotated[int, Field(ge=2)], ...], Field(min_length=1, max_length=20)
    ] = (2, 8)
    starts: Annotated[int, Field(ge=1, le=1000)] = 20


class Study(FileSection):
    """A study file, ``schema: study/1``; paths in it are relative to the file."""

    schema_: Literal["study/1"] = Field(alias="schema")
    robot: str
    truth: str | None = None
    seed: Seed = 1
    frequencies: Frequencies | None = None
    noise: Noise | None = None
    candidates: CandidatesChoice | None = None
    design: DesignChoice = DesignChoice()
    data: DataChoice = DataChoice()
    fit: FitChoice = FitChoice()
    compare: CompareChoice = CompareChoice()
    posterior: PosteriorChoice = PosteriorChoice()
    profiles: Annotated[int, Field(ge=0, le=1000)] = 3
    validation: ValidationChoice | None = None
    compare_with: Literal["wernholt_moberg_2008"] | None = None
    as_published: bool = False
    time_domain: TimeDomainChoice | None = None
    local_minima: LocalMinimaChoice | None = None
    output: Path

    @model_validator(mode="after")
    def _data_or_candidates(self) -> Self:
        needed = ("candidates", "frequencies", "noise")
        present = [key for key in needed if getattr(self, key) is not None]
        if self.data.measured:
            optional = [key for key in ("truth", "compare") if key in self.model_fields_set]
            design = sorted(self.design.model_fields_set - {"tolerance", "solver"})
            useless = [*present, *optional, *(f"design.{key}" for key in design)]
            if useless:
                raise ValueError(
                    f"{useless[0]}: of no use with measured data, whose positions, frequencies "
                    "and noise are their own; leave it out"
                )
            return self._checks("positions or share", ("positions", "share"))
        missing = [key for key in needed if key not in present]
        if missing:
            raise ValueError(f"missing key {missing[0]!r}")
        return self._checks("count", ("count",))

    def _checks(self, needed: str, keys: tuple[str, ...]) -> Self:
        """Refuse a validation for data of another kind."""
        validation = self.validation
        if validation is not None and all(getattr(validation, key) is None for key in keys):
            kind = "measured" if self.data.measured else "simulated"
            raise ValueError(f"validation: {needed} is needed for {kind} data")
        return self

    @property
    def estimators(self) -> tuple[Estimator, ...]:
        """The estimators of the fit."""
        usual: tuple[Residual, ...] = ("lls", "nls")
        if self.data.recorded and not self._given_of_frfs():
            usual = (SML,)
        return self.fit.estimators_or(usual)

    @property
    def fits_runs(self) -> bool:
        """Whether records are fitted as runs rather than by FRFs."""
        return self.estimators[0].residual == SML

    def _given_of_frfs(self) -> list[str]:
        """Return the keys given that only FRFs have."""
        return [
            f"{section}.{key}"
            for section, keys in _OF_FRFS.items()
            for key in keys
            if key in getattr(self, section).model_fields_set
        ]

    @model_validator(mode="after")
    def _runs_or_frfs(self) -> Self:
        if len({estimator.residual == SML for estimator in self.estimators}) > 1:
            raise ValueError(
                "fit: sml is of runs, other residuals are of FRFs; a study has one or the other"
            )
        if not self.fits_runs:
            for key in {"noise", "friction"} & self.data.model_fields_set:
                raise ValueError(
                    f"data.{key}: it is that of runs, residual sml; FRFs have their own"
                )
            return self
        if not self.data.recorded:
            raise ValueError(
                "fit: residual sml compares runs; data.records or data.experiment is needed"
            )
        if useless := self._given_of_frfs():
            raise ValueError(
                f"{useless[0]}: it is of FRFs, which residual sml does not use; leave it out"
            )
        return self

    @model_validator(mode="after")
    def _result_of_an_estimator(self) -> Self:
        name, names = self.fit.result, [estimator.name for estimator in self.estimators]
        if name is not None and name not in names:
            raise ValueError(
                f"fit.result: {name!r} is none of the estimators{nearest(name, names)}; "
                f"there are {', '.join(names)}"
            )
        return self

    @property
    def compares(self) -> bool:
        """Whether the plan is compared with alternatives in simulated experiments."""
        if self.data.measured or self.compare.runs == 0:
            return False
        by_law = self.data.experiment is None and self.truth is None
        return by_law or "compare" in self.model_fields_set

    @model_validator(mode="after")
    def _six_estimators(self) -> Self:
        for key in ("time_domain", "as_published", "local_minima"):
            if getattr(self, key) and self.compare_with is None:
                raise ValueError(f"{key}: it belongs to a study with compare_with; leave it out")
        if self.as_published and self.data.experiment is None:
            raise ValueError(
                "as_published: it repeats the experiment with the paper's excitation, so "
                "data.experiment is needed; leave it out"
            )
        if self.local_minima is not None:
            blocks = 0 if self.data.experiment is None else self.data.experiment.blocks
            if max(self.local_minima.blocks) > blocks:
                raise ValueError(
                    f"local_minima: blocks: {max(self.local_minima.blocks)}; the experiment has "
                    f"{blocks}"
                )
        names = [estimator.name for estimator in self.estimators]
        missing = [name for name in ESTIMATORS if name not in names]
        if self.compare_with is not None and missing:
            raise ValueError(
                f"compare_with: {self.compare_with} needs the estimators {', '.join(ESTIMATORS)}; "
                f"{', '.join(missing)} missing in fit.estimators"
            )
        return self


def load_study(path: str | Path) -> Study:
    """Read a study file, see `read_settings`; those of data and springs become absolute too.

    Raises
    ------
    InvalidInput
        As `read_settings`, or if there are no such data.
    """
    path = Path(path)
    study = read_settings(path, Study)
    files = {
        key: existing_file(path, f"data.{key}", file)
        for key in ("records", "frf")
        if (file := getattr(study.data, key)) is not None
    }
    changed: dict[str, object] = {"data": study.data.model_copy(update=files)}
    if study.design.distinguish:
        springs = [
            robot_reference(path, each) if isinstance(each, str) else each
            for each in study.design.distinguish
        ]
        changed["design"] = study.design.model_copy(update={"distinguish": tuple(springs)})
    return study.model_copy(update=changed)
