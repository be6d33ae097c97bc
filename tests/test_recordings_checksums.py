"""Checksums of MCAP files: ours have all of them, and no flipped bit changes a reading unseen."""

import zlib
from pathlib import Path

import numpy as np
import pytest

from contactfusion.errors import RecordingError
from contactfusion.readings import Wrench
from contactfusion.recordings.mcap import McapWriter
from contactfusion.recordings.opening import open_recording
from tests.mcap_files import rosbag2
from tests.ros_bags import mcap, wrench

reading = pytest.importorskip("mcap.reader")
records = pytest.importorskip("mcap.records")
streams = pytest.importorskip("mcap.stream_reader")
writing = pytest.importorskip("mcap.writer")
EPOCH = 10**18


def recorded(folder: Path, count: int = 60) -> Path:
    """Write wrenches of noise, which hardly can be packed."""
    path, rng = folder / "wrist.mcap", np.random.default_rng(0)
    with McapWriter(path, EPOCH) as writer:
        for number in range(count):
            force, torque = rng.normal(size=(2, 3))
            stamp = number / 10.0
            writer.reading(
                Wrench(stamp=stamp, frame="wrist", sensor="wrist", force=force, torque=torque)
            )
    return path


def read(path: Path) -> list[tuple[float, ...]]:
    found = open_recording(path).readings()
    return [(r.stamp, *r.force, *r.torque) for r in found if isinstance(r, Wrench)]


def test_the_mcap_library_finds_every_checksum_and_that_it_fits(tmp_path: Path) -> None:
    raw = recorded(tmp_path).read_bytes()
    with (tmp_path / "wrist.mcap").open("rb") as file:
        messages = list(reading.NonSeekingReader(file, validate_crcs=True).iter_messages())
    assert len(messages) == 60
    with (tmp_path / "wrist.mcap").open("rb") as file:
        found = list(streams.StreamReader(file, emit_chunks=True).records)
    held = [r.uncompressed_crc for r in found if isinstance(r, records.Chunk)]
    held += [r.data_section_crc for r in found if isinstance(r, records.DataEnd)]
    footer = next(r for r in found if isinstance(r, records.Footer))
    assert len(held) == 2 and all([*held, footer.summary_crc])
    assert footer.summary_crc == zlib.crc32(raw[footer.summary_start : -12])


def test_no_flipped_bit_changes_a_reading_unseen(tmp_path: Path) -> None:
    path, rng = recorded(tmp_path), np.random.default_rng(1)
    raw, true = path.read_bytes(), read(path)
    refused = 0
    for at in rng.integers(0, len(raw), 150):
        broken = bytearray(raw)
        broken[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(broken)
        try:
            assert read(path) == true, at
        except RecordingError as error:
            assert "\n" not in str(error)
            refused += 1
    assert refused > 75


def test_the_chunk_that_is_damaged_is_named(tmp_path: Path) -> None:
    path = recorded(tmp_path, 12_000)
    raw = bytearray(path.read_bytes())
    with path.open("rb") as file:
        second = reading.make_reader(file).get_summary().chunk_indexes[1]
    raw[second.chunk_start_offset + second.chunk_length - 3000] ^= 4
    path.write_bytes(raw)
    with pytest.raises(RecordingError) as caught:
        read(path)
    end = second.chunk_start_offset + second.chunk_length
    assert f"in chunk 2 of 2, which ends at byte {end}" in str(caught.value)


@pytest.mark.parametrize("chunks", [True, False])
def test_files_of_others_are_held_to_their_checksums(tmp_path: Path, chunks: bool) -> None:
    made = mcap(tmp_path, [("/wrist", 10**8 * i, wrench(10**8 * i, i)) for i in range(5)])
    path = tmp_path / "others.mcap"
    with path.open("wb") as file, rosbag2.Reader(made) as bag:
        writer = writing.Writer(file, use_chunking=chunks, enable_data_crcs=True)
        writer.start("ros2", "others")
        (link,) = bag.connections
        schema = writer.register_schema(link.msgtype, "ros2msg", link.msgdef.data.encode())
        channel = writer.register_channel("/wrist", "cdr", schema)
        for _, stamp, raw in bag.messages():
            writer.add_message(channel, stamp, raw, stamp)
        writer.finish()
    whole = path.read_bytes()
    assert [row[1] for row in read(path)] == [0.0, 1.0, 2.0, 3.0, 4.0]
    for at in (len(whole) // 4, len(whole) - 60):
        broken = bytearray(whole)
        broken[at] ^= 1
        path.write_bytes(broken)
        with pytest.raises(RecordingError, match=r"chunk 1 of 1|do(es)? not fit"):
            read(path)
    nothing = bytearray(whole)
    nothing[-12:-8] = bytes(4)  # no checksum of the index
    nothing[len(whole) - 60] ^= 1
    path.write_bytes(nothing)
    read(path)


def test_a_file_without_checksums_is_read(tmp_path: Path) -> None:
    assert (
        len(read(mcap(tmp_path, [("/wrist", 0, wrench()), ("/wrist", 10**8, wrench(10**8))]))) == 2
    )
