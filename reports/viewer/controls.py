"""The panel beside the robot: sliders, choices, the FRF, and what is said of a position."""

from collections.abc import Callable
from typing import Any

import numpy as np
import viser
from viser import uplot

from reports.text import pretty_unit
from reports.viewer.view import View
from robotmodels.common.arrays import Array

_STILL = "at rest"
_DECIMALS = 3  # of degrees or metres


class Controls:
    """The panel.

    Parameters
    ----------
    gui : viser.GuiApi
        Where it goes.
    view : View
        What it is about.
    start : ndarray, (n,), rad or m
        Position to begin with.
    touched : callable
        Called when something else is to be shown.
    """

    _mode: viser.GuiDropdownHandle[str]
    _modes: list[str]

    def __init__(
        self, gui: viser.GuiApi, view: View, start: Array, touched: Callable[[], None]
    ) -> None:
        self._view, self._touched = view, touched
        self._unit = np.where(view.robot.turning, np.pi / 180, 1.0)
        gui.set_panel_label(view.robot.name)
        self.words = gui.add_markdown("")
        self.colours, self.rejected = self._add_plan(gui)
        self._add_frf(gui)
        self._angles = self._add_position(gui, start)
        self._add_modes(gui)
        self._factors = self._add_springs(gui)

    @property
    def position(self) -> Array:
        """The position, (n,) [rad or m]."""
        shown = np.array([slider.value for slider in self._angles]) * self._unit
        return np.asarray(np.clip(shown, *self._view.robot.position_limits.T))

    @position.setter
    def position(self, position: Array) -> None:
        for slider, value in zip(self._angles, position / self._unit, strict=True):
            _set(slider, float(np.clip(np.round(value, _DECIMALS), slider.min, slider.max)))
        self._touched()

    @property
    def values(self) -> Array:
        """The parameters, (p,) [SI]."""
        factors = np.array([slider.value for slider in self._factors])
        return np.asarray(self._view.robot.parameters.values * 10.0**factors)

    @property
    def mode(self) -> int | None:
        """The mode to be shown; None for none."""
        # The browser may still choose among frequencies of before the last move.
        shown = self._mode.value in self._modes[1:]
        return self._modes.index(self._mode.value) - 1 if shown else None

    @property
    def amplitude(self) -> float:
        """Amplitude of modes [m]."""
        return self._amplitude.value / 1000

    @property
    def element(self) -> tuple[int, int]:
        """Output and motor of the FRF."""
        motors = len(self._view.robot.motor_names)
        return divmod(self._element.options.index(self._element.value), motors)

    def show_frf(self, curves: Array) -> None:
        """Draw |G| and the ends of its band, (3, F)."""
        magnitude, lower, upper = curves
        self._plot.data = (self._view.omega / (2 * np.pi), lower, upper, magnitude)

    def show_modes(self, frequencies: Array) -> None:
        """Name the modes by frequency [Hz], and go on with the one that is shown."""
        mode = self.mode
        modes = [_STILL, *(f"{k}: {f:.2f} Hz" for k, f in enumerate(frequencies, start=1))]
        if modes != self._modes:
            self._modes, self._mode.options = modes, tuple(modes)
            _set(self._mode, modes[0 if mode is None else mode + 1])

    def _touch(self, _: Any) -> None:
        self._touched()

    def _add_plan(self, gui: viser.GuiApi) -> Any:
        """Add the visits of the plan; return the choices of the candidates that are drawn."""
        if self._view.study is None:
            return None, None
        positions = self._view.study.plan.positions
        with gui.add_folder("Plan"):
            last = max(2, len(positions))  # a slider has two ends
            visit = gui.add_slider("visit", 1, last, 1, 1, hint="in the order of visits")
            colours = gui.add_dropdown("candidates by", ("weight", "sensitivity", "hidden"))
            rejected = gui.add_checkbox("rejected positions", False)

        @visit.on_update
        def _(_: Any) -> None:
            self.position = positions[min(visit.value, len(positions)) - 1]

        return colours, rejected

    def _add_position(self, gui: viser.GuiApi, start: Array) -> list[Any]:
        robot, sliders = self._view.robot, []
        low, high = robot.position_limits.T / self._unit
        with gui.add_folder("Position"):
            for i, name in enumerate(robot.motor_names):
                ends = (
                    float(np.ceil(low[i] * 10**_DECIMALS) / 10**_DECIMALS),
                    float(np.floor(high[i] * 10**_DECIMALS) / 10**_DECIMALS),
                )
                at = float(np.clip(np.round(start[i] / self._unit[i], _DECIMALS), *ends))
                unit = "°" if robot.turning[i] else "m"
                slider = gui.add_slider(f"{name} [{unit}]", *ends, 10.0**-_DECIMALS, at)
                slider.on_update(self._touch)
                sliders.append(slider)
        return sliders

    def _add_modes(self, gui: viser.GuiApi) -> None:
        self._modes = [_STILL]
        with gui.add_folder("Modes"):
            self._mode = gui.add_dropdown("mode", (_STILL,))
            self._amplitude = gui.add_slider("amplitude [mm]", 1.0, 300.0, 1.0, 80.0)
        self._mode.on_update(self._touch)

    def _add_frf(self, gui: viser.GuiApi) -> None:
        robot, empty = self._view.robot, np.full(len(self._view.omega), np.nan)
        names = tuple(f"{o} / {m}" for o in robot.output_names for m in robot.motor_names)
        with gui.add_folder("FRF, magnitude"):
            self._element = gui.add_dropdown("output / motor", names)
            self._plot = gui.add_uplot(
                (self._view.omega / (2 * np.pi), empty, empty, empty),
                (
                    uplot.Series(label="Hz"),
                    uplot.Series(label="95 % from", stroke="#9fb8d8", width=0.5),
                    uplot.Series(label="to", stroke="#9fb8d8", width=0.5),
                    uplot.Series(label="|G|", stroke="#1f4e8c", width=1.5),
                ),
                bands=(uplot.Band(series=(2, 1), fill="rgba(90, 130, 190, 0.35)"),),
                scales={"x": uplot.Scale(time=False, distr=3), "y": uplot.Scale(distr=3)},
                axes=(
                    uplot.Axis(label="frequency [Hz]"),
                    uplot.Axis(size=75, label=f"[{pretty_unit(robot.output_units[0])}/(N m)]"),
                ),
                aspect=1.2,
                padding=(14, 12, 0, 0),  # the outermost ticks' numbers
            )
        self._element.on_update(self._touch)

    def _add_springs(self, gui: viser.GuiApi) -> list[Any]:
        sliders = []
        with gui.add_folder("Springs and dampers, powers of ten", expand_by_default=False):
            for name in self._view.robot.parameters.names:
                slider = gui.add_slider(name, -1.0, 1.0, 0.01, 0.0)
                slider.on_update(self._touch)
                sliders.append(slider)
        return sliders


def _set(handle: Any, value: float | str) -> None:
    """Set the value of a control, which the types of viser take for read-only."""
    handle.value = value
