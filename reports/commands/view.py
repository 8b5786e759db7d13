"""``oed view``: a robot or a study in a browser."""

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from reports.commands.export import is_study
from reports.commands.options import WORKERS, Workers, robot_names
from reports.commands.studies import read_study, working
from robotmodels.common.errors import InvalidInput
from robotmodels.common.extras import install

if TYPE_CHECKING:
    from reports.viewer.view import View


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(view)


def view(
    source: Annotated[
        str,
        typer.Argument(
            help="A study file, a built-in robot, or the path of a robot file.",
            autocompletion=robot_names,
        ),
    ],
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the page.")] = 8080,
    workers: Workers = WORKERS,
) -> None:
    """Show a robot in the browser: positions, modes, FRFs; of a study its candidates and plan.

    Results of earlier commands are used again; a plan that is missing is computed.

    Example: oed view studies/ur10.yaml
    """
    if find_spec("viser") is None:
        raise InvalidInput(f"view: the library viser is needed; {install('view')}")
    shown = _view(source, workers)
    from reports.viewer.viewer import Viewer, serving

    with serving(port) as server:
        viewer = Viewer(shown, server)
        typer.echo(f"http://127.0.0.1:{server.get_port()} shows {shown.robot.name}; Ctrl-C ends")
        viewer.run()


def _view(source: str, workers: int) -> "View":
    """Return the view of a robot, of a study's fit, or of its plan where no fit is stored."""
    from reports.viewer.view import View

    if not is_study(source):
        from robotmodels import load_robot

        return View.of_robot(load_robot(source))
    path = Path(source)
    from oed.study.pipeline import design_study, fit_study

    study = read_study(path)
    fitted = study.candidates is None or (study.output / "fit.json").is_file()
    step = fit_study if fitted else design_study
    with working(path, workers, None) as (progress, executor):
        return View.of_study(step(study, progress, executor=executor))
