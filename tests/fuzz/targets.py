"""The targets: what is mutated, and the reader that takes it."""

import io
import json
import shutil
import zipfile
from collections.abc import Callable, Sequence
from contextlib import closing
from functools import cache
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from contactfusion import Pipeline, PipelineConfig
from contactfusion.changes import USES, Change
from contactfusion.check import check_file
from contactfusion.errors import ContactFusionError
from contactfusion.generators.networks import read_networks, shipped
from contactfusion.readings.messages import header
from contactfusion.readings.registry import installed_kinds
from contactfusion.recordings.mcap import McapWriter
from contactfusion.recordings.messages import defined, typestore
from contactfusion.recordings.opening import open_recording
from contactfusion.recordings.ros.topics import Topic, listeners
from contactfusion.run.asking import Source
from tests import ros_bags
from tests.ros_bags import EPOCH, Said, camera_info, image, joints, text, transforms, wrench
from tests.test_recordings_c3d import c3d_file
from tests.test_recordings_icub import frame, trial
from tests.urdfs import joint, link

MOST = 20_000
"""The number of readings that are read of an input."""
EXAMPLES = Path("examples")


class Target(NamedTuple):
    """What is mutated, and what reads it.

    Attributes:
        bases: files to mutate, made in a folder.
        read: takes the mutated content and a folder of its own; a `ContactFusionError` is an
            answer, any other error is a finding.
        text: whether it is text.
    """

    bases: Callable[[Path], Sequence[bytes]]
    read: Callable[[bytes, Path], object]
    text: bool = False


def played(path: Path) -> None:
    """Read a recording to its end, as it is and message by message."""
    recording = open_recording(path)
    for _ in islice(recording.readings(), MOST):
        pass
    if recording.has_messages:
        with McapWriter(path.with_name("copy.mcap")) as writer:
            part = recording.part({}, tap=writer.copy)
            for _ in islice(part.readings(), MOST):
                pass


def file_named(name: str, then: Callable[[Path], object] = played) -> Any:
    """What reads a file of this name."""

    def read(content: bytes, folder: Path) -> None:
        (folder / name).write_bytes(content)
        then(folder / name)

    return read


def said() -> list[Said]:
    """Messages of several kinds."""
    messages: list[Any] = []
    for number in range(4):
        after = number * 10**8
        pixels = np.full((3, 4), 500 + number, np.uint16)
        messages += [
            ("/wrist", after, wrench(after, number)),
            ("/joints", after, joints(after)),
            ("/tf", after, transforms((after, "base", "wrist"))),
            ("/text", after, text()),
            ("/camera/depth", after, image(after, "16UC1", pixels)),
            ("/camera/camera_info", after, camera_info(after, (3, 4))),
        ]
    return messages


def bag(kind: str) -> Callable[[Path], Sequence[bytes]]:
    def bases(folder: Path) -> Sequence[bytes]:
        write: Any = ros_bags.FORMATS[kind]
        made = write(folder / kind, said())
        plain = [made.read_bytes()]
        if kind == "ros1":
            plain.append(write(folder / "small", said(), size=300).read_bytes())
        return plain

    return bases


def sqlite_folders(folder: Path) -> Sequence[bytes]:
    """The metadata of rosbag2; the data stay as they are."""
    made = ros_bags.sqlite_folder(folder / "db", said())
    return [(made / "metadata.yaml").read_bytes()]


def read_sqlite_folder(content: bytes, folder: Path) -> None:
    shutil.copytree(_made_sqlite(), folder / "made")
    (folder / "made" / "metadata.yaml").write_bytes(content)
    played(folder / "made")


@cache
def _made_sqlite() -> Path:
    held = TemporaryDirectory()
    HELD.append(held)
    return ros_bags.sqlite_folder(Path(held.name), said())


HELD: list[TemporaryDirectory[str]] = []


def own_mcap(folder: Path) -> Sequence[bytes]:
    """Ours, and one without chunks by the mcap library."""
    from mcap.writer import Writer

    path = folder / "bare.mcap"
    with path.open("wb") as file:
        writer: Any = Writer(file, use_chunking=False)
        writer.start("ros2", "fuzz")
        schema = writer.register_schema(WRENCH, "ros2msg", defined(WRENCH).encode())
        channel = writer.register_channel("/wrist", "cdr", schema)
        for number in range(3):
            raw = bytes(typestore().serialize_cdr(wrench(number * 10**8), WRENCH))
            writer.add_message(channel, EPOCH + number * 10**8, raw, EPOCH)
        writer.finish()
    return [*bag("mcap")(folder), path.read_bytes()]


WRENCH = "geometry_msgs/msg/WrenchStamped"
CSV_YAML = """type: log
file: log.csv
time: {column: 1}
readings:
  wrist: {type: wrench, frame: wrist, columns: [2, 3, 4, 5, 6, 7]}
"""


def csvs(folder: Path) -> Sequence[bytes]:
    rows = [f"{number * 0.01:.2f},1,2,3,{number},5,6" for number in range(30)]
    quoted = [f'"{number * 0.01:.2f}";1;2.5;-3e0;;5;6;' for number in range(30)]
    return [
        "\n".join(["t,fx,fy,fz,tx,ty,tz", *rows, ""]).encode(),
        "\n".join(["# of a wrist", *quoted, ""]).encode(),
        "\n".join(row.replace(",", " ") for row in rows).encode(),
    ]


def read_csv(content: bytes, folder: Path) -> None:
    (folder / "log.csv").write_bytes(content)
    (folder / "log.yaml").write_text(CSV_YAML)
    played(folder / "log.yaml")


def arrays(folder: Path) -> Sequence[bytes]:
    """Parts of an .npz: the archive is made of them anew, so that its checksums fit."""
    table = np.arange(70.0).reshape(10, 7) / 100.0
    whole = []
    for array in (table, table.astype(">f4")):
        file = io.BytesIO()
        np.save(file, array)
        whole.append(file.getvalue())
    return whole


def read_arrays(content: bytes, folder: Path) -> None:
    (folder / "log.npy").write_bytes(content)
    (folder / "log.yaml").write_text(CSV_YAML.replace("log.csv", "log.npy"))
    with zipfile.ZipFile(folder / "log.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("t.npy", content)
    (folder / "zip.yaml").write_text(
        "type: log\nfile: log.npz\ntime: {rate: 10}\n"
        "readings: {skin: {type: tactile_image, frame: a, columns: [t]}}\n"
    )
    answered(lambda: played(folder / "zip.yaml"))
    played(folder / "log.yaml")


def archives(folder: Path) -> Sequence[bytes]:
    np.savez(folder / "a.npz", t=np.arange(10.0), v=np.arange(60.0).reshape(10, 6))
    np.savez_compressed(folder / "b.npz", t=np.arange(10.0), v=np.arange(60.0).reshape(10, 6))
    return [(folder / name).read_bytes() for name in ("a.npz", "b.npz")]


def read_archive(content: bytes, folder: Path) -> None:
    (folder / "log.npz").write_bytes(content)
    (folder / "log.yaml").write_text(
        "type: log\nfile: log.npz\ntime: {column: t}\n"
        "readings: {wrist: {type: wrench, frame: wrist, columns: [v]}}\n"
    )
    played(folder / "log.yaml")


def answered(call: Callable[[], object]) -> None:
    """Call something that may answer with a sentence."""
    try:
        call()
    except ContactFusionError:
        return


def definitions(folder: Path) -> Sequence[bytes]:
    """Definitions in .msg and .idl."""
    names = (WRENCH, "sensor_msgs/msg/PointCloud2", "visualization_msgs/msg/MarkerArray")
    idl = """module a { module msg {
      module B_Constants { const double N = -1.5e-3; const string S = "(a|b)*"; };
      typedef double double__36[36];
      enum E { A, B };
      @verbatim (language="comment", text="x << y")
      struct B { @default (value=1) octet w; double__36 covariance; sequence<octet, 5> v; };
    }; };"""
    return [*(defined(name).encode() for name in names), idl.encode()]


def read_definition(content: bytes, folder: Path) -> None:
    from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

    from contactfusion.recordings.messages import type_hash
    from contactfusion.recordings.ros.channels import _cdr_of_ros1, ros2_text, types_in

    words = content.decode(errors="replace")
    raw = bytes(typestore().cdr_to_ros1(typestore().serialize_cdr(wrench(), WRENCH), WRENCH))
    for form in (MessageDefinitionFormat.MSG, MessageDefinitionFormat.IDL):
        definition = MessageDefinition(form, words)
        name = WRENCH if form == MessageDefinitionFormat.MSG else "a/msg/B"
        answered(lambda d=definition, n=name: types_in(d, n))  # type: ignore[misc]
        ros2_text(definition, name, ros1=True)
        try:
            _cdr_of_ros1(raw, definition, name, standard=False)
        except Exception as error:  # as its caller does
            assert not isinstance(error, MemoryError)
    answered(lambda: type_hash(WRENCH, words))


def examples(*names: str) -> Callable[[Path], Sequence[bytes]]:
    return lambda folder: [(EXAMPLES / name).read_bytes() for name in names]


def configurations(folder: Path) -> Sequence[bytes]:
    """The smaller of the examples that name no files, and a robot's."""
    return [PROBE_YAML.encode(), *(path.read_bytes() for path in sorted(EXAMPLES.glob("*/*.yaml")))]


PROBE_YAML = """
frames: {wrist: {parent: probe, xyz: [0, 0, 0.1], rpy: [0, 0, 0]}}
generators:
  wrist: {type: force_torque, sensor: wrist, min_force: 0.3, sign: on_robot}
surface: {frame: probe, shapes: [{shape: sphere, radius: 0.02}]}
integrator: {frame: probe, voxel_size: 0.005, threshold: 0.5}
cycle: {every: 0.1}
faults: [{fault: silent, sensor: wrist, start: 1.0}]
recording: {type: log, file: log.csv, time: {column: t}, readings: {
  wrist: {type: wrench, frame: probe, columns: [fx, fy, fz, tx, ty, tz]}}}
"""


def read_configuration(content: bytes, folder: Path) -> None:
    (folder / "log.csv").write_bytes(csvs(folder)[0])
    (folder / "robot.yaml").write_bytes(content)
    check_file(folder / "robot.yaml")


def kept(folder: Path) -> Sequence[bytes]:
    """The text that a run keeps in its MCAP."""
    configuration = {
        "generators": {"wrist": {"type": "force_torque", "sensor": "wrist", "sign": "on_robot"}},
        "frames": {"wrist": {"parent": "base", "xyz": [0, 0, 0.1]}},
        "surface": {"frame": "base", "shapes": [{"shape": "sphere", "radius": 0.1}]},
        "integrator": {"frame": "base"},
        "cycle": {"every": 0.1},
    }
    whole = {"configuration": configuration, "topics": {"wrist": "/wrench"}, "folder": "."}
    return [json.dumps(whole, indent=1).encode()]


def read_kept(content: bytes, folder: Path) -> None:
    from contactfusion.run.configuration import TOPIC

    path = folder / "out.mcap"
    with McapWriter(path, EPOCH) as writer:
        writer.text(TOPIC, content.decode(errors="replace"))
        for codec in installed_kinds().all():
            if codec.name == "wrench":
                writer.reading(codec.example(0.1, 1.0))
    with closing(Source(path).session()) as session:
        for _ in islice(session.steps(), 20):
            pass


def urdfs(folder: Path) -> Sequence[bytes]:
    elements = (
        link("base", '<box size="0.1 0.2 0.3"/>', 1.0), link("arm", '<sphere radius="0.1"/>', 1.0),
        link("tip", '<cylinder radius="0.05" length="0.1"/>'),
        joint("shoulder", "base", "arm"), joint("wrist", "arm", "tip", "fixed", ""),
    )  # fmt: skip
    return [f'<robot name="robot">{"".join(elements)}</robot>'.encode()]


def read_urdf(content: bytes, folder: Path) -> None:
    from contactfusion.robots.description import RobotConfig
    from contactfusion.robots.model import RobotModel

    path = folder / "robot.urdf"
    path.write_bytes(content)
    model = RobotModel(RobotConfig(urdf=str(path), spacing=0.02))
    _ = model.parts


STL = b"solid a\n" + b"".join(
    b"facet normal 0 0 1\nouter loop\n" + b"".join(b"vertex %g %g %g\n" % tuple(at) for at in t)
    + b"endloop\nendfacet\n"
    for t in np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [0, 0, 1], [0, 1, 0]],
                       [[0, 0, 0], [1, 0, 0], [0, 0, 1]], [[0, 0, 1], [1, 0, 0], [0, 1, 0]]]) * 0.1
) + b"endsolid a\n"  # fmt: skip
OBJ = b"v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 2 3\nf 1 2 4\nf 1 4 3\nf 4 2 3\n"
PLY = b"""ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
0 0 0
0.1 0 0
0 0.1 0
0 0 0.1
3 0 1 2
3 0 1 3
3 0 3 2
3 3 1 2
"""
OFF = b"OFF\n4 4 0\n0 0 0\n.1 0 0\n0 0.1 0\n0 0 0.1\n3 0 1 2\n3 0 1 3\n3 0 3 2\n3 3 1 2\n"


def meshes(folder: Path) -> Sequence[bytes]:
    """The suffix stands in the first line."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "<f4") * 0.1
    facets = b"".join(
        np.zeros(3, "<f4").tobytes() + corners[list(rows)].tobytes() + b"\0\0"
        for rows in ((0, 1, 2), (0, 1, 3), (0, 3, 2), (3, 1, 2))
    )
    binary = bytes(80) + b"\4\0\0\0" + facets
    kinds = {"stl": (STL, binary), "obj": (OBJ,), "ply": (PLY,), "off": (OFF,)}
    return [b"%s\n%s" % (kind.encode(), held) for kind, group in kinds.items() for held in group]


def read_mesh(content: bytes, folder: Path) -> None:
    suffix, _, held = content.partition(b"\n")
    name = f"mesh.{suffix.decode()}" if suffix.isalpha() and len(suffix) < 5 else "mesh.stl"
    (folder / name).write_bytes(held)
    whole = f'<robot name="r">{link("base", f"<mesh filename={chr(34)}{name}{chr(34)}/>")}</robot>'
    read_urdf(whole.encode(), folder)


def cards(folder: Path) -> Sequence[bytes]:
    return [shipped("contact").with_suffix(".json").read_bytes()]


def read_card(content: bytes, folder: Path) -> None:
    shutil.copy(shipped("contact"), folder / "net.safetensors")
    (folder / "net.json").write_bytes(content)
    read_networks(folder / "net.safetensors")


def weights(folder: Path) -> Sequence[bytes]:
    return [shipped("contact").read_bytes()]


def read_weights(content: bytes, folder: Path) -> None:
    import hashlib

    card = json.loads(shipped("contact").with_suffix(".json").read_text())
    card["weights_sha256"] = hashlib.sha256(content).hexdigest()
    (folder / "net.json").write_text(json.dumps(card))
    (folder / "net.safetensors").write_bytes(content)
    read_networks(folder / "net.safetensors")


@cache
def examples_of_kinds() -> dict[str, list[bytes]]:
    """By the type of messages: the CDR of an example of each kind of reading."""
    found: dict[str, list[bytes]] = {}
    for codec in installed_kinds().all():
        if codec.messages:
            reading = codec.example(0.1, 1.0)
            for _, sent in codec.postings(reading, "/a", header(EPOCH, reading.frame)):
                cdr = bytes(typestore().serialize_cdr(sent, sent.__msgtype__))
                found.setdefault(sent.__msgtype__, []).append(cdr)
    return found


def messages_of_kinds(folder: Path) -> Sequence[bytes]:
    """The type stands in the first line."""
    return [
        msgtype.encode() + b"\n" + cdr
        for msgtype, group in examples_of_kinds().items()
        for cdr in group
    ]


def read_message(content: bytes, folder: Path) -> None:
    """Read one message, as bags and `live` do: what rosbags refuses is counted there."""
    from contactfusion.recordings.ros.delivery import Delivery
    from contactfusion.recordings.ros.order import Sorter, TopicState, TopicTally

    kind, _, cdr = content.partition(b"\n")
    msgtype = kind.decode(errors="replace")
    codec = installed_kinds().by_message().get(msgtype)
    if codec is None:
        return
    try:
        message_ = typestore().deserialize_cdr(memoryview(cdr), msgtype)
    except Exception:  # as its callers do
        return
    topic = Topic("/a/depth", msgtype, 1, codec.kind, 1)
    (listener,) = listeners({"a": ("/a/depth",)}, {"/a/depth": topic}).values()
    state = TopicState("/a/depth", listener, TopicTally(), {})
    delivery = Delivery(probe(), EPOCH)
    for reading in delivery.of(state, message_, EPOCH):
        probe().take(reading)
    sorter = Sorter(EPOCH, EPOCH)
    for part in listener.parts(message_):
        answered(lambda p=part: sorter.put(state, p, EPOCH))  # type: ignore[misc]
    for stamp, _, _, part in sorter.rest():
        answered(lambda p=part, s=stamp: listener.reading(p, (s - EPOCH) / 1e9))  # type: ignore[misc]


@cache
def probe() -> Pipeline:
    import yaml

    fields = yaml.safe_load(PROBE_YAML)
    return Pipeline(PipelineConfig(**{k: v for k, v in fields.items() if k != "recording"}))


def orders(folder: Path) -> Sequence[bytes]:
    return [
        b"threshold 0.6", b"plug wrist min_force=2", b"plug other type=force_torque sensor=a",
        b"unplug wrist", b"tare wrist", b"restart wrist", b"answer wrist 1",
        b"plug wrist shapes.0.radius=0.1 frames=[1,2]",
    ]  # fmt: skip


def read_order(content: bytes, folder: Path) -> None:
    words = content.decode(errors="replace")
    if words.strip().startswith("isolate") or "isolate" in words:
        return  # a process each
    change = Change(words)
    change.carry_out(probe())
    if "wrist" not in probe().generators:
        Change("plug wrist").carry_out(probe())
    change.outcome.result(0.0)
    assert words.split()[0].strip("'\"") in USES


def ouster(folder: Path) -> Sequence[bytes]:
    """Metadata of a sensor; the packets are noise."""
    fields = {
        "prod_line": "OS-0-32", "prod_pn": "840-101396-03", "prod_sn": "1", "image_rev": "v2.2.0",
        "format": {"pixels_per_column": 32, "columns_per_frame": 1024, "columns_per_packet": 16,
                   "column_window": [0, 1023], "pixel_shift_by_row": [0] * 32,
                   "udp_profile_lidar": "LEGACY", "fps": 10},
        "beam_altitude_angles": [0.0] * 32, "beam_azimuth_angles": [0.0] * 32,
        "lidar_mode": "1024x10", "lidar_origin_to_beam_origin_mm": 27.67,
        "imu_to_sensor_transform": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
        "lidar_to_sensor_transform": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
        "udp_port_imu": 7503, "udp_port_lidar": 7502,
    }  # fmt: skip
    return [json.dumps(fields, indent=1).encode()]


PCAP = bytes.fromhex("d4c3b2a1020004000000000000000000ffff000001000000")


def read_ouster(content: bytes, folder: Path) -> None:
    (folder / "scan.json").write_bytes(content)
    (folder / "scan.pcap").write_bytes(PCAP)
    played(folder / "scan.pcap")


TARGETS: dict[str, Target] = {
    "rosbag1": Target(bag("ros1"), file_named("made.bag")),
    "sqlite": Target(bag("sqlite"), file_named("made.db3")),
    "metadata": Target(sqlite_folders, read_sqlite_folder, text=True),
    "mcap": Target(own_mcap, file_named("made.mcap")),
    "csv": Target(csvs, read_csv, text=True),
    "npy": Target(arrays, read_arrays),
    "npz": Target(archives, read_archive),
    "icub": Target(
        lambda folder: [trial(folder, *frame(0.0), *frame(1.0)).read_bytes()],
        file_named("none_1.txt"),
        text=True,
    ),
    "c3d": Target(lambda folder: [c3d_file(folder).read_bytes()], file_named("walk.c3d")),
    "definition": Target(definitions, read_definition, text=True),
    "configuration": Target(configurations, read_configuration, text=True),
    "kept": Target(kept, read_kept, text=True),
    "urdf": Target(urdfs, read_urdf, text=True),
    "mesh": Target(meshes, read_mesh, text=True),
    "card": Target(cards, read_card, text=True),
    "weights": Target(weights, read_weights),
    "cdr": Target(messages_of_kinds, read_message),
    "order": Target(orders, read_order, text=True),
    "ouster": Target(ouster, read_ouster, text=True),
}
