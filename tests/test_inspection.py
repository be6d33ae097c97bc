"""What a recording holds: topics, rates, frames, clocks, and what takes them."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import RecordingError
from contactfusion.inspect.inspection import (
    FrameInspection,
    Inspection,
    Jump,
    TopicInspection,
    as_json,
    as_text,
    inspect_recording,
)
from contactfusion.readings import ObjectPose
from contactfusion.recordings.mcap import McapWriter
from tests.first_bags import pressed
from tests.real_data import real_data
from tests.ros_bags import (
    EPOCH,
    FORMATS,
    SECOND,
    Said,
    image,
    joints,
    mcap,
    ros1,
    text,
    transforms,
    wrench,
)

Write = Callable[[Path, Sequence[Said]], Path]


def topics(path: Path) -> dict[str, TopicInspection]:
    return {topic.name: topic for topic in inspect_recording(path).topics}


@pytest.fixture(scope="module")
def pressing(tmp_path_factory: pytest.TempPathFactory) -> Inspection:
    return inspect_recording(mcap(tmp_path_factory.mktemp("bags"), pressed()))


@pytest.mark.parametrize("write", FORMATS.values(), ids=FORMATS)
def test_all_formats_of_ros_show_the_same(
    write: Write, pressing: Inspection, tmp_path: Path
) -> None:
    found = inspect_recording(write(tmp_path, pressed()))
    assert found.topics == pressing.topics and found.frames == pressing.frames
    assert (found.start_ns, found.problem) == (EPOCH, "")
    assert found.duration == pytest.approx(1.992)


def test_a_topic_has_its_rate_its_frame_and_its_delay(pressing: Inspection) -> None:
    (ft,) = (one for one in pressing.topics if one.name == "/ft/wrench")
    assert ft.type == "geometry_msgs/msg/WrenchStamped" and ft.messages == 200
    assert ft.rate == pytest.approx(100.0) and ft.frames == ("ft",)
    assert ft.delay == pytest.approx((0.002, 0.002)) and ft.jumps == ()


def test_a_topic_has_its_reading_its_sensor_and_who_takes_it(pressing: Inspection) -> None:
    uses = {one.sensor: (one.reading, one.use, one.generators) for one in pressing.topics}
    assert uses["ft/wrench"] == ("Wrench", "", ("force_torque",))
    assert uses["eye/points"][0] == "PointCloud" and "range" in uses["eye/points"][2]
    assert uses["joint_states"][:2] == ("JointState", "joints of the robot")
    assert uses["tf_static"] == ("Transform", "frames", ())


def test_frames_form_a_tree(pressing: Inspection) -> None:
    assert pressing.frames == (
        FrameInspection("eye", "base", static=True),
        FrameInspection("ft", "base", static=True),
    )
    assert pressing.ancestors("ft") == ("ft", "base") and pressing.ancestors("moon") == ("moon",)
    assert "  base\n    eye (static)\n    ft (static)" in as_text(pressing)


def test_frames_that_move_and_frames_that_circle_are_shown(tmp_path: Path) -> None:
    said = [("/tf", 0, transforms((0, "a", "b"), (0, "b", "a"))), ("/wrench", 0, wrench())]
    found = inspect_recording(mcap(tmp_path, said))
    assert [(one.name, one.static) for one in found.frames] == [("a", False), ("b", False)]
    assert found.ancestors("a") == ("a", "b")
    assert "frames that no transform names: wrist" in as_text(found)


def test_frames_that_circle_and_those_below_them_are_shown_once_and_begin_at_each_of_them() -> None:
    named = {"a": "b", "b": "c", "c": "a", "leaf": "a", "top": "base"}
    frames = tuple(FrameInspection(name, named[name], static=False) for name in sorted(named))
    shown = as_text(Inspection(Path("a.mcap"), 0, 0.0, (), frames)).splitlines()[2:]
    assert shown == [
        *("frames:", "  a", "    c", "      b", "    leaf"),
        *("  b", "  base", "    top", "  c"),
    ]


def test_of_a_long_chain_of_frames_the_deepest_are_counted() -> None:
    chain = [FrameInspection(f"f{i + 1}", f"f{i}", static=True) for i in range(20_000)]
    shown = as_text(Inspection(Path("a.mcap"), 0, 0.0, (), tuple(chain))).splitlines()
    assert shown[3] == "  f0" and shown[-2] == f"{200 * ' '}f99 (static)"
    assert shown[-1] == "frames below these, more than 100 deep: 19901"


def test_names_of_topics_and_frames_add_no_lines(tmp_path: Path) -> None:
    named = "a\nOK\n"
    said = [(f"/{named}", 0, wrench(frame=named)), ("/tf", 0, transforms((0, "base", named)))]
    found = inspect_recording(mcap(tmp_path, said))
    shown = as_text(found).splitlines()
    assert len(shown) == 7 and "OK" not in shown and "    a\\nOK\\n" in shown


def test_columns_are_filled_up_to_a_bounded_width() -> None:
    wide = TopicInspection("/wide", "", 1, frames=("f" * 10_000,))
    many = (TopicInspection(f"/{i}", "", 1) for i in range(100))
    assert len(as_text(Inspection(Path("a.mcap"), 0, 0.0, (wide, *many), ()))) < 150_000


def test_what_becomes_no_reading_is_listed_with_the_reason(tmp_path: Path) -> None:
    grey = image(0, "mono8", np.zeros((2, 2), np.uint8))
    path = mcap(tmp_path, [("/chat", 0, text()), ("/grey/image", 0, grey), ("/ft", 0, wrench())])
    found = topics(path)
    assert found["/chat"].unread == "no reading is made of this type"
    assert "no image of depth" in found["/grey/image"].unread
    assert found["/ft"].unread == "" and found["/grey/image"].reading == ""


def test_a_recording_of_which_nothing_can_be_read_is_shown_all_the_same(tmp_path: Path) -> None:
    path = mcap(tmp_path, [("/chat", 0, text()), ("/chat", SECOND, text())])
    (chat,) = inspect_recording(path).topics
    assert (chat.messages, chat.rate, chat.frames, chat.delay) == (2, 1.0, (), None)


def test_truth_and_what_contactfusion_wrote_are_no_sensors(tmp_path: Path) -> None:
    path = tmp_path / "made.mcap"
    pose = ObjectPose(
        stamp=0.0, frame="base", sensor="tracker", name="box", position=np.zeros(3),
        orientation=np.array([0.0, 0.0, 0.0, 1.0]),
    )  # fmt: skip
    with McapWriter(path, EPOCH) as writer:
        writer.reading(pose)
        writer.reading(pose, "truth")
        writer.text("/contactfusion/configuration", "{}")
    found = topics(path)
    assert found["/tracker/box"].sensor == "tracker"
    assert "truth" in found["/truth/tracker/box"].unread
    assert found["/contactfusion/configuration"].unread == "written by contactfusion"


@pytest.mark.parametrize("write", [mcap, ros1])
def test_a_clock_that_jumps_and_one_that_lies_far_off_are_remarked(
    write: Write, tmp_path: Path
) -> None:
    said: list[Said] = []
    for number in range(20):
        logged = number * SECOND // 10
        said.append(("/ft", logged, wrench(logged - (5 * SECOND if number >= 10 else 0))))
        said.append(("/old", logged, wrench(logged - 100 * SECOND)))
        said.append(("/unset", logged, wrench(-EPOCH)))
    found = inspect_recording(write(tmp_path, said))
    by_name = {topic.name: topic for topic in found.topics}
    assert by_name["/ft"].jumps == (Jump(at=1.0, by=-4.9),)
    assert by_name["/ft"].delay == (0.0, 5.0) and by_name["/ft"].rate == pytest.approx(10.0)
    assert by_name["/unset"].unstamped == 20 and by_name["/unset"].delay is None
    shown = as_text(found)
    assert "/ft: its clock jumps back by 4.900 s at 1.000 s" in shown
    assert "/old: its clock is 100.000 to 100.000 s behind the log" in shown
    assert "/unset: 20 headers without a stamp" in shown


def test_a_pause_is_no_jump(tmp_path: Path) -> None:
    said = [("/ft", stamp, wrench(stamp)) for stamp in (0, SECOND, 60 * SECOND)]
    assert topics(mcap(tmp_path, said))["/ft"].jumps == ()


def test_of_a_file_that_is_cut_off_the_whole_part_is_shown(tmp_path: Path) -> None:
    path = ros1(tmp_path, pressed(), size=2000)
    cut = tmp_path / "cut.bag"
    cut.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    found = inspect_recording(cut)
    assert 0 < sum(topic.messages for topic in found.topics) < 341
    assert "is cut off" in found.problem and "problem: " in as_text(found)


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.bag").write_text("no bag")
    with pytest.raises(RecordingError, match="can't be read"):
        inspect_recording(tmp_path / "a.bag")


def test_a_description_of_a_log_is_inspected_by_its_readings(tmp_path: Path) -> None:
    (tmp_path / "wrist.csv").write_text(
        "t,fx,fy,fz,tx,ty,tz\n" + "".join(f"{n / 10},0,0,1,0,0,0\n" for n in range(11))
    )
    (tmp_path / "log.yaml").write_text(
        "type: log\nfile: wrist.csv\ntime: {column: t}\nreadings:\n"
        "  wrist: {type: wrench, frame: tool, columns: [fx, fy, fz, tx, ty, tz]}\n"
    )
    found = inspect_recording(tmp_path / "log.yaml")
    (wrist,) = found.topics
    assert (wrist.sensor, wrist.reading, wrist.frames) == ("wrist", "Wrench", ("tool",))
    assert wrist.rate == pytest.approx(10.0) and found.duration == pytest.approx(1.0)


def test_a_description_of_a_bag_gives_its_sensors_their_names(tmp_path: Path) -> None:
    path = mcap(tmp_path, pressed())
    (tmp_path / "bag.yaml").write_text(f"type: ros\nfile: {path}\nsensors: {{wrist: /ft/wrench}}\n")
    found = {topic.name: topic for topic in inspect_recording(tmp_path / "bag.yaml").topics}
    assert found["/ft/wrench"].sensor == "wrist"
    assert found["/eye/points"].unread == "left out by `sensors`"


def test_json_has_the_names_of_the_attributes(pressing: Inspection) -> None:
    told: dict[str, Any] = json.loads(as_json(pressing))
    assert told["frames"][0] == {"name": "eye", "parent": "base", "static": True}
    assert told["topics"][1]["rate"] == pytest.approx(100.0)
    assert told["topics"][4]["delay"] is None


def test_joints_without_a_frame_are_shown_as_such(tmp_path: Path) -> None:
    path = mcap(tmp_path, [("/joint_states", 0, joints())])
    assert "(none)" in as_text(inspect_recording(path))


def test_force_plates_are_inspected() -> None:
    found = inspect_recording(real_data("force_plates/walk.c3d.zip"))
    plates = [topic for topic in found.topics if topic.generators == ("force_torque",)]
    assert [plate.rate for plate in plates] == pytest.approx([2000.0] * 4)
    assert found.ancestors("plate_3") == ("plate_3", "lab")
