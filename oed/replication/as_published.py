"""The study once more as [WM] did theirs: excitation, mean, weights and search of the paper.

Where this project's studies differ: FRFs by the mean (2) of each block's `Y U^-1`, not by a mean of
logarithms; a flat spectrum of the speed reference, not one that falls with frequency; no element
left out for its signal-to-noise ratio; optimal weights from each line's own variance, not one
pooled over neighbours; a quasi-Newton search, as MATLAB's fminunc with its usual tolerance, not
Gauss-Newton steps. Positions, number of blocks, limits and starts are those of the study. What the
paper does not say of its search is taken from the study too: parameters are sought as ln theta
within three decades, and gradients are exact.
"""

from concurrent.futures import Executor

from oed.replication.six_estimators import REFERENCE
from oed.study.parts import Fits, RunRecord, SimulatedData
from oed.study.results import FittedStudy
from oed.study.settings.study_file import ESTIMATORS, Study
from oed.study.stage_cache import versions
from oed.study.stages.data import data_from_records
from oed.study.stages.experiment import experiment
from oed.study.stages.fit import fit
from oed.study.stages.run import MeasuredRun, Visits, open_run
from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import StageProgress


def published_settings(study: Study) -> Study:
    """Return a study's settings with the paper's choices, and an output folder of their own."""
    data, excitation = study.data, study.data.experiment
    if excitation is not None:
        flat = excitation.multisine.model_copy(update={"slope": 0.0})
        excitation = excitation.model_copy(update={"multisine": flat})
    choices = {"minimum_snr": 0.0, "variances": "own", "minimiser": "quasi_newton"}
    return study.model_copy(
        update={
            "data": data.model_copy(update={"experiment": excitation, "method": "ari"}),
            "fit": study.fit.model_copy(update=choices),
            "as_published": False,
            "time_domain": None,
            "local_minima": None,
            "output": study.output / "as_published",
        }
    )


def fit_as_published(
    results: FittedStudy,
    progress: StageProgress | None = None,
    *,
    executor: Executor | None = None,
    fresh: bool = False,
) -> FittedStudy:
    """Return a study's plan carried out and fitted as published, from the same starts.

    Parameters and what is stored: see `oed.study.pipeline.run_study`.

    Raises
    ------
    InvalidInput
        If the study has no simulated experiment.
    """
    study, plan, starts = published_settings(results.study), results.plan, results.fits.starts
    with open_run(study, progress, executor, fresh) as run:
        excitation = study.data.experiment
        if excitation is None or isinstance(run, MeasuredRun):
            raise InvalidInput("as_published: only an experiment that is simulated can be repeated")
        repetitions = plan.exact.repetitions[plan.used]
        key = {"positions": plan.positions.tolist(), "repetitions": repetitions.tolist()}
        simulated = experiment(run, excitation, Visits(plan.positions, repetitions, key))
        data = data_from_records(run, simulated.value.records, simulated.digest)
        searches = {
            kind.name: fit(run, kind, data, starts).value
            for kind in study.estimators
            if kind.name in ESTIMATORS
        }
        part = data.value
        return FittedStudy(
            study,
            run.robot,
            plan,
            RunRecord((), run.stages.seconds, run.stages.loaded, versions()),
            SimulatedData(
                estimate=part.estimate,
                distortion=part.distortion,
                warnings=part.warnings,
                plant=run.plant,
                experiment=simulated.value,
            ),
            Fits(starts, searches, searches[REFERENCE].result, "as published"),
        )
