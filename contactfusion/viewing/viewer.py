"""Draws what a pipeline hears, believes and commands, as a file of rerun."""

from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.pipeline import Step
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import Reading
from contactfusion.state import State
from contactfusion.viewing.arrows import Arrows
from contactfusion.viewing.beliefs import Beliefs
from contactfusion.viewing.body import Body
from contactfusion.viewing.commands import draw_command
from contactfusion.viewing.extent import Extent
from contactfusion.viewing.layout import layout
from contactfusion.viewing.library import loaded_rerun
from contactfusion.viewing.places import Absences, Places
from contactfusion.viewing.recorder import Recorder
from contactfusion.viewing.sensors import DRAWN, Sensors
from contactfusion.viewing.series import Series
from contactfusion.viewing.taxels import Taxels

LONGEST = 32.0
"""The longest arrow of a force or a torque, in sides of a voxel."""


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
        longest = LONGEST * self._side
        self._forces, self._torques = Arrows("N", longest), Arrows("N·m", longest)
        self._body, self._taxels = Body(config), Taxels(config)
        self._absences = Absences()
        self._sensors = Sensors(self._taxels, self._forces, self._torques, self._absences)
        self._beliefs, self._series = Beliefs(self._side, self._forces), Series(self._recorder)
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
        """Draw what needs the whole recording; give what the viewer shows first."""
        self._taxels.finish(self._recorder)
        scales = [arrows.finish(self._recorder) for arrows in (self._forces, self._torques)]
        scale = " or ".join(filter(None, scales))
        lanes = len(self._series.sources) + 1
        return layout(self._extent, self._side, self._sensors.cameras, lanes, scale)

    def reading(self, reading: Reading) -> None:
        """Hear a reading; it is drawn with the first step that is not before it."""
        if isinstance(reading, DRAWN):
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
        """Draw the readings that a step heard; give the points that they saw in the world."""
        due = [reading for reading in self._waiting if reading.stamp <= now]
        self._waiting = [reading for reading in self._waiting if reading.stamp > now]
        newest = {
            (one.sensor or one.frame, type(one), getattr(one, "name", "")): one for one in due
        }
        drawn = [self._sensors.draw(self._recorder, one, places) for one in newest.values()]
        return np.concatenate([np.empty((0, 3)), *drawn])
