"""The file behind a recording: a bag of rosbags that becomes one MCAP file, whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Final

from contactfusion.errors import WritingError
from contactfusion.files import make_folder

if TYPE_CHECKING:
    from rosbags.interfaces import Qos
    from rosbags.rosbag2 import Writer

VERSION: Final = 8
"""Of the metadata of rosbag2: the newest that ROS 2 Iron reads, too."""
BAG = "recording"
"""What the file is called within itself: two of equal content are equal, whatever their names."""
KEPT = 100
"""So many messages of a topic are kept for those who come late."""
NEVER = 9223372036, 854775807
"""What ROS 2 calls an endless time [s, ns]."""


@contextmanager
def bag_that_becomes(path: Path) -> Iterator["Writer"]:
    """Give a bag of rosbags, which is a folder, and take the one MCAP file out of it at the end.

    Raises:
        WritingError: the disk takes no more; what it took is kept beside the file.
    """
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    make_folder(path.parent)
    with TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder:
        bag = Writer(Path(folder) / BAG, version=VERSION, storage_plugin=StoragePlugin.MCAP)
        bag.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        written = bag.path / f"{BAG}.mcap"
        with kept_when_cut(written, path), ExitStack() as stack:
            yield stack.enter_context(bag)
            with telling(path):
                stack.close()
        os.replace(written, path)


@contextmanager
def kept_when_cut(written: Path, path: Path) -> Iterator[None]:
    """Keep what the disk took of a file before it was full, under a name that says so.

    Args:
        written: the file, as it is called while it is written.
        path: as it would be called.

    Raises:
        WritingError: the one that was met, with the name of what is kept.
    """
    try:
        yield
    except WritingError as error:
        if not written.is_file() or not written.stat().st_size:
            raise WritingError(f"{error}; nothing of it was kept") from None
        kept = next(name for name in _names_of_cuts(path) if not name.exists())
        os.replace(written, kept)
        raise WritingError(f"{error}; what was written until then is {kept}") from None


def _names_of_cuts(path: Path) -> Iterator[Path]:
    yield path.with_suffix(f".cut{path.suffix}")
    for number in count(2):
        yield path.with_suffix(f".cut{number}{path.suffix}")


@contextmanager
def telling(path: Path) -> Iterator[None]:
    """Say in one sentence why a file can't be written, such as that the disk is full.

    Raises:
        WritingError: in place of the system's error.
    """
    try:
        yield
    except OSError as error:
        raise WritingError(f"{path} can't be written: {error.strerror or error}") from None


def latched() -> "Qos":
    """Give the quality of service of what is told once: `ros2 bag play` tells it late comers, too.

    It is that of /tf_static and /robot_description in ROS 2: reliable and transient_local.
    """
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    never = QosTime(*NEVER)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=KEPT,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL,
        deadline=never,
        lifespan=never,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=never,
        avoid_ros_namespace_conventions=False,
    )
