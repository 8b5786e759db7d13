"""Visits carried out on a simulated robot, for tutorials, rehearsals and tests."""

from collections.abc import Sequence

import numpy as np

from oed.campaign.settings import VisitSettings
from oed.campaign.visits import Visit
from oed.experiment.prepare import controller_of, imperfections_of
from oed.experiment.run_experiment import SimulatedPlant
from robotmodels import ElasticRobot
from robotmodels.common.progress import Progress, tell


def simulate_visits(
    settings: VisitSettings,
    guesses: ElasticRobot,
    truth: ElasticRobot,
    visits: Sequence[Visit],
    progress: Progress | None = None,
) -> None:
    """Simulate visits and store their records, as `Campaign.tell` stores measured ones.

    Parameters
    ----------
    settings : VisitSettings
        Imperfections and seed.
    guesses : ElasticRobot
        Robot that the default controller is made for.
    truth : ElasticRobot
        Robot to simulate.
    visits : sequence of Visit
        Open visits.
    progress : Progress, optional
        Called with visits done and their number.
    """
    for done, visit in enumerate(visits):
        plant = SimulatedPlant(
            truth,
            controller_of(settings, guesses),
            imperfections_of(settings, truth),
            np.random.default_rng([settings.seed, visit.number]),
        )
        part = visit.folder / "simulated.h5"
        plant.measure(visit.plan, 0).save(part)
        visit.take(part)
        part.unlink()
        tell(progress, done + 1, len(visits))
