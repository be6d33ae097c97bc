"""What is known of the robot at any recent stamp: joints, base, frames, surface."""

from dataclasses import replace
from typing import TYPE_CHECKING

from contactfusion.arrays import FloatArray
from contactfusion.errors import FrameError, RobotError
from contactfusion.frames import FrameTree
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
        self._history = History()
        self._transforms = Transforms()
        self._known: State | None = None

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

    def lost(self, state: State) -> str:
        """Say why the robot has no surface in the space; empty when it has, or there is none."""
        if state.surface is not None or (self._body is None and self.model is None):
            return ""
        if self.model is None:
            assert self._body is not None
            whose, frame = "surface", self._body.frame
        else:
            whose, frame = "robot", self.model.root
            try:
                self.model.positions(state.joints)
            except RobotError as error:
                return str(error)
        try:
            state.frames.pose(self._grid.frame, of=frame)
        except FrameError as error:
            return f"no transform joins the {whose}'s frame '{frame}' to the space: {error}"
        return ""

    def _at(self, stamp: float) -> State:
        frames, joints = self._fixed, self._history.joints(stamp)
        if told := self._transforms.at(stamp):
            frames = frames.under(told)
        base = self._history.base_pose(stamp)
        if base:
            parent, child, pose = base
            frames = frames.extended({child: (parent, pose)})
        positions = self._positions(joints)
        if self.model is not None and positions is not None:
            root, links = self.model.root, self.model.poses_at(positions)
            frames = frames.extended(
                {link: (root, pose) for link, pose in links.items() if link != root}
            )
        robot = self._posed(frames, positions)
        return State(
            now=stamp,
            grid=self._grid,
            frames=frames,
            joints=joints,
            base_pose=base[2] if base else None,
            surface=robot.surface if robot else self._surface(frames),
            robot=robot,
        )

    def _positions(self, joints: JointState | None) -> FloatArray | None:
        """Give the joints of the model; None while not all of them are known."""
        if self.model is None:
            return None
        try:
            return self.model.positions(joints)
        except RobotError:
            return None

    def _posed(self, frames: FrameTree, positions: FloatArray | None) -> "PosedRobot | None":
        """Give the robot in the space's frame; None while nothing joins the two."""
        if self.model is None or positions is None:
            return None
        from contactfusion.robots.posed import PosedRobot

        try:
            base = frames.pose(self._grid.frame, of=self.model.root)
        except FrameError:
            return None
        return PosedRobot(self.model, positions, self._grid.frame, base)

    def _surface(self, frames: FrameTree) -> Surface | None:
        """Give the body's surface in the space's frame; None while nothing joins the two."""
        if self._body is None or self._body.frame == self._grid.frame:
            return self._body
        try:
            pose = frames.pose(self._grid.frame, of=self._body.frame)
        except FrameError:
            return None
        return self._body.moved(pose, self._grid.frame)


def _model(config: PipelineConfig) -> "RobotModel | None":
    if config.robot is None:
        return None
    from contactfusion.robots.model import shared_robot

    return shared_robot(config.robot)
