"""A study of movements: stiffnesses of gears from encoders on both sides of them.

It has none of the stages of other studies: movements come as they are, and are fitted in seconds.
"""

from dataclasses import dataclass
from typing import Any

from estimators.deflection.assumptions import DeflectionAssumptions
from estimators.deflection.fit_deflection import DeflectionFit, fit_deflection
from oed.study.settings.deflection_settings import DeflectionStudy
from robotmodels import load_robot
from robotmodels.common.errors import naming
from robotmodels.records.movement import Movement, iterate_movements


@dataclass(frozen=True, eq=False)
class DeflectionResults:
    """What a study of movements computed.

    Attributes
    ----------
    study : DeflectionStudy
        Its settings.
    movements : tuple of Movement
        Movements that were fitted.
    fit : DeflectionFit
        The fit.
    fitted_shares, shares : tuple of dict
        Share explained of each gear's deflection, in each movement that was fitted, and in others.
    """

    study: DeflectionStudy
    movements: tuple[Movement, ...]
    fit: DeflectionFit
    fitted_shares: tuple[dict[str, float], ...]
    shares: tuple[dict[str, float], ...]


def run_deflection_study(study: DeflectionStudy) -> DeflectionResults:
    """Fit the movements of a study.

    Raises
    ------
    InvalidInput
        Naming the file of movements that cannot be fitted or explained.
    """
    robot, file = load_robot(study.robot), study.data.movements
    settings: dict[str, Any] = study.fit.model_dump(exclude={"residuals", "payload"})
    with naming(file):
        movements = tuple(iterate_movements(file))
        fit = fit_deflection(
            robot,
            movements,
            payload=study.fit.payload,
            assumptions=DeflectionAssumptions(**settings),
        )
        fitted_shares = tuple(fit.explained_share(movement) for movement in movements)
    if study.validation is None:
        return DeflectionResults(study, movements, fit, fitted_shares, ())
    with naming(study.validation.movements):
        others = iterate_movements(study.validation.movements)
        shares = tuple(fit.explained_share(movement) for movement in others)
    return DeflectionResults(study, movements, fit, fitted_shares, shares)
