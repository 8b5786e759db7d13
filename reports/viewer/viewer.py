"""The viewer: what is drawn when controls are moved.

The controls only say what to show; `Viewer.step`, called over and over by one thread, draws it, so
that of many moves of a slider the last one counts.
"""

import io
import time
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from typing import Any

import numpy as np
import viser

from oed.study.parts import DesignedPlan, MeasuredPlan
from reports import text
from reports.viewer.controls import Controls
from reports.viewer.scene import Candidates, RobotBody, add_obstacles, add_plan
from reports.viewer.view import Pose, View
from robotmodels.common.arrays import Array
from robotmodels.common.errors import IdentificationError

_PAUSE = 1 / 30  # between two pictures [s]
_SLOW = 0.5  # cycles of a mode a second, whatever its frequency
_CAMERA = np.array([0.68, -0.51, 0.34])
"""From what is looked at, over its size."""


@contextmanager
def serving(port: int) -> Iterator[viser.ViserServer]:
    """Give a server for this machine alone, at a port or, if that is taken, one of the next."""
    with redirect_stdout(io.StringIO()):  # it would print its address in a frame
        server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)
    try:
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        yield server
    finally:
        with redirect_stdout(io.StringIO()):
            server.stop()


class Viewer:
    """A view of a robot on a server.

    Parameters
    ----------
    view : View
        What to show.
    server : viser.ViserServer
        Serves it.
    """

    def __init__(self, view: View, server: viser.ViserServer) -> None:
        self._view = view
        self._changed = True
        self._dragged_to: Array | None = None
        self._clicked: tuple[Array, Array] | None = None
        self._pose: Pose | None = None
        limits, study = view.robot.position_limits, view.study
        start = limits.mean(axis=1) if study is None else study.plan.positions[0]
        self._body, self._candidates = RobotBody(server, view), Candidates(server, view)
        points = np.vstack([view.candidate_points, view.tool_points(start[None])])
        low, high = np.minimum(points.min(axis=0), 0.0), np.maximum(points.max(axis=0), 0.0)
        camera, middle = server.initial_camera, (low + high) / 2
        camera.look_at, camera.position = middle, middle + np.linalg.norm(high - low) * _CAMERA
        add_plan(server, view, np.asarray(camera.position), middle)
        add_obstacles(server, view)
        self.controls = Controls(server.gui, view, start, self._touch)
        if study is not None:
            self._show_candidates(server)
        self._tool = server.scene.add_transform_controls("/tool", 0.25, disable_rotations=True)
        self._tool.on_update(self._drag)

    def _show_candidates(self, server: viser.ViserServer) -> None:
        """Let candidates be coloured, shown and clicked."""
        colours, rejected = self.controls.colours, self.controls.rejected
        colours.on_update(lambda _: self._candidates.colour(colours.value))
        rejected.on_update(lambda _: self._candidates.show_rejected(rejected.value))
        server.scene.on_click()(self._click)

    def run(self) -> None:
        """Draw what changes until interrupted."""
        while True:
            self.step(time.monotonic())
            time.sleep(_PAUSE)

    def step(self, seconds: float) -> None:
        """Draw what has changed, and a mode as far as it has moved after some time [s]."""
        controls = self.controls
        if self._dragged_to is not None:
            point, self._dragged_to = self._dragged_to, None
            reached = self._view.position_at(point, controls.position)
            controls.position = controls.position if reached is None else reached
        if self._clicked is not None:
            ray, self._clicked = self._clicked, None
            picked = self._candidates.picked(*ray)
            controls.position = controls.position if picked is None else picked
        changed, self._changed = self._changed, False
        if changed:
            self._update(controls.position, controls.values)
        pose, mode = self._pose, controls.mode
        if pose is not None and mode is not None:
            phase = 2 * np.pi * _SLOW * seconds
            self._body.draw(pose.in_mode(mode, controls.amplitude, phase))
        elif pose is not None and changed:
            self._body.draw(pose.placements())

    def _update(self, position: Array, values: Array) -> None:
        """Compute anew what depends on position and springs."""
        (self._tool.position,) = self._view.tool_points(position[None])
        try:
            self._pose = self._view.pose(position, values)
            self.controls.show_modes(self._pose.frequencies / (2 * np.pi))
            self.controls.show_frf(self._view.frf(position, values, *self.controls.element))
            self.controls.words.content = self._words(position)
        except IdentificationError as error:  # springs too soft for the arm
            self.controls.words.content = f"**{error}**"

    def _words(self, position: Array) -> str:
        """Return what there is to say of a position."""
        reasons = self._view.reasons(position)
        feasible = "Feasible: within its limits, no collision."
        words = [f"**Rejected**: {'; '.join(reasons)}" if reasons else feasible]
        if self._view.study is not None:
            words.insert(0, self._description(position, self._view.study.plan))
        gain = self._view.gain(position)
        if gain is not None:
            words.append(
                f"One more visit here: standard deviations fall by "
                f"{text.percent(1 - 1 / gain.factor)} (geometric mean), that of {gain.improved} "
                f"most, from {text.percent(gain.before)} to {text.percent(gain.after)}."
            )
        return "\n\n".join(words)

    def _description(self, position: Array, plan: DesignedPlan | MeasuredPlan) -> str:
        """Return which candidate a position is, what the design says of it, and where its tool."""
        (tool,) = self._view.tool_points(position[None])
        where = f"Tool at ({', '.join(f'{x:.3f}' for x in tool)}) m."
        number = self._view.candidate(position)
        if number is None:
            return f"Not a candidate. {where}"
        weight, sensitivity = plan.design.weights[number], plan.design.sensitivity
        return (
            f"**Candidate {number + 1}** of {len(sensitivity)}: weight {text.percent(weight)}, "
            f"{text.plural(plan.exact.repetitions[number], 'visit')} of the plan's {plan.visits}, "
            f"sensitivity function {sensitivity[number] / sensitivity.max():.2f} of its maximum. "
            f"{where}"
        )

    def _touch(self) -> None:
        self._changed = True

    def _click(self, event: Any) -> None:
        self._clicked = np.array(event.ray_origin), np.array(event.ray_direction)

    def _drag(self, event: Any) -> None:
        self._dragged_to = np.array(event.target.position)
