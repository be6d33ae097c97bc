"""A stranger's kind of reading takes part everywhere, by its entry point alone."""

import json
import os
import re

import pytest

from tests.strangers import EXAMPLES, Stranger

pytest.importorskip("rosbags")

BAG = """
import sys, numpy as np, contactfusion as cf
from pathlib import Path
from contactfusion_microphones import Sound

positions = np.array([[0.1, 0.0, 0.0], [0.0, 0.1, 0.0]])
with cf.McapWriter(Path(sys.argv[1]), 10**18) as writer:
    for number in range(10):
        levels = np.array([0.0, 4.0 * (number >= 5)])
        at = {"stamp": number / 10, "frame": "shell", "sensor": "array"}
        writer.reading(Sound(levels=levels, positions=positions, **at))
"""
ROS1 = """
import sys
from pathlib import Path
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from contactfusion_microphones import SoundCodec

KIND, TEXT = SoundCodec.messages[0], SoundCodec.definition
there, here = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS1_NOETIC)
for store in (there, here):
    store.register(get_types_from_msg(TEXT, KIND))
from contactfusion.recordings.ros.files import Bag
with Writer(Path(sys.argv[2])) as writer, Bag(Path(sys.argv[1])) as bag:
    mine = writer.add_connection("/array", KIND, typestore=here)
    for channel, stamp, raw in bag.messages(bag.channels):
        one = there.deserialize_cdr(raw, KIND)
        head = here.types["std_msgs/msg/Header"](seq=7, stamp=one.header.stamp, frame_id="shell")
        one = here.types[KIND](header=head, levels=one.levels, positions=one.positions)
        writer.write(mine, stamp, here.serialize_ros1(one, KIND))
"""
CONFIGURATION = """
generators: {shell: {type: tap}}
frames: {shell: {parent: base, xyz: [0.0, 0.0, 0.5]}}
integrator: {frame: base, voxel_size: 0.01}
cycle: {on: sound}
"""
LOG = """
recording:
  type: log
  file: levels.csv
  time: {column: t}
  readings:
    array:
      type: sound
      frame: shell
      columns: [a, b]
      positions: [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0]]
"""
SEEN = """
import json, sys
from rerun.chunk import RrdReader

found = {}
for chunk in RrdReader(sys.argv[1]).stream():
    batch = chunk.to_record_batch()
    for name in ("Points3D:positions", "Arrows3D:vectors", "TextLog:text"):
        if name in batch.schema.names:
            values = [one for one in batch.column(name).to_pylist() if one]
            found.setdefault(chunk.entity_path + " " + name, []).extend(values)
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def stranger(tmp_path_factory: pytest.TempPathFactory) -> Stranger:
    stranger = Stranger(EXAMPLES / "microphones", tmp_path_factory.mktemp("stranger"))
    (stranger.source / "contactfusion_microphones.py").unlink()  # the installed one is used
    stranger.run("-c", BAG, "taps.mcap")
    (stranger.source / "tap.yaml").write_text(CONFIGURATION)
    return stranger


def contacts(stranger: Stranger, *arguments: str) -> list[dict[str, str]]:
    """The contacts of a replay of the bag."""
    out = "contacts.csv"
    stranger.command("replay", "tap.yaml", *(arguments or ("taps.mcap",)), "--out", out)
    head, *rows = (stranger.source / out).read_text().splitlines()
    return [dict(zip(head.split(","), row.split(","), strict=True)) for row in rows]


def test_its_own_tests_pass(stranger: Stranger) -> None:
    assert "2 passed" in stranger.run("-m", "pytest", "-q", "-c", os.devnull, "test_microphones.py")


def test_it_is_listed_described_and_checked(stranger: Stranger) -> None:
    listed = " ".join(stranger.command("plugins", "--strict").split())
    assert "sound reading Sound pressure at the microphones of an array." in listed
    assert "contactfusion-microphones 0.1.0" in listed and "cannot be used" not in listed
    described = stranger.command("plugins", "sound")
    assert "sound (reading): Sound pressure at the microphones" in described
    assert "microphone_msgs/msg/Sound" in described and "float64[] levels" in described
    assert re.search(r"positions +required +Of the microphones", described)


def test_it_replays_from_a_bag_and_a_cycle_steps_on_it(stranger: Stranger) -> None:
    rows = contacts(stranger)
    assert [float(row["stamp"]) for row in rows] == [0.6, 0.7, 0.8, 0.9]
    assert [float(rows[0][axis]) for axis in "xyz"] == pytest.approx([0.0, 0.1, 0.5], abs=0.01)
    assert "Sound" in stranger.command("inspect", "taps.mcap")


def test_it_replays_from_a_bag_of_ros_1(stranger: Stranger) -> None:
    stranger.run("-c", ROS1, "taps.mcap", "taps.bag")
    assert contacts(stranger, "taps.bag") == contacts(stranger)


def test_a_fault_breaks_it_by_its_name(stranger: Stranger) -> None:
    silenced = "faults=[{fault: zeros, sensor: sound, elements: [1], start: 0.75}]"
    rows = contacts(stranger, "taps.mcap", "--set", silenced)
    assert [float(row["stamp"]) for row in rows] == [0.6, 0.7]


def test_it_is_read_from_a_log(stranger: Stranger) -> None:
    (stranger.source / "levels.csv").write_text("t,a,b\n0.0,0,0\n0.1,0,4\n0.2,0,4\n")
    (stranger.source / "log.yaml").write_text(CONFIGURATION + LOG)
    stranger.command("run", "log.yaml", "--out", "results")
    summary = json.loads((stranger.source / "results" / "summary.json").read_text())
    assert (summary["steps"], summary["contacts"]) == (3, 1)


def test_it_is_recorded_and_drawn(stranger: Stranger) -> None:
    pytest.importorskip("rerun")
    stranger.command("replay", "tap.yaml", "taps.mcap", "--out", "replay.mcap")
    assert "/array" in stranger.command("inspect", "replay.mcap")
    stranger.command("view", "replay.mcap", "--save", "taps.rrd")
    seen = json.loads(stranger.run("-c", SEEN, "taps.rrd"))
    assert len(seen["/world/sensors/array Points3D:positions"][-1]) == 2
    ((x, y, z),) = seen["/world/sensors/array/loudest Arrows3D:vectors"][-1]
    assert y > 0.01 and x == z == 0.0
    assert "/events/viewer TextLog:text" not in seen
