"""Readings: one sample of one sensor, with stamp, frame and units."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray, finite_number, frozen_array
from contactfusion.errors import InvalidReadingError
from contactfusion.frames import Pose, pose_of
from contactfusion.time import LONGEST_SECONDS


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """One sample of one sensor.

    Attributes:
        stamp: when it was measured [s].
        frame: the frame in which its values are given.
        sensor: the name of the sensor, so that one of several can be chosen.
    """

    stamp: float
    frame: str
    sensor: str = ""

    def __post_init__(self) -> None:
        """Check stamp and frame, then what the kind of reading adds."""
        stamp = finite_number(self.stamp, f"the stamp of {self.label}", InvalidReadingError)
        if abs(stamp) > LONGEST_SECONDS:
            raise InvalidReadingError(f"the stamp of {self.label} is out of range: {stamp} s")
        self._set("stamp", stamp)
        if not self.frame:
            raise InvalidReadingError(f"{self.label} needs the name of its frame")
        self._check()

    @property
    def label(self) -> str:
        """What to call the reading in a sentence."""
        kind = type(self).__name__
        return f"{kind} of '{self.sensor}'" if self.sensor else kind

    def _check(self) -> None:
        """Check and freeze the values of this kind of reading."""

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _freeze(
        self, name: str, *shape: int | None, finite: bool = True, dtype: type = np.float64
    ) -> NDArray[Any]:
        label = f"{name} of {self.label}"
        array = frozen_array(
            getattr(self, name), shape, label, InvalidReadingError, finite=finite, dtype=dtype
        )
        self._set(name, array)
        return array

    def _freeze_turn(self) -> None:
        """Check and freeze an `orientation`."""
        norm = float(np.linalg.norm(self._freeze("orientation", 4)))
        if abs(norm - 1.0) > 1e-3:
            raise InvalidReadingError(
                f"the orientation of {self.label} is no unit quaternion: its norm is {norm:.4g}"
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class Wrench(Reading):
    """A six-axis force-torque sample.

    Attributes:
        force: shape (3,) [N].
        torque: shape (3,) [N·m], about the origin of `frame`.
    """

    force: FloatArray
    torque: FloatArray

    def _check(self) -> None:
        self._freeze("force", 3)
        self._freeze("torque", 3)


@dataclass(frozen=True, kw_only=True, eq=False)
class TactileImage(Reading):
    """The values of a tactile patch, in the sensor's own unit.

    Attributes:
        values: shape (n,), one value a taxel or channel, in the order of the patch.
    """

    values: FloatArray

    def _check(self) -> None:
        if isinstance(self.values, np.ndarray):
            self._set("values", self.values.ravel())
        self._freeze("values", None)


@dataclass(frozen=True, kw_only=True, eq=False)
class Switch(Reading):
    """A binary switch such as a bumper.

    Attributes:
        closed: whether it is pressed.
    """

    closed: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class PointCloud(Reading):
    """A cloud of range returns; rows that are not finite are no returns.

    Attributes:
        points: shape (n, 3) [m].
    """

    points: FloatArray

    def _check(self) -> None:
        self._freeze("points", None, 3, finite=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthImage(Reading):
    """A depth image; 0 and NaN are no return.

    Attributes:
        depth: shape (h, w) [m], along the optical axis.
        intrinsics: shape (3, 3), the camera matrix [pixels].
        colour: shape (h, w, 3), RGB in 0..255, or None.
        mask: shape (h, w), True on the object of interest, or None.
    """

    depth: FloatArray
    intrinsics: FloatArray
    colour: NDArray[np.uint8] | None = None
    mask: NDArray[np.bool_] | None = None

    def _check(self) -> None:
        height, width = self._freeze("depth", None, None, finite=False).shape
        self._freeze("intrinsics", 3, 3)
        if self.colour is not None:
            self._freeze("colour", height, width, 3, dtype=np.uint8)
        if self.mask is not None:
            self._freeze("mask", height, width, dtype=np.bool_)


@dataclass(frozen=True, kw_only=True, eq=False)
class JointState(Reading):
    """The joints of a robot.

    Attributes:
        names: the joints, in the order of the arrays.
        positions: shape (n,) [rad, or m for prismatic joints].
        velocities: shape (n,) [rad/s, m/s], or None.
        efforts: shape (n,) [N·m, N], or None.
    """

    names: tuple[str, ...]
    positions: FloatArray
    velocities: FloatArray | None = None
    efforts: FloatArray | None = None

    def _check(self) -> None:
        self._set("names", tuple(self.names))
        if len(set(self.names)) != len(self.names):
            raise InvalidReadingError(f"{self.label} names a joint twice")
        for name in ("positions", "velocities", "efforts"):
            if getattr(self, name) is not None:
                self._freeze(name, len(self.names))


@dataclass(frozen=True, kw_only=True, eq=False)
class JointCommand(Reading):
    """Where joints are told to go.

    Attributes:
        names: the joints, in the order of the array.
        positions: shape (n,) [rad, or m for prismatic joints].
    """

    names: tuple[str, ...]
    positions: FloatArray

    def _check(self) -> None:
        self._set("names", tuple(self.names))
        if len(set(self.names)) != len(self.names):
            raise InvalidReadingError(f"{self.label} names a joint twice")
        self._freeze("positions", len(self.names))


@dataclass(frozen=True, kw_only=True, eq=False)
class Twist(Reading):
    """A velocity of `frame`, given in `frame`.

    Attributes:
        linear: shape (3,) [m/s].
        angular: shape (3,) [rad/s].
    """

    linear: FloatArray
    angular: FloatArray

    def _check(self) -> None:
        self._freeze("linear", 3)
        self._freeze("angular", 3)


@dataclass(frozen=True, kw_only=True, eq=False)
class Odometry(Reading):
    """The pose of a moving frame in `frame`.

    Attributes:
        child_frame: the frame that moves, e.g. "base".
        position: shape (3,) [m], of the child frame's origin in `frame`.
        orientation: shape (4,), unit quaternion (x, y, z, w), child frame to `frame`.
        linear: shape (3,) [m/s] in the child frame, or None.
        angular: shape (3,) [rad/s] in the child frame, or None.
    """

    child_frame: str
    position: FloatArray
    orientation: FloatArray
    linear: FloatArray | None = None
    angular: FloatArray | None = None

    def _check(self) -> None:
        self._freeze("position", 3)
        self._freeze_turn()
        for name in ("linear", "angular"):
            if getattr(self, name) is not None:
                self._freeze(name, 3)

    @cached_property
    def pose(self) -> Pose:
        """The pose of the child frame in `frame`."""
        from scipy.spatial.transform import Rotation

        return pose_of(self.position, Rotation.from_quat(self.orientation).as_matrix())


@dataclass(frozen=True, kw_only=True, eq=False)
class Transform(Reading):
    """The pose of a frame in its parent `frame`, as /tf and /tf_static of ROS tell it.

    Attributes:
        child_frame: the frame whose pose it is.
        position: shape (3,) [m], of the child frame's origin in `frame`.
        orientation: shape (4,), unit quaternion (x, y, z, w), child frame to `frame`.
        static: whether it holds at all times.
    """

    child_frame: str
    position: FloatArray
    orientation: FloatArray
    static: bool = False

    def _check(self) -> None:
        if not self.child_frame:
            raise InvalidReadingError(f"{self.label} needs the name of its child frame")
        if self.child_frame == self.frame:
            raise InvalidReadingError(f"{self.label} gives the pose of '{self.frame}' in itself")
        self._freeze("position", 3)
        self._freeze_turn()


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjectPose(Reading):
    """Where an object is believed to be, in `frame`.

    Attributes:
        name: the object.
        position: shape (3,) [m], of its origin.
        orientation: shape (4,), unit quaternion (x, y, z, w), object to `frame`.
    """

    name: str
    position: FloatArray
    orientation: FloatArray

    def _check(self) -> None:
        if not self.name:
            raise InvalidReadingError(f"{self.label} needs the name of its object")
        self._freeze("position", 3)
        self._freeze_turn()


@dataclass(frozen=True, kw_only=True, eq=False)
class Markers(Reading):
    """Places of named markers, as motion capture gives them; a lost marker is NaN.

    Attributes:
        names: the markers, in the order of the rows.
        positions: shape (n, 3) [m].
    """

    names: tuple[str, ...]
    positions: FloatArray

    def _check(self) -> None:
        self._set("names", tuple(self.names))
        self._freeze("positions", len(self.names), 3, finite=False)


READING_TYPES: dict[str, type[Reading]] = {
    "wrench": Wrench,
    "tactile_image": TactileImage,
    "switch": Switch,
    "point_cloud": PointCloud,
    "depth_image": DepthImage,
    "joint_state": JointState,
    "joint_command": JointCommand,
    "twist": Twist,
    "odometry": Odometry,
    "transform": Transform,
    "object_pose": ObjectPose,
    "markers": Markers,
}
"""The kinds of reading by the names that configurations use."""
