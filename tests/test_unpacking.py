"""Files that promise or unpack to more than there is memory: one sentence, and no memory taken."""

import bz2
import json
import struct
import sys
import zipfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from subprocess import PIPE, Popen
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactfusion.errors import RecordingError
from contactfusion.readings import Wrench
from contactfusion.readings.depth_image import depth_of
from contactfusion.readings.messages import message
from contactfusion.readings.point_cloud import points_of
from contactfusion.recordings import ouster_converter
from contactfusion.recordings.messages import typestore
from contactfusion.recordings.opening import open_recording
from contactfusion.recordings.ros.readers import bound_rosbags
from contactfusion.recordings.tables import read_columns
from contactfusion.unpacking import SMALL, TIMES, Unpacker, most_bytes, unpacked
from tests.ros_bags import image, rosbag1, rosbag2, top, wrench
from tests.test_recordings_c3d import c3d_file

lz4 = pytest.importorskip("lz4.frame")
zstd: Any = pytest.importorskip("rosbags.rosbag2.storage_mcap").zstd
ROOM = 2**28 + 2**26
"""A process that reads may take so much more than it has when its libraries are there [bytes]."""
PIECE = bytes(10**7)
PIECES = 40
"""So many zeros are packed as often: more than `ROOM`."""
READ = """
import json, resource, sys
from pathlib import Path
import ezc3d
from contactfusion.files import read_arrays
from contactfusion.recordings.messages import typestore
from contactfusion.recordings.opening import open_recording
from contactfusion.recordings.ros.readers import bound_rosbags
from contactfusion.recordings.tables import read_columns
typestore(), bound_rosbags()
taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (taken + {room}, -1))
for line in sys.stdin:
    path, said = Path(line.rstrip()), ""
    try:
        if path.suffix == ".npz":
            read_arrays(path)
        elif path.suffix == ".npy":
            read_columns(path, [1])
        else:
            for reading in open_recording(path).readings():
                said = repr(reading)
    except Exception as error:
        said = f"{{type(error).__name__}}: {{error}}"
    print(json.dumps(said), flush=True)
"""
Told = Callable[[Path], str]


@pytest.fixture(scope="module")
def told() -> Iterator[Told]:
    """What a process that may take no more memory than `ROOM` says of a file."""
    command = [sys.executable, "-c", READ.format(room=ROOM)]
    with Popen(command, stdin=PIPE, stdout=PIPE, text=True) as reader:
        pipes = reader.stdin, reader.stdout

        def ask(path: Path) -> str:
            into, out = pipes
            assert into and out
            print(path, file=into, flush=True)
            sentence: str = json.loads(out.readline())
            assert "\n" not in sentence
            return sentence

        yield ask


# What is packed


@cache
def bomb(kind: str) -> bytes:
    """More zeros than a process may take, in few bytes."""
    makers = {"bz2": bz2.BZ2Compressor, "lz4": lz4.LZ4FrameCompressor, "zstd": zstd.ZstdCompressor}
    packer = makers[kind]()
    begun = packer.begin() if kind == "lz4" else b""
    return b"".join([begun, *(packer.compress(PIECE) for _ in range(PIECES)), packer.flush()])


PACKERS: dict[str, tuple[Callable[[bytes], bytes], Callable[[], Unpacker]]] = {
    "bz2": (bz2.compress, bz2.BZ2Decompressor),
    "lz4": (lz4.compress, lz4.LZ4FrameDecompressor),
    "zstd": (zstd.compress, zstd.ZstdDecompressor),
}


@pytest.mark.parametrize("kind", PACKERS)
@given(contents=st.lists(st.binary(min_size=1, max_size=300), min_size=1, max_size=3))
def test_what_was_packed_is_unpacked_in_one_stream_or_several(
    kind: str, contents: list[bytes]
) -> None:
    pack, unpacker = PACKERS[kind]
    packed = b"".join(map(pack, contents))
    whole = b"".join(contents)
    assert unpacked(packed, unpacker) == unpacked(packed, unpacker, len(whole)) == whole
    with pytest.raises(ValueError, match=f"unpack to more than the {len(whole) - 1} stated"):
        unpacked(packed, unpacker, len(whole) - 1)
    with pytest.raises(ValueError, match="cut off"):
        unpacked(packed[:-1], unpacker)


@pytest.mark.parametrize("kind", PACKERS)
def test_what_is_large_is_unpacked_piece_by_piece(kind: str) -> None:
    pack, unpacker = PACKERS[kind]
    content = np.random.default_rng(0).bytes(10_000) + bytes(9_000_000)
    assert unpacked(pack(content), unpacker) == content


def test_what_is_small_may_unpack_to_anything_and_what_is_large_to_so_many_times() -> None:
    assert most_bytes(1) == SMALL == most_bytes(SMALL // TIMES)
    assert most_bytes(SMALL) == TIMES * SMALL
    assert unpacked(b"", bz2.BZ2Decompressor) == b""


@pytest.mark.parametrize(
    ("header", "reason"),
    [
        ("{" + "(" * 100, "the header of it is damaged"),
        *(
            (
                f"{{'descr': '<f8', 'fortran_order': False, 'shape': (0, {length})}}",
                f"it promises an axis of {length} numbers",
            )
            for length in (10**20, -(10**20))
        ),
    ],
    ids=["brackets", "long", "negative"],
)
def test_a_header_that_numpy_fails_on_is_a_sentence(
    tmp_path: Path, header: str, reason: str
) -> None:
    path = tmp_path / "log.npy"
    path.write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode())
    with pytest.raises(RecordingError, match=f"log.npy is cut off, or .*: {reason}"):
        read_columns(path, [1])


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def mcap(folder: Path, chunk: bytes) -> Path:
    """Write an MCAP file of one record of the number of chunks."""
    magic = b"\x89MCAP0\r\n"
    header = text("ros2") + text("")
    footer = struct.pack("<BQQQI", 2, 20, 0, 0, 0)
    path = folder / "drive.mcap"
    path.write_bytes(
        magic + struct.pack("<BQ", 1, len(header)) + header + b"\x06" + chunk + footer + magic
    )
    return path


def chunk(kind: str, packed: bytes, size: int) -> bytes:
    content = struct.pack("<QQQI", 0, 1, size, 0) + text(kind)
    content += struct.pack("<Q", len(packed)) + packed
    return struct.pack("<Q", len(content)) + content


@pytest.mark.parametrize("size", [len(PIECE) * PIECES, 100])
@pytest.mark.parametrize("kind", ["lz4", "zstd"])
def test_a_chunk_of_mcap_that_unpacks_to_too_much_is_refused(
    kind: str, size: int, tmp_path: Path, told: Told
) -> None:
    said = told(mcap(tmp_path, chunk(kind, bomb(kind), size)))
    assert said.startswith("RecordingError") and "drive.mcap can't be read: " in said
    many = f"would unpack to {size}, more than {TIMES} times as many"
    assert said.endswith(many if size > 100 else "unpack to more than the 100 stated")


def test_a_record_of_mcap_that_is_longer_than_any_memory_is_refused(
    tmp_path: Path, told: Told
) -> None:
    said = told(mcap(tmp_path, struct.pack("<Q", 2**40)))
    assert said.startswith("RecordingError") and "can't be read: it promises more than" in said


@pytest.mark.parametrize("kind", ["bz2", "lz4"])
def test_a_chunk_of_a_ros_1_bag_that_unpacks_to_too_much_is_refused(kind: str) -> None:
    bound_rosbags()
    with pytest.raises(ValueError, match=f"unpack to over {SMALL}, more than {TIMES} times"):
        rosbag1.reader.decompressors[kind](bomb(kind))


def packed_rosbag2(folder: Path, mode: str, content: bytes | None = None) -> Path:
    """Write a rosbag2 of one wrench, or of content that is packed already."""
    kind, plugin = "geometry_msgs/msg/WrenchStamped", rosbag2.StoragePlugin.SQLITE3
    bag = rosbag2.Writer(folder, version=8, storage_plugin=plugin)
    if content is None:
        bag.set_compression(rosbag2.CompressionMode[mode], rosbag2.CompressionFormat.ZSTD)
    with bag:
        channel = bag.add_connection("/wrist", kind, typestore=typestore())
        bag.write(channel, 1, content or typestore().serialize_cdr(wrench(), kind))
    return folder


def test_a_rosbag2_is_read_as_it_was_packed(tmp_path: Path) -> None:
    for mode in ("FILE", "MESSAGE"):
        (one,) = open_recording(packed_rosbag2(tmp_path / mode, mode)).readings()
        assert isinstance(one, Wrench) and one.force[0] == 1.0


def test_a_packed_file_of_a_rosbag2_may_be_refused(tmp_path: Path, told: Told) -> None:
    folder = packed_rosbag2(tmp_path / "made", "FILE")
    (folder / "made.db3.zstd").write_bytes(bomb("zstd"))
    assert told(folder).endswith("can't be read: a packed file unpacks to too much")


def test_a_packed_message_of_a_rosbag2_may_be_refused(tmp_path: Path, told: Told) -> None:
    folder = packed_rosbag2(tmp_path / "made", "MESSAGE", bomb("zstd"))
    description = folder / "metadata.yaml"
    tells = description.read_text().replace("compression_format: ''", "compression_format: zstd")
    description.write_text(tells.replace("compression_mode: ''", "compression_mode: message"))
    assert f"more than {TIMES} times as many" in told(folder)


def zip_of(path: Path, name: str, head: bytes = b"") -> Path:
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open(name, "w", force_zip64=True) as member,
    ):
        member.write(head)
        for _ in range(PIECES):
            member.write(PIECE)
    return path


def test_a_packed_c3d_that_unpacks_to_too_much_is_refused(tmp_path: Path, told: Told) -> None:
    said = told(zip_of(tmp_path / "walk.c3d.zip", "walk.c3d"))
    assert "walk.c3d.zip can't be unpacked: " in said and said.endswith("times as many")


# What is promised


def array_header(*shape: int) -> bytes:
    """Write how an `.npy` begins."""
    said = str({"descr": "<f8", "fortran_order": False, "shape": shape}).encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(said)) + said


def test_a_packed_array_that_unpacks_to_too_much_is_refused(tmp_path: Path, told: Told) -> None:
    head = array_header(PIECES * len(PIECE) // 8)
    said = told(zip_of(tmp_path / "map.npz", "values.npy", head))
    assert said.startswith("ConfigurationError") and said.endswith("times as many")


@pytest.mark.parametrize("shape", [(10**12, 3), (10**8, 3), (2,)])
def test_an_array_that_promises_more_than_it_holds_is_refused(
    shape: tuple[int, ...], tmp_path: Path, told: Told
) -> None:
    content = array_header(*shape) + bytes(8)
    (tmp_path / "log.npy").write_bytes(content)
    with zipfile.ZipFile(tmp_path / "map.npz", "w") as archive:
        archive.writestr("values.npy", content)
    what = f"promises {' x '.join(map(str, shape))} of float64, that is {8 * np.prod(shape)} bytes"
    assert told(tmp_path / "log.npy").endswith(f"it {what}, and holds 8")
    assert told(tmp_path / "map.npz").endswith(f"'values' {what}, and holds 8")


@pytest.mark.parametrize("offset", [2, 4])
def test_a_c3d_that_promises_endless_points_or_values_is_refused(
    offset: int, tmp_path: Path, told: Told
) -> None:
    path = c3d_file(tmp_path)
    content = bytearray(path.read_bytes())
    struct.pack_into("<H", content, offset, 65535)
    struct.pack_into("<HH", content, 6, 1, 65535)
    path.write_bytes(content)
    assert told(path).endswith("walk.c3d is cut off: it holds 5 of 65535 frames")


HUGE = 2**32 - 1


def cloud(**told: int) -> Any:
    fields = [
        message("sensor_msgs/PointField", name=name, offset=4 * i, datatype=7, count=1)
        for i, name in enumerate("xyz")
    ]
    whole = {"height": 1, "width": 1, "point_step": 12, "row_step": 12, **told}
    return message(
        "sensor_msgs/PointCloud2", header=top(), fields=fields, is_bigendian=False,
        data=np.zeros(12, np.uint8), is_dense=True, **whole,
    )  # fmt: skip


@pytest.mark.parametrize(
    "sizes",
    [
        {"width": HUGE},
        {"height": HUGE},
        {"height": HUGE, "width": HUGE, "row_step": 0, "point_step": 0},
        {"height": HUGE, "width": HUGE, "row_step": HUGE, "point_step": HUGE},
        {"width": HUGE, "point_step": 0},
        {"height": HUGE, "row_step": 0},
    ],
)
def test_a_cloud_holds_as_many_points_as_it_has_bytes_for(sizes: dict[str, int]) -> None:
    with pytest.raises(RecordingError, match="the bytes of the cloud are no "):
        points_of(cloud(**sizes))


@pytest.mark.parametrize("height, width", [(HUGE, 1), (1, HUGE), (HUGE, HUGE)])
@pytest.mark.parametrize("step", [0, 4, HUGE])
def test_an_image_holds_as_many_pixels_as_it_has_bytes_for(
    height: int, width: int, step: int
) -> None:
    one = image(0, "32FC1", np.zeros((1, 1), np.float32))
    one.height, one.width, one.step = height, width, step
    with pytest.raises(RecordingError, match=f"its 4 bytes are no {height} rows of {width} pix"):
        depth_of(one)


def test_a_message_that_promises_more_than_it_holds_is_counted_and_takes_no_memory(
    tmp_path: Path, told: Told
) -> None:
    kind = "contactfusion_msgs/msg/TactileImage"
    one = message(kind.replace("/msg/", "/"), header=top(), values=np.zeros(2))
    raw = bytearray(typestore().serialize_cdr(one, kind))
    at = raw.index(struct.pack("<I", 2), 20)
    struct.pack_into("<I", raw, at, HUGE)
    plugin = rosbag2.StoragePlugin.MCAP
    with rosbag2.Writer(tmp_path / "made", version=8, storage_plugin=plugin) as bag:
        channel = bag.add_connection("/skin", kind, typestore=typestore())
        bag.write(channel, 1, bytes(raw))
    assert told(tmp_path / "made") == ""


def test_a_sensor_of_ouster_with_endless_pixels_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    form = SimpleNamespace(pixels_per_column=128, columns_per_frame=2**20)
    recording = SimpleNamespace(sensor_info=[SimpleNamespace(format=form)])
    sdk, core = ModuleType("ouster.sdk"), ModuleType("ouster.sdk.core")
    monkeypatch.setattr(sdk, "open_source", lambda *_, **__: recording, raising=False)
    monkeypatch.setattr(core, "XYZLut", None, raising=False)
    for module in (ModuleType("ouster"), sdk, core):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    (tmp_path / "scan.osf").touch()
    with pytest.raises(ouster_converter.ConversionError, match="128 rings and 1048576 columns"):
        ouster_converter.convert(tmp_path / "scan.osf", tmp_path / "scan.mcap")


KIND = "geometry_msgs/msg/WrenchStamped"


def test_yaml_in_recordings_is_bounded(tmp_path: Path) -> None:
    made = tmp_path / "drive"
    with rosbag2.Writer(made, version=8, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
        link = writer.add_connection("/wrist", KIND, typestore=typestore())
        writer.storage.channels[0] = writer.storage.channels[0]._replace(
            metadata=text("offered_qos_profiles") + text("[" * 100_000)
        )
        writer.write(link, 10**18, typestore().serialize_cdr(wrench(), KIND))
    assert len(list(open_recording(made / "drive.mcap").readings())) == 1
    with (made / "metadata.yaml").open("a") as file:
        file.write("".join(f"k{number}: [1, 2]\n" for number in range(50_000)))
    assert len(list(open_recording(made).readings())) == 1
