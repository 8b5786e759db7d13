"""The stage ``profiles``: profile likelihoods of the least certain parameters."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimators.sampling.profile_likelihood import Profile, profile_likelihood
from estimators.uncertainty.covariance import Uncertainty
from oed.study.stage_cache import Stage, dataclass_files
from oed.study.stages.result import SelectedFit
from oed.study.stages.run import Run
from oed.study.stages.uncertainty import needed
from robotmodels.common.progress import Progress

_POINTS = 9  # of each curve


@dataclass(frozen=True, eq=False)
class Profiles:
    """Profile likelihoods of some parameters."""

    profiles: tuple[Profile, ...]


def profiles(
    run: Run, result: Stage[SelectedFit], covariances: Stage[Uncertainty] | None
) -> Stage[Profiles] | None:
    """Return profile likelihoods of the least certain parameters, as many as the study asks for.

    Raises
    ------
    IdentificationError
        Without covariances.
    """
    count = run.study.profiles
    if not count:
        return None
    theorem1, fit = needed(covariances).value, result.value.fit
    least_certain = np.sort(np.argsort(-theorem1.std, kind="stable")[:count])
    names = [theorem1.names[i] for i in least_certain]

    def compute(folder: Path, report: Progress | None) -> Profiles:
        pool = run.executor
        return Profiles(
            profile_likelihood(fit, names, points=_POINTS, executor=pool, progress=report)
        )

    inputs = {
        "robot": run.robot_digest,
        "result": result.digest,
        "parameters": names,
        "points": _POINTS,
    }
    return run.stages.run("profiles", inputs, compute, dataclass_files(Profiles))
