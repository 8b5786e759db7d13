"""What a plan costs: visits to positions and the runs in them."""

from oed.study.results import PlannedStudy
from reports import text


def counts(results: PlannedStudy) -> dict[str, int]:
    """Return how many visits and runs; of measured data, how many blocks were averaged."""
    visits = results.visits
    return {visit_noun(results): visits, "run": visits * results.runs_per_visit}


def cost(results: PlannedStudy) -> str:
    """Return ``15 visits, 90 runs``."""
    return ", ".join(text.plural(count, noun) for noun, count in counts(results).items())


def visits(results: PlannedStudy, candidate: int) -> str:
    """Return how often one candidate is visited, ``2 visits``."""
    return text.plural(int(results.exact.repetitions[candidate]), visit_noun(results))


def visit_noun(results: PlannedStudy) -> str:
    """Return what is counted in a position: of measured data only the blocks are known."""
    return "block" if results.study.data.measured else "visit"
