"""What commands about identified robots are told: whose fit, in which positions."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from reports.commands.export import is_study
from reports.commands.options import robot_names, say
from reports.commands.studies import compute_study
from reports.commands.workers import one_thread_each

if TYPE_CHECKING:
    from estimators.fitting.fitted_model import FittedModel
    from estimators.trust.trust import Trust
    from robotmodels import ElasticRobot
    from robotmodels.common.arrays import Array

Source = Annotated[
    str,
    typer.Argument(
        help="A study file, whose fit is taken, or a robot file with standard deviations.",
        autocompletion=robot_names,
    ),
]
Position = Annotated[
    list[str] | None,
    typer.Option(
        help="One number per motor, in degrees (m if prismatic): 0,-90,90,0,45,0; "
        "repeatable. Default: those of a study's plan; mid-range of a robot."
    ),
]
Output = Annotated[
    Path | None,
    typer.Option("-o", "--output", help="Folder; by default that of the study, or this one."),
]
Seed = Annotated[int, typer.Option(min=0, help="Seed of the draws.")]
Map = Annotated[
    int,
    typer.Option(
        "--map", min=0, max=100_000, help="Number of positions, spread over the joint ranges."
    ),
]


@dataclass(frozen=True, eq=False)
class Answer:
    """What a command computed of an identified robot.

    Attributes
    ----------
    name : str
        Of its files.
    tables : dict of str to str
        Contents of CSV files, by name.
    document : dict of str to Any
        Numbers for scripts.
    write_page : callable
        Writes the page to a path.
    summary : callable
        Returns the words for the terminal, of the files.
    """

    name: str
    tables: dict[str, str]
    document: dict[str, Any]
    write_page: Callable[[Path], None]
    summary: Callable[[list[Path]], str]


@dataclass(frozen=True, eq=False)
class Identified:
    """A fit or a robot with standard deviations, and where it is asked about.

    Attributes
    ----------
    source : FittedModel or ElasticRobot
        Fit of a study, or robot.
    robot : ElasticRobot
        Its robot.
    positions : ndarray, (Q, n)
        Positions.
    folder : Path
        Where files go.
    posterior : ndarray, (N, p), or None
        Draws of ln theta that the study has stored.
    """

    source: "FittedModel | ElasticRobot"
    robot: "ElasticRobot"
    positions: "Array"
    folder: Path
    posterior: "Array | None" = None

    @property
    def spread(self) -> str:
        """What bands rest on, in words."""
        from estimators.sampling.exported_draws import spread_words

        return spread_words(self.source, self.posterior)

    def draws(self, count: int, seed: int) -> "Array":
        """Return draws of ln theta, (count, p), or all of a shorter posterior."""
        import numpy as np

        from estimators.sampling.exported_draws import fit_draws

        return fit_draws(self.source, self.posterior, count, np.random.default_rng(seed))

    @property
    def trust(self) -> "Trust | None":
        """How far the study's fit is to be trusted; None of a robot file."""
        return getattr(self.source, "trust", None)

    @property
    def verdict(self) -> dict[str, str]:
        """The verdict on the study's fit, and its reason; nothing of a robot file."""
        if self.trust is None:
            return {}
        return {"verdict": str(self.trust.verdict), "reason": self.trust.verdict.reason}

    def with_caution(self, summary: str) -> str:
        """Return a summary below the verdict on the fit, unless that is sound."""
        from reports.sections.verdict import KINDS, headline
        from reports.summaries.columns import hung, plain

        if self.trust is None or KINDS.get(self.trust.verdict) == "sound":
            return summary
        words = plain(f"{headline(self.trust)}; {self.trust.verdict.reason}")
        return "\n".join([*hung("", words, 2), summary])

    def answer(self, answer: Answer, output: Path | None, as_json: bool) -> None:
        """Write an answer's files into `output` or the folder, and print its summary."""
        from robotmodels.common.atomic_files import staged_folder
        from robotmodels.common.plain_data import json_text

        folder, document = (output or self.folder).resolve(), answer.document | self.verdict
        contents = answer.tables | {f"{answer.name}.json": json_text(document)}
        page = f"{answer.name}.html"
        with staged_folder(folder) as staged:
            for name, content in contents.items():
                (staged / name).write_text(content, encoding="utf-8")
            answer.write_page(staged / page)
        files = [folder / name for name in (*contents, page)]
        say(
            lambda: self.with_caution(answer.summary(files)),
            lambda: document | {"files": list(map(str, files))},
            as_json,
        )


def read_source(
    source: str, position: Sequence[str] | None, spread: int, workers: int
) -> Identified:
    """Return what a study identified, or a robot with standard deviations.

    Positions are those named, or `spread` of them over the joint ranges, or those of the study.

    Raises
    ------
    IdentificationError
        If there is no such file, or the study cannot be computed.
    """
    one_thread_each()
    import numpy as np

    from oed.candidates.grids import sobol_positions
    from oed.study.pipeline import fit_study
    from reports.commands.check_options import read_position
    from robotmodels import load_robot
    from robotmodels.elastic.tool_response import underlying_robot

    if is_study(source):
        results = compute_study(Path(source), fit_study, workers, False)
        fit, posterior = results.fits.result, results.fits.posterior
        robot, drawn = underlying_robot(fit.model), None if posterior is None else posterior.draws
        model = Identified(fit, robot, results.plan.positions, results.study.output, drawn)
    else:
        robot = load_robot(source)
        model = Identified(robot, robot, read_position(robot, None)[None], Path())
    if position:
        rows = np.array([read_position(robot, words) for words in position])
        return replace(model, positions=rows)
    return replace(model, positions=sobol_positions(robot, spread)) if spread else model
