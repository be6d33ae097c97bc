"""What is known of the robot at any recent stamp: joints, base, frames, surface."""

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from contactfusion.arrays import FloatArray
from contactfusion.errors import FrameError, RobotError
from contactfusion.frames import FrameTree, Pose, apart
from contactfusion.grid import Grid
from contactfusion.history import History
from contactfusion.integrator.fusion import Fusion
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import JointState, Odometry, Reading, Transform, Twist
from contactfusion.state import State
from contactfusion.surface import Surface
from contactfusion.transforms import Transforms

if TYPE_CHECKING:
    from contactfusion.robots.model import RobotModel
    from contactfusion.robots.posed import PosedRobot

SAME = 1e-3, 0.01
"""Poses of a link that lie, and are turned, by no more than this apart are the same [m, rad]."""


class Robot:
    """Remembers the robot's own readings, and gives its state at a stamp.

    Args:
        config: its frames and its surface.
        grid: the frame and voxel size of the hypothesis space.
    """

    def __init__(self, config: PipelineConfig, grid: Grid) -> None:
        self._grid = grid
        self._fixed = config.frame_tree()
        self._body = config.surface.sampled(config.folder) if config.surface else None
        self.model = _model(config)
        """The robot of the URDF, or None."""
        if self.model is not None:  # what hangs on another link may stand far away in the world
            moved = self.model.moved_links
            self.model.require_mounted(
                {name: frame for name, frame in config.frames.items() if frame.parent in moved}
            )
        self._history = History()
        self._transforms = Transforms()
        self._known: State | None = None
        self._frames = self._fixed
        """Those of the last state."""

    @property
    def misplaced(self) -> str:
        """A sentence on the links that /tf_static places elsewhere than the URDF, or nothing.

        A link that a joint moves is where it was in the last state.
        """
        differing = dict(self._differing())
        if not differing:
            return ""
        (link, by), *others = differing.items()
        likewise = f"; likewise {', '.join(name for name, _ in others)}" if others else ""
        return (
            f"{link}: the URDF and /tf_static place it differently, {by}; the URDF counts{likewise}"
        )

    def add(self, reading: Reading) -> None:
        """Remember what a reading tells of the robot: joints, odometry, twists and transforms."""
        if isinstance(reading, Transform):
            self._transforms.add(reading)
        elif isinstance(reading, JointState | Odometry | Twist):
            self._history.add(reading)
        else:
            return
        self._known = None

    def clear(self) -> None:
        """Forget all readings."""
        self._history.clear()
        self._transforms.clear()
        self._known = None

    def state(self, stamp: float, fusion: Fusion | None) -> State:
        """Give all that is known at a stamp [s], with the last step of the integrator."""
        known = self._known
        if known is None or known.now != stamp:
            known = self._known = self._at(stamp)
        return known if known.fusion is fusion else replace(known, fusion=fusion)

    def _differing(self) -> Iterator[tuple[str, str]]:
        """Each link that /tf_static places elsewhere than the URDF, and by how much."""
        links = self.model.link_names if self.model else ()
        for link, (parent, static) in self._transforms.static.items():
            if parent not in links or link not in links:
                continue
            try:
                distance, angle = apart(self._frames.pose(parent, of=link), static)
            except FrameError:  # a joint that has not been reported lies between the two
                continue
            if distance > SAME[0] or angle > SAME[1]:
                yield link, f"{distance:.3g} m and {angle:.3g} rad apart"

    def _at(self, stamp: float) -> State:
        frames, joints = self._fixed, self._history.joints(stamp)
        if told := self._transforms.at(stamp):
            frames = frames.under(told)
        base = self._history.base_pose(stamp)
        if base:
            parent, child, pose = base
            frames = frames.extended({child: (parent, pose)})
        robot, surface, unplaced = None, None, ""
        if self.model is not None:
            positions, unknown = self.model.known_positions(joints)
            frames = frames.extended(self.model.frames_at(positions, unknown))
        self._frames = frames
        try:
            if self.model is not None:
                robot = self._posed(self.model, self.model.positions(joints), frames)
            elif self._body is not None:
                surface = self._placed(self._body, frames)
        except (RobotError, FrameError) as error:
            unplaced = str(error)
        return State(
            now=stamp,
            grid=self._grid,
            frames=frames,
            joints=joints,
            base_pose=base[2] if base else None,
            surface=robot.surface if robot else surface,
            robot=robot,
            unplaced=unplaced,
        )

    def _posed(self, model: "RobotModel", positions: FloatArray, frames: FrameTree) -> "PosedRobot":
        from contactfusion.robots.posed import PosedRobot

        return PosedRobot(
            model, positions, self._grid.frame, self._pose("robot", model.root, frames)
        )

    def _placed(self, body: Surface, frames: FrameTree) -> Surface:
        if body.frame == self._grid.frame:
            return body
        return body.moved(self._pose("surface", body.frame, frames), self._grid.frame)

    def _pose(self, whose: str, frame: str, frames: FrameTree) -> Pose:
        """The pose of a frame in that of the space.

        Raises:
            FrameError: nothing joins the two.
        """
        try:
            return frames.pose(self._grid.frame, of=frame)
        except FrameError as error:
            raise FrameError(
                f"no transform joins the {whose}'s frame '{frame}' to the space: {error}"
            ) from None


def _model(config: PipelineConfig) -> "RobotModel | None":
    if config.robot is None:
        return None
    from contactfusion.robots.model import shared_robot

    return shared_robot(config.robot)
