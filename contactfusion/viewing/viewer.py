"""Draws what a pipeline hears, believes and commands, as a file of rerun."""

from pathlib import Path
from types import TracebackType
from typing import Any, Self

from contactfusion.pipeline import Step
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import Reading
from contactfusion.state import State
from contactfusion.viewing.beliefs import Beliefs
from contactfusion.viewing.body import Body
from contactfusion.viewing.layout import layout
from contactfusion.viewing.library import loaded_rerun
from contactfusion.viewing.places import Extent, Places
from contactfusion.viewing.recorder import Recorder
from contactfusion.viewing.sensors import DRAWN, Sensors
from contactfusion.viewing.series import Series
from contactfusion.viewing.taxels import Taxels


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
        self._body, self._taxels = Body(config), Taxels(config)
        self._sensors, self._series = Sensors(self._taxels), Series()
        self._beliefs = Beliefs(self._side)
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
            self._taxels.finish(self._recorder)
            self._recorder.close(self._layout())
        except BaseException as failure:
            self._recorder.abandon(failure)
            raise

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
        body = self._body.draw(self._recorder, state, places)
        self._draw_readings(step.stamp, places)
        contacts = self._beliefs.draw(self._recorder, step, state.grid.frame, places)
        self._extent.include(body, contacts)
        self._series.draw(self._recorder, step)

    def _draw_readings(self, now: float, places: Places) -> None:
        due = [reading for reading in self._waiting if reading.stamp <= now]
        self._waiting = [reading for reading in self._waiting if reading.stamp > now]
        newest = {(one.sensor or one.frame, type(one)): one for one in due}
        for reading in newest.values():
            self._sensors.draw(self._recorder, reading, places)

    def _layout(self) -> Any:
        lanes = len(self._series.sources) + 1
        return layout(self._extent, self._side, self._sensors.cameras, lanes)
