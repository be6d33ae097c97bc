"""Recordings of ROS as robots' recorders write them, for tests."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.readings.messages import header, message
from contactfusion.recordings.messages import typestore

rosbag1 = pytest.importorskip("rosbags.rosbag1")
rosbag2 = pytest.importorskip("rosbags.rosbag2")

EPOCH = 1_700_000_000_123_456_789
SECOND = 1_000_000_000
Said = tuple[str, int, Any]
"""A topic, the stamp of the log after `EPOCH` [ns], and a message."""
Write = Callable[[Path, Sequence[Said]], Path]


def mcap(folder: Path, said: Sequence[Said]) -> Path:
    """Write a bare MCAP file."""
    made: Path = _rosbag2(folder / "made", said, rosbag2.StoragePlugin.MCAP)
    return made / "made.mcap"


def mcap_folder(folder: Path, said: Sequence[Said]) -> Path:
    """Write a rosbag2 of MCAP with its metadata."""
    return _rosbag2(folder / "made", said, rosbag2.StoragePlugin.MCAP)


def sqlite_folder(folder: Path, said: Sequence[Said]) -> Path:
    """Write a rosbag2 of SQLite with its metadata."""
    return _rosbag2(folder / "made", said, rosbag2.StoragePlugin.SQLITE3)


def sqlite(folder: Path, said: Sequence[Said]) -> Path:
    """Write a bare SQLite file."""
    return sqlite_folder(folder, said) / "made.db3"


def ros1(folder: Path, said: Sequence[Said], **options: Any) -> Path:
    """Write a bag of ROS 1.

    Args:
        folder: where.
        said: the messages; a topic may be `(topic, node)`.
        options: `size` of chunks in bytes.
    """
    from rosbags.typesys import Stores, get_typestore

    folder.mkdir(parents=True, exist_ok=True)
    noetic = get_typestore(Stores.ROS1_NOETIC)
    path = folder / "made.bag"
    channels: dict[Any, Any] = {}
    with rosbag1.Writer(path) as writer:
        writer.chunk_threshold = options.get("size", writer.chunk_threshold)
        for place, logged, one in said:
            topic, node = place if isinstance(place, tuple) else (place, "/node")
            kind = one.__msgtype__
            store = noetic if kind in noetic.types else typestore()
            if (topic, node) not in channels:
                channels[topic, node] = writer.add_connection(
                    topic, kind, typestore=store, callerid=node
                )
            raw = typestore().serialize_cdr(one, kind)
            writer.write(channels[topic, node], EPOCH + logged, typestore().cdr_to_ros1(raw, kind))
    return path


FORMATS = {
    "ros1": ros1,
    "mcap": mcap,
    "mcap_folder": mcap_folder,
    "sqlite": sqlite,
    "sqlite_folder": sqlite_folder,
}


def _rosbag2(path: Path, said: Sequence[Said], plugin: Any) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with rosbag2.Writer(path, version=8, storage_plugin=plugin) as writer:
        channels: dict[Any, Any] = {}
        for topic, logged, one in said:
            kind = one.__msgtype__
            if (topic, kind) not in channels:
                channels[topic, kind] = writer.add_connection(topic, kind, typestore=typestore())
            raw = typestore().serialize_cdr(one, kind)
            writer.write(channels[topic, kind], EPOCH + logged, raw)
    return path


def top(after: int = 0, frame: str = "base") -> Any:
    """Give a header of a stamp after `EPOCH` [ns]; None of it when `after` is -EPOCH."""
    return header(EPOCH + after, frame)


def vector(*xyz: float) -> Any:
    return message("geometry_msgs/Vector3", x=xyz[0], y=xyz[1], z=xyz[2])


def wrench(after: int = 0, force: float = 1.0, frame: str = "wrist") -> Any:
    """Give geometry_msgs/WrenchStamped with this force along x [N]."""
    both = message("geometry_msgs/Wrench", force=vector(force, 0, 0), torque=vector(0, 0, 0.5))
    return message("geometry_msgs/WrenchStamped", header=top(after, frame), wrench=both)


def joints(after: int = 0, frame: str = "", **changes: Any) -> Any:
    """Give sensor_msgs/JointState of two joints."""
    told: dict[str, Any] = {
        "name": ["a", "b"],
        "position": np.array([0.1, 0.2]),
        "velocity": np.empty(0),
        "effort": np.empty(0),
    }
    return message("sensor_msgs/JointState", header=top(after, frame), **{**told, **changes})


def transforms(*placed: tuple[int, str, str], x: float = 1.0) -> Any:
    """Give tf2_msgs/TFMessage of (stamp after `EPOCH` [ns], parent, child)."""
    turn = message("geometry_msgs/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
    moved = message("geometry_msgs/Transform", translation=vector(x, 0.0, 0.0), rotation=turn)
    stamped = [
        message(
            "geometry_msgs/TransformStamped",
            header=top(after, parent),
            child_frame_id=child,
            transform=moved,
        )
        for after, parent, child in placed
    ]
    return message("tf2_msgs/TFMessage", transforms=stamped)


def text(said: str = "hello") -> Any:
    """Give std_msgs/String, which has no header."""
    return message("std_msgs/String", data=said)


def image(after: int, encoding: str, pixels: Any, padding: int = 0, big: bool = False) -> Any:
    """Give sensor_msgs/Image of pixels of shape (h, w) or (h, w, channels)."""
    rows = [row.tobytes() + bytes(padding) for row in pixels]
    return message(
        "sensor_msgs/Image",
        header=top(after, "lens"),
        height=len(pixels),
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=int(big),
        step=len(rows[0]),
        data=np.frombuffer(b"".join(rows), np.uint8),
    )


def camera_info(after: int, shape: tuple[int, int], focal: float = 300.0) -> Any:
    """Give sensor_msgs/CameraInfo."""
    whole = message(
        "sensor_msgs/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    matrix = np.array([focal, 0.0, 1.0, 0.0, focal, 0.5, 0.0, 0.0, 1.0])
    return message(
        "sensor_msgs/CameraInfo",
        header=top(after, "lens"),
        height=shape[0],
        width=shape[1],
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=matrix,
        r=np.eye(3).ravel(),
        p=np.zeros(12),
        binning_x=0,
        binning_y=0,
        roi=whole,
    )
