"""Conversion of Ouster recordings to MCAP: a program of its own, run where ouster-sdk is.

ouster-sdk pins an old rosbags, so the two can't be in one environment. This file runs where
ouster-sdk is installed, imports nothing of contactfusion, and loads packages on use.
"""

import argparse
import os
import secrets
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

TOPIC, FRAME = "/ouster/points", "os_sensor"
CLOUD, FIELD = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/PointField"
FIELDS = ("x", "y", "z", "range")
FLOAT32 = 7
"""The number of a float32 in sensor_msgs/PointField."""
SEEN = 1
"""The bit of a column's status that is set when its packet arrived."""
SECOND = 1_000_000_000
MOST_PIXELS = 2**22
"""More rings times columns than any sensor has: an OS-2-128 of 4096 columns has an eighth."""


class ConversionError(Exception):
    """A recording can't be converted."""


def convert(source: Path, out: Path, every_nth_row: int = 1, meta: Path | None = None) -> str:
    """Write each scan of a recording as one organised sensor_msgs/PointCloud2.

    A row is a ring, a column is the measurements of all rings at one moment; no return is NaN.
    Fields are x, y, z in the sensor's own frame and the range [m], all float32; of two returns the
    first is kept. A scan has the stamp of its first column, in the clock of the sensor.

    Args:
        source: a .pcap with its .json beside it, an .osf, or a bag of Ouster's packets.
        out: the MCAP file; an existing one is replaced.
        every_nth_row: of an OS-0-128, every 4th row makes an OS-0-32.
        meta: the sensor's metadata, when it is neither in the file nor beside it.

    Returns:
        What was written, as a sentence.

    Raises:
        ConversionError: there is nothing to convert, or the result can't be written.
    """
    if every_nth_row < 1:
        raise ConversionError(f"every row is the 1st, not the {every_nth_row}th: give 1 or more")
    shapes: list[tuple[int, int]] = []
    cut = 0
    with _whole(out) as file, _writer(file) as write:
        for scan, project in _scans(source, meta):
            stamps = scan.timestamp[(scan.status & SEEN) > 0]
            if not stamps.size:
                continue
            points = _points(scan, project)[::every_nth_row]
            write(int(stamps.min()), points)
            shapes.append(points.shape[:2])
            cut += not scan.complete()
        if not shapes:
            raise ConversionError(f"there is no scan in {source}")
    rings, columns = shapes[0]
    scans = "1 scan" if len(shapes) == 1 else f"{len(shapes)} scans"
    missing = f"; columns are missing in {cut}" if cut else ""
    return f"{out}: {scans} of {rings} rings and {columns} columns{missing}"


def _scans(source: Path, meta: Path | None) -> Iterator[tuple[Any, Any]]:
    """Each scan, with the projection of its ranges to points in the frame of the sensor."""
    # installed only in the environment in which this runs
    from ouster.sdk import open_source  # type: ignore[import-not-found]
    from ouster.sdk.core import XYZLut  # type: ignore[import-not-found]

    if not source.is_file():
        raise ConversionError(f"there is no file {source}")
    options = {} if meta is None else {"meta": [str(meta)]}
    try:
        recording = open_source(str(source), collate=False, **options)
        sensors = len(recording.sensor_info)
        if not sensors:
            raise ConversionError(f"{source} describes no sensor: it is not Ouster's, or cut off")
        if sensors > 1:
            raise ConversionError(f"{source} holds {sensors} sensors; only one can be converted")
        form = recording.sensor_info[0].format
        rings, columns = form.pixels_per_column, form.columns_per_frame
        if rings * columns > MOST_PIXELS:
            raise ConversionError(
                f"{source} describes a sensor of {rings} rings and {columns} columns; "
                f"together, no more than {MOST_PIXELS} are taken"
            )
        project = XYZLut(recording.sensor_info[0], use_extrinsics=False)
        for scans in recording:
            yield from ((scan, project) for scan in scans if scan is not None)
    except ConversionError:
        raise
    except Exception as error:  # the SDK has no error of its own for files that it can't read
        why = str(error).split("more details: ")[-1].strip().rstrip(".")
        hint = "; name it by --meta FILE.json" if "find matching metadata" in why else ""
        raise ConversionError(f"{source} can't be read: {why}{hint}") from None


def _points(scan: Any, project: Any) -> NDArray[np.float32]:
    """x, y, z and range [m], shape (rings, columns, 4)."""
    ranges = scan.field("RANGE")
    seen = ranges > 0
    points = np.full((*ranges.shape, len(FIELDS)), np.nan, np.float32)
    points[seen, :3] = project(scan)[seen]
    points[seen, 3] = ranges[seen] * 1e-3
    return points


@contextmanager
def _writer(file: IO[bytes]) -> Iterator[Any]:
    """A function that writes the points of one scan, shape (rings, columns, 4), at a stamp."""
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds: Any = store.types
    fields = [
        kinds[FIELD](name=name, offset=4 * i, datatype=FLOAT32, count=1)
        for i, name in enumerate(FIELDS)
    ]
    writer: Any = Writer(file)
    writer.start(profile="ros2", library="contactfusion")
    definition, _ = store.generate_msgdef(CLOUD, ros_version=2)
    schema = writer.register_schema(CLOUD, "ros2msg", definition.encode())
    channel = writer.register_channel(TOPIC, "cdr", schema)

    def write(stamp: int, points: NDArray[np.float32]) -> None:
        sec, nanosec = divmod(stamp, SECOND)
        rings, columns, width = points.shape
        cloud = kinds[CLOUD](
            header=kinds["std_msgs/msg/Header"](
                stamp=kinds["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec),
                frame_id=FRAME,
            ),
            height=rings,
            width=columns,
            fields=fields,
            is_bigendian=False,
            point_step=4 * width,
            row_step=4 * width * columns,
            data=points.astype("<f4").reshape(-1).view(np.uint8),
            is_dense=bool(np.isfinite(points).all()),
        )
        writer.add_message(channel, stamp, bytes(store.serialize_cdr(cloud, CLOUD)), stamp)

    yield write
    writer.finish()


@contextmanager
def _whole(out: Path) -> Iterator[IO[bytes]]:
    """A file that gets its name when all is written, and is removed after an exception."""
    temporary = out.with_name(f".{out.name}.{secrets.token_hex(4)}")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        try:
            with temporary.open("wb") as file:
                yield file
            os.replace(temporary, out)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise ConversionError(f"{out} can't be written: {error.strerror}") from None


def main(arguments: Sequence[str] | None = None) -> int:
    """Convert what the command line names; the exit status."""
    parser = argparse.ArgumentParser(description="Ouster recordings to MCAP.")
    parser.add_argument("source", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--every-nth-row", type=int, default=1)
    parser.add_argument("--meta", type=Path)
    try:
        print(convert(**vars(parser.parse_args(arguments))))
    except ConversionError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
