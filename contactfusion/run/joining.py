"""Whether what a recording's sensors measure can be brought into the hypothesis space."""

from collections.abc import Hashable, Iterator
from contextlib import suppress
from typing import final

from contactfusion.errors import FrameError, RecordingError, RobotError
from contactfusion.pipeline import Pipeline, takes
from contactfusion.readings import JointState, Odometry, Reading, Transform
from contactfusion.robot_state import Robot
from contactfusion.run.inputs import is_sensed
from contactfusion.stream import Stream
from contactfusion.terminal import followed


def joined(pipeline: Pipeline, recording: Stream) -> "Joining":
    """What of a recording is joined to the hypothesis space, by readings until all is.

    They are read at most to their end; no generator is asked.
    """
    joining = Joining(pipeline)
    known: set[Hashable] = set()
    with suppress(RecordingError):  # what came before it is played
        for reading in followed(recording.readings(), "looking for frames", recording.end):
            joining.add(reading)
            if (news := _news(reading)) not in known:
                known.add(news)
                joining.update(reading.stamp)
                if joining.complete:
                    break
    return joining


def _news(reading: Reading) -> Hashable:
    """What a reading says of frames, but for their poses."""
    match reading:
        case Transform():
            return reading.frame, reading.child_frame, reading.static
        case Odometry():
            return reading.frame, reading.child_frame
        case JointState():
            return reading.names
        case _:
            return type(reading), reading.sensor, reading.frame


@final
class Joining:
    """Which frames have been joined to the hypothesis space; at any one time is enough.

    Args:
        pipeline: whose generators listen, and whose robot or surface they may need.
    """

    def __init__(self, pipeline: Pipeline) -> None:
        config = pipeline.config
        self._space = pipeline.grid.frame
        self._robot = Robot(config.model_copy(update={"surface": None}), pipeline.grid)
        self._generators = {
            f"generators.{name}": generator
            for name, generator in pipeline.generators.items()
            if any(map(is_sensed, generator.readings))
        }
        self._apart: dict[str, set[str]] = {}
        """By field the frames of which none has been joined."""
        if any(generator.needs_body for generator in pipeline.generators.values()):
            if self._robot.model is not None:
                self._apart["robot"] = {self._robot.model.root}
            elif config.surface is not None:
                self._apart["surface.frame"] = {config.surface.frame}
        self._apart |= {field: set() for field in self._generators}
        self._why: dict[str, str] = {}
        """By field what keeps its frames apart; nothing where no reading came."""

    @property
    def complete(self) -> bool:
        """Whether all has been joined."""
        return not self._apart

    @property
    def faults(self) -> Iterator[str]:
        """A sentence, by field, for each generator whose readings come in frames without a place.

        Likewise for the robot or the surface, where a generator needs it.
        """
        return (f"{field}: {self._why[field]}" for field in self._apart if field in self._why)

    @property
    def misplaced(self) -> str:
        """A sentence on the links that /tf_static places elsewhere than the URDF, or nothing."""
        return self._robot.misplaced

    def add(self, reading: Reading) -> None:
        """Take in what a reading says of the robot, and the frame that it comes in."""
        self._robot.add(reading)
        if is_sensed(type(reading)):
            for field, generator in self._generators.items():
                if field in self._apart and takes(generator, reading.sensor, type(reading)):
                    self._apart[field].add(reading.frame)

    def update(self, stamp: float) -> None:
        """Join what can be, by all poses that are known, whenever they were measured."""
        state = self._robot.state(stamp, None)
        frames = state.frames.nearest()
        for field, apart in list(self._apart.items()):
            for frame in sorted(apart):
                try:
                    if field == "robot" and self._robot.model is not None:
                        self._robot.model.positions(state.joints)  # its surface needs them all
                    frames.pose(self._space, of=frame)
                except (FrameError, RobotError) as error:
                    self._why[field] = str(error)
                else:
                    del self._apart[field]
                    break
