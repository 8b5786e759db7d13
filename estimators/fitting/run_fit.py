"""Fits to runs: any number of runs in a position, noise of inputs and outputs alike."""

from dataclasses import dataclass, field

from estimators.fitting.fitted_model import FittedModel, lines_in_words
from estimators.fitting.run_problem import SML, RunProblem
from estimators.input_output.coulomb import CoulombPart
from estimators.input_output.run_spectra import RunSpectra
from robotmodels.common.arrays import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class RunFit(FittedModel):
    """A fit to runs: the end of one search, converged or not.

    Its cost is V of `estimators.input_output.likelihood`, and `weighting` "joint" or "row_wise".
    All else as in `FittedModel`.

    Attributes
    ----------
    data : RunSpectra
        Runs it was fitted to.
    """

    data: RunSpectra
    residual: str = field(default=SML, init=False)

    @property
    def row_wise(self) -> bool:
        """Whether outputs were weighed one by one."""
        return self.weighting == "row_wise"

    @property
    def logarithmic(self) -> bool:
        """Whether residuals are logarithms: they are not."""
        return False

    @property
    def problem(self) -> RunProblem:
        """The problem that the fit is the end of."""
        return RunProblem(
            model=self.model,
            data=self.data,
            bounds=self.bounds,
            prior=self.prior,
            weighting=self.weighting,
        )

    @property
    def coulomb(self) -> Array | None:
        """Levels of the motors' Coulomb friction in each position, (Q, n) [N m], if fitted."""
        if self.data.coulomb is None:
            return None
        part = self.problem.errors(self.parameters.values).free
        assert isinstance(part, CoulombPart)
        return self.data.coulomb.levels + part.levels

    @property
    def expected_cost(self) -> float:
        """What noise makes of the cost on average, see `RunProblem`."""
        return self.problem.expected_cost

    @property
    def _cost_in_words(self) -> str:
        return f"{self.expected_cost:.6g} expected, outputs {self.weighting.replace('_', ' ')}"

    def _data_in_words(self) -> str:
        positions, runs = self.data.inputs.shape[:2]
        return (
            f"{runs} {'run' if runs == 1 else 'runs'} at each of {positions} positions, "
            f"{lines_in_words(self.data.omega)}, noise by {self.data.noise}"
        )
