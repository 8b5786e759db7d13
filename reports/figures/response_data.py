"""FRFs of a page as compact data, from which its script draws single elements.

``responses.js`` draws what is packed here.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from reports.figures.packed_numbers import packed
from robotmodels.common.arrays import Array, ComplexArray, IntArray

_STEPS = 8  # of a response in the least relative standard deviation
_FINEST, _COARSEST = 1e-4, 1e-2  # steps of ln G, and of logarithms of standard deviations
_LEAST = 1e-200
_LOWEST = 1e-3  # of the ends of a band, one over the other


@dataclass(frozen=True)
class ElementView:
    """What the curves of a page are.

    Attributes
    ----------
    noun, column : str
        What a figure and a column of it are of.
    per : str
        Unit that those of the rows are over.
    names : sequence of tuple of str, (Q, 2)
        What `ResponseData.measured` and `ResponseData.model` are in each position.
    views : int
        How many ways to draw an element: Bode, Nyquist, singular values, coherence.
    paired : bool
        Whether both are FRFs of studies, which have a difference instead of residuals.
    """

    noun: str = "position"
    column: str = "from"
    per: str = "/(N m)"
    names: Sequence[tuple[str, str]] = ()
    views: int = 4
    paired: bool = False


@dataclass(frozen=True, eq=False)
class ResponseData:
    """FRFs in Q positions.

    Attributes
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies of `measured`.
    measured : ndarray of complex, (Q, F, m, n)
        Measured FRFs.
    std : ndarray, (Q, F, m, n)
        Their standard deviations.
    repetitions : ndarray of int, (Q,)
        Experiments that were averaged.
    model_omega : ndarray, (G,), rad/s
        Angular frequencies of `model`, those of `measured` among them.
    model : ndarray of complex, (Q, G, m, n), or None
        FRFs of a model.
    model_std : ndarray, (Q, F, m, n), or None
        Relative standard deviations of the model's FRFs by the parameters' covariance.
    predictive : tuple of ndarray, (Q, F, m, n) each, or None
        Ends of the 95 % posterior predictive band of measured magnitudes.
    """

    omega: Array
    measured: ComplexArray
    std: Array
    repetitions: IntArray
    model_omega: Array
    model: ComplexArray | None = None
    model_std: Array | None = None
    predictive: tuple[Array, Array] | None = None

    @property
    def share_predicted(self) -> float:
        """Share of the measured magnitudes that lie in the posterior predictive band."""
        if self.predictive is None:
            return float("nan")
        (lower, upper), size = self.predictive, np.abs(self.measured)
        return float(((lower <= size) & (size <= upper)).mean())

    def embedded(
        self,
        ids: Sequence[str],
        inputs: Sequence[str],
        outputs: Sequence[str],
        units: Sequence[str],
        shown: ElementView | None = None,
    ) -> Markup:
        """Return the data for a page.

        Parameters
        ----------
        ids : sequence of str, (Q,)
            Ids of the figures that show all elements of a position.
        inputs, outputs, units : sequence of str
            Names of columns and rows, and the units of the rows.
        shown : ElementView, optional
            What is drawn; by default FRFs and a model of them.
        """
        shown = shown or ElementView()
        least = np.percentile(self.std / np.maximum(np.abs(self.measured), _LEAST), 1)
        step = float(np.clip(least / _STEPS, _FINEST, _COARSEST))
        content: dict[str, Any] = {
            "ids": [*ids],
            "inputs": [*inputs],
            "outputs": [*outputs],
            "units": [f"{unit.replace('^2', '²')}{shown.per}" for unit in units],
            "element": asdict(shown) | {"names": shown.names or [("measured", "model")] * len(ids)},
            "repetitions": self.repetitions.tolist(),
            "frequency": [round(float(v), 6) for v in self.omega / (2 * np.pi)],
            "measured": _logarithm(self.measured, step, 1),
            "std": packed(np.log(np.maximum(self.std, _LEAST)), _COARSEST, 1),
            "singular": _singular_values(self.measured, 1),
        }
        if self.model is not None:
            content |= {
                "fine": [round(float(v), 6) for v in self.model_omega / (2 * np.pi)],
                "model": _logarithm(self.model, step, 2),
                "modelSingular": _singular_values(self.model, 2),
            }
        if self.model_std is not None:
            logarithm = np.log(np.maximum(self.model_std, _LEAST))
            content["modelStd"] = packed(logarithm, 2 * _COARSEST, 2)
        if self.predictive is not None:
            lower, upper = (np.maximum(end, _LEAST) for end in self.predictive)
            ends = np.maximum(lower, _LOWEST * upper), upper
            content["predictive"] = [packed(np.log(end), 2 * _COARSEST, 1) for end in ends]
        words = json.dumps(content, separators=(",", ":")).replace("<", "\\u003c")
        return Markup(f'<script type="application/json" class="responses">{words}</script>')


def _logarithm(response: ComplexArray, step: float, order: int) -> list[Any]:
    """Return ln |G| and the phase, which has no jumps."""
    phase = np.unwrap(np.angle(response), axis=1)
    return [
        packed(part, step, order) for part in (np.log(np.maximum(np.abs(response), _LEAST)), phase)
    ]


def _singular_values(response: ComplexArray, order: int) -> dict[str, Any]:
    """Return ln of the singular values, (Q, F, min(m, n)), the largest first."""
    values = np.linalg.svd(response, compute_uv=False)
    return packed(np.log(np.maximum(values, _LEAST)), _COARSEST, order)


def between(omega: Array) -> Array:
    """Return lines with two more between neighbours, evenly on a logarithmic scale."""
    at = np.arange(3 * len(omega) - 2) / 3
    return np.asarray(np.exp(np.interp(at, np.arange(len(omega)), np.log(omega))))
