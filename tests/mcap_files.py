"""MCAP files as tests read them: by rosbags, and by mcap-ros2-support."""

import resource
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.recordings.messages import typestore

rosbag2 = pytest.importorskip("rosbags.rosbag2")
mcap_reader = pytest.importorskip("mcap.reader")
mcap_ros2 = pytest.importorskip("mcap_ros2.decoder")


@dataclass(frozen=True)
class Read:
    """One message of a file: when it was logged [ns], of which type it is, and its fields."""

    stamp: int
    kind: str
    fields: Any


Recorded = dict[str, list[Read]]
"""The messages of a file by topic."""


def plain(value: Any) -> Any:
    """Give a message as dictionaries, lists and numbers, whichever reader it is from."""
    if isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, bytes | memoryview | Sequence):
        return [plain(one) for one in value]
    names = getattr(type(value), "__slots__", None) or vars(value)
    return {name: plain(getattr(value, name)) for name in names if name != "__msgtype__"}


def read_by_rosbags(path: Path) -> Recorded:
    found: Recorded = {}
    with rosbag2.Reader(path) as reader:
        for channel, stamp, raw in reader.messages():
            message = typestore().deserialize_cdr(raw, channel.msgtype)
            one = Read(stamp, channel.msgtype, plain(message))
            found.setdefault(channel.topic, []).append(one)
    return found


def read_by_mcap_ros2(path: Path) -> Recorded:
    """Read with nothing but the definitions that stand in the file."""
    found: Recorded = {}
    with path.open("rb") as file:
        reader = mcap_reader.make_reader(file, decoder_factories=[mcap_ros2.DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            one = Read(message.log_time, schema.name, plain(decoded))
            found.setdefault(channel.topic, []).append(one)
    return found


def channel_metadata(path: Path) -> dict[str, dict[str, str]]:
    """Give the metadata of each topic's channel, as the mcap library reads it."""
    with path.open("rb") as file:
        summary = mcap_reader.make_reader(file).get_summary()
    return {channel.topic: channel.metadata for channel in summary.channels.values()}


@contextmanager
def disk_of(size: int) -> Iterator[None]:
    """Let no file grow beyond a size [bytes], as on a disk that is full then."""
    limits, without = resource.getrlimit(resource.RLIMIT_FSIZE), sys.dont_write_bytecode
    sys.dont_write_bytecode = True  # Python would keep modules cut off at that size
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        sys.dont_write_bytecode = without
