"""Draws the readings, beliefs and commands of a pipeline into a file of rerun."""

from collections.abc import Iterator, Mapping
from itertools import cycle
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.controller import Command
from contactfusion.integrator.sources import SourceReport
from contactfusion.pipeline import Step
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import Reading
from contactfusion.readings.canvas import ACTIVE, Colour
from contactfusion.readings.registry import installed_kinds
from contactfusion.state import State
from contactfusion.view.layout import Extent, layout
from contactfusion.view.recorder import LINES, ArrowsByUnit, Recorder, entity, loaded_rerun
from contactfusion.view.sensors import Sensors, Taxels
from contactfusion.view.world import Absences, Beliefs, Body, Places, draw_command

LONGEST = 32.0
"""The longest arrow of a force or a torque, in sides of a voxel."""
STATES = {"active": (45, 125, 80), "silent": (170, 60, 50), "not heard yet": (85, 85, 95)}
"""States of a source, with their colours."""
MODES = ((40, 105, 160), (150, 100, 20), (110, 75, 165), (20, 120, 115), (150, 65, 115))
"""The colours of a controller's modes, in the order of their first use."""


class Viewer:
    """Draws the steps of a pipeline and the readings between them.

    As a context manager it writes the file when the block ends; when the block raises, no file.
    Of the readings of a sensor since the last step, the newest is drawn, by its own stamp, with
    its frame where the step finds it. Everything stands in the frame over the hypothesis space:
    that of the odometry where there is any.

    Args:
        config: of the pipeline.
        save: the .rrd to write.

    Raises:
        ContactFusionError: the file cannot be written.
        DependencyError: rerun is not installed.
    """

    def __init__(self, config: PipelineConfig, save: Path) -> None:
        self._side = config.integrator.voxel_size
        self._recorder = Recorder(save)
        self._arrows = ArrowsByUnit(LONGEST * self._side)
        self._body, self._taxels = Body(config), Taxels(config)
        self._absences = Absences()
        self._sensors = Sensors(self._taxels, self._arrows, self._absences)
        self._beliefs = Beliefs(self._side, self._arrows.of("N"))
        self._series = Series(self._recorder)
        self._extent = Extent()
        self._waiting: list[Reading] = []
        up = loaded_rerun().ViewCoordinates.RIGHT_HAND_Z_UP
        self._recorder.draw("world", None, up)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is not None:
            self._recorder.abandon(error)
            return
        try:
            self._recorder.close(self._finished())
        except BaseException as failure:
            self._recorder.abandon(failure)
            raise

    def _finished(self) -> Any:
        """Draw what needs the whole recording; the layout of the viewer."""
        self._taxels.finish(self._recorder)
        scale = self._arrows.finish(self._recorder)
        lanes = len(self._series.sources) + 1
        return layout(self._extent, self._side, self._sensors.cameras, lanes, scale)

    def reading(self, reading: Reading) -> None:
        """Take a reading; it is drawn with the first step that is not before it."""
        codec = installed_kinds().of(type(reading))
        if codec is not None and codec.is_drawn:
            self._waiting.append(reading)

    def step(self, step: Step, state: State) -> None:
        """Draw a step.

        Args:
            step: of the pipeline.
            state: the robot at the stamp of the step.
        """
        places = Places.of(state)
        if places.unknown:
            what = f"'{places.grid}' is drawn where it was in '{places.world}' nearest in time"
            self._absences.add(what, step.stamp, places.unknown)
        if state.unplaced:
            self._absences.add("the robot is not drawn", step.stamp, state.unplaced)
        body = self._body.draw(self._recorder, state, places)
        seen = self._draw_readings(step.stamp, places)
        contacts = self._beliefs.draw(self._recorder, step, places)
        self._extent.include(body, contacts, seen, places.space)
        if step.command is not None:
            draw_command(self._recorder, step.command, step.stamp, places, self._body)
        self._series.draw(step)

    def absences(self) -> Iterator[str]:
        """What could not be placed, from when to when [s], and why: a line each."""
        return self._absences.lines()

    def _draw_readings(self, now: float, places: Places) -> FloatArray:
        """Draw the readings of a step; the points in the world that they measured."""
        due = [reading for reading in self._waiting if reading.stamp <= now]
        self._waiting = [reading for reading in self._waiting if reading.stamp > now]
        newest = {self._sensors.channel(reading): reading for reading in due}
        drawn = [self._sensors.draw(self._recorder, reading, places) for reading in newest.values()]
        return np.concatenate([np.empty((0, 3)), *drawn])


class Series:
    """The time lines of one recording.

    Args:
        recorder: to draw with.
    """

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._mode = ""
        self._modes: list[str] = []
        self.sources: set[str] = set()
        """Names of the sources seen so far."""
        recorder.draw("contacts/count", None, _line(ACTIVE, "how many"))
        recorder.draw("contacts/likelihood", None, _line(ACTIVE, "likelihood"))

    def draw(self, step: Step) -> None:
        """Extend all lines by one step."""
        contacts, stamp, recorder = step.fusion.contacts, step.stamp, self._recorder
        recorder.plot("contacts/count", stamp, len(contacts))
        recorder.plot("contacts/likelihood", stamp, contacts[0].likelihood if contacts else 0.0)
        for name, report in step.fusion.report.sources.items():
            share = contacts[0].shares.get(name, 0.0) if contacts else 0.0
            self._introduce(name)
            path = entity(*name.split("/"))
            recorder.plot(f"shares{path}", stamp, share)
            recorder.plot(f"rates{path}", stamp, report.rate)
            recorder.plot(f"ages{path}", stamp, report.age)
            recorder.enter(f"states{path}", stamp, _state(report))
        for event in step.events:
            level = "WARN" if event.kind.is_warning else "INFO"
            recorder.log(entity("events", event.source), stamp, level, event.message)
        if step.command is not None:
            self._draw_mode(step.command, stamp)

    def _introduce(self, name: str) -> None:
        """Introduce a source: its colour in all plots, and the states that it can be in."""
        if name in self.sources:
            return
        colour = LINES[len(self.sources) % len(LINES)]
        self.sources.add(name)
        path = entity(*name.split("/"))
        for lines in ("shares", "rates", "ages"):
            self._recorder.draw(f"{lines}{path}", None, _line(colour, name))
        self._recorder.draw(f"states{path}", None, _states(STATES))

    def _draw_mode(self, command: Command, stamp: float) -> None:
        mode = command.mode or "no mode"
        if mode not in self._modes:
            self._modes.append(mode)
            colours = dict(zip(self._modes, cycle(MODES), strict=False))
            self._recorder.draw("states/controller", None, _states(colours))
        self._recorder.enter("states/controller", stamp, mode)
        if mode != self._mode:
            self._mode = mode
            text = ": ".join(filter(None, (mode, command.reason)))
            self._recorder.log("events/controller", stamp, "INFO", text)


def _states(colours: Mapping[str, Colour]) -> Any:
    """The configuration of states with their colours."""
    opaque = [(*colour, 255) for colour in colours.values()]
    return loaded_rerun().StateConfiguration(values=list(colours), colors=opaque)


def _line(colour: Colour, name: str) -> Any:
    """The style of a line that keeps each value until the next step."""
    return loaded_rerun().SeriesLines(colors=colour, names=name, interpolation_mode="StepAfter")


def _state(report: SourceReport) -> str:
    """The state of a source, in a word."""
    if not report.accepted:
        return "not heard yet"
    return "active" if report.active else "silent"
