"""Designs as labelled arrays of xarray."""

from typing import TYPE_CHECKING

import numpy as np

from oed.design.design import Design
from oed.exact.exact_design import ExactDesign
from robotmodels.common.arrays import Array, real_numbers
from robotmodels.common.errors import InvalidInput
from robotmodels.common.extras import install

if TYPE_CHECKING:
    from xarray import Dataset


def design_dataset(design: Design | ExactDesign, positions: Array) -> "Dataset":
    """Return a design as a Dataset: weights or experiments, angles of candidates, information.

    Parameters
    ----------
    design : Design or ExactDesign
        The design.
    positions : ndarray, (Q, n), rad
        The candidates, such as `InformationSet.positions`.

    Raises
    ------
    InvalidInput
        If xarray is not installed, or the candidates are of another number.
    """
    try:
        import xarray
    except ImportError:
        raise InvalidInput(
            f"design_dataset: xarray is needed; {install('arviz')} brings it"
        ) from None
    positions = real_numbers(positions, "positions")
    if isinstance(design, ExactDesign):
        name, weights = "experiments", np.asarray(design.repetitions)
    else:
        name, weights = "weight", np.asarray(design.weights)
    if positions.ndim != 2 or len(positions) != len(weights):
        raise InvalidInput(
            f"positions: shape {positions.shape}; the design has {len(weights)} candidates"
        )
    axes = ("parameter", "other_parameter")
    information = np.asarray(design.information)
    return xarray.Dataset(
        {
            name: ("candidate", weights),
            "angles": (("candidate", "motor"), positions, {"units": "rad"}),
            "information": (("sample", *axes)[-information.ndim :], information),
        },
        {key: list(design.names) for key in axes},
        {"criterion": design.criterion, "value": design.value},
    )
