"""What a user should know of identified chains, in plain words."""

from typing import TYPE_CHECKING

import numpy as np

from estimators.chains.order import prominent_modes

if TYPE_CHECKING:
    from estimators.chains.identification import ChainIdentification

_HIDDEN = 9.0  # Wald statistic of a mode in one motor: three standard deviations
_POOR = 0.3  # relative standard deviation
_UNLIKELY = 1e-3
_MOST_NAMED = 6


def notes(found: "ChainIdentification", *, explained: bool = False) -> tuple[str, ...]:
    """Return one sentence for each thing that looks doubtful, none where all is well.

    Parameters
    ----------
    explained : bool
        Whether another model, that with dampers, explains what modes do not.
    """
    return (*_errors(found, explained), *_modes(found), *_parameters(found))


def _errors(found: "ChainIdentification", explained: bool) -> list[str]:
    said = []
    if found.left_out:
        hertz = found.modes.data.omega[0] / (2 * np.pi)
        said.append(
            f"{found.left_out} at the low end, below {hertz:.3g} Hz, left out of the lines: "
            "friction distorts what is there"
        )
    if explained:
        return said
    if found.excess:
        said.append(
            f"noise does not explain the misfit: {100 * found.excess:.2g} % of each FRF was added "
            "as an error, as strong dampers, which `fit_dampers` allows for, friction, backlash or "
            "a mode outside the band would make it"
        )
    p = found.structure_p_value
    if p < _UNLIKELY:
        doubt = "the structure, or the number of masses, is in doubt"
        if found.modes.layout.turned:
            doubt = f"dampers couple the modes, which `fit_dampers` allows for, or {doubt}"
        said.append(
            f"poles and zeros are unlike those of any such chains without dampers (probability "
            f"{p:.1g}): {doubt}"
        )
    return said


def _modes(found: "ChainIdentification") -> list[str]:
    modes = found.modes
    said: list[str] = []
    if modes.data.undamped:
        return said
    hertz = modes.omega / (2 * np.pi)
    for r in np.flatnonzero(~prominent_modes(modes)):
        said.append(
            f"the mode at {hertz[r]:.4g} Hz all but cancels against a zero in every chain: "
            "the order may be too high for the data"
        )
    hidden = [
        f"{hertz[r]:.4g} Hz in chain {i + 1}"
        for r, i in np.argwhere(modes.visibility < _HIDDEN)
        if prominent_modes(modes)[r]
    ]
    if hidden:
        said.append(
            f"pole and zero cancel within noise at {', '.join(hidden[:_MOST_NAMED])}"
            f"{' and others' if len(hidden) > _MOST_NAMED else ''}"
        )
    return said


def _parameters(found: "ChainIdentification") -> list[str]:
    estimate = found.structured
    p = estimate.layout.positive
    poor = [
        n for n, s in zip(estimate.names[:p], estimate.relative_std[:p], strict=True) if s > _POOR
    ]
    if not poor:
        return []
    return [
        f"{', '.join(poor[:_MOST_NAMED])}{' and others' if len(poor) > _MOST_NAMED else ''}: "
        f"standard deviations above {100 * _POOR:.0f} %; the order is too high for these data, "
        "or they are too few"
    ]
