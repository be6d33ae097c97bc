"""What the viewer writes, and that it can be shown; a file of rerun is read back with rerun."""

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import numpy as np
import pytest

from contactfusion import Fusion, Pipeline
from contactfusion.arrays import FloatArray
from contactfusion.controller import Command
from contactfusion.errors import ContactFusionError, DependencyError, WritingError
from contactfusion.frames import FrameTree, points_in, pose_at, pose_of
from contactfusion.pipeline import Step
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import (
    DepthImage,
    JointState,
    Markers,
    ObjectPose,
    Odometry,
    PointCloud,
    Reading,
    Switch,
    TactileImage,
    Twist,
    Wrench,
)
from contactfusion.readings.canvas import ramp
from contactfusion.view.layout import FIELD_OF_VIEW, Extent
from contactfusion.view.plot import plot_fusion
from contactfusion.view.recorder import ROBOT, VOXELS
from contactfusion.view.show import program, quiet_environment, screenshot, show
from contactfusion.view.viewer import Viewer
from tests.clouds import HERE, NULL, SUPPORT, THERE, cloud, fused
from tests.mcap_files import disk_of

rerun = pytest.importorskip("rerun")
from rerun.chunk import RrdReader  # noqa: E402 only where rerun is installed

PATCH = {"grid": {"rows": 2, "columns": 2, "pitch": [0.02, 0.02]}}
CONFIG: dict[str, Any] = {
    "generators": {
        "skin": {"type": "tactile", "sensor": "skin", "patch": PATCH, "baseline": {"noise": 0.1}}
    },
    "frames": {"skin": {"parent": "base", "xyz": [0.3, 0.0, 0.0]}, "eye": {"parent": "base"}},
    "surface": {"frame": "base", "shapes": [{"shape": "box", "size": [0.6, 0.4, 0.2]}]},
    "integrator": {"frame": "base", "voxel_size": 0.01},
    "cycle": {"every": 0.1},
}
QUATERNION = np.array([0.0, 0.0, 0.0, 1.0])


def readings() -> Iterator[Reading]:
    """A base that drives ahead at 1 m/s; one of four taxels is pressed from 0.5 s on."""
    for number in range(10):
        stamp = number / 10.0
        yield Odometry(
            stamp=stamp,
            frame="odom",
            child_frame="base",
            position=np.array([stamp, 0.0, 0.0]),
            orientation=QUATERNION,
        )
        pressed = np.array([0.0, 9.0 * (stamp >= 0.5), 0.0, 0.0])
        yield TactileImage(stamp=stamp, frame="skin", sensor="skin", values=pressed)


def recorded(path: Path, given: Iterator[Reading], **config: Any) -> list[Step]:
    """Write a file of a small pipeline; give its steps."""
    pipeline_config = PipelineConfig(**{**CONFIG, **config})
    pipeline, steps = Pipeline(pipeline_config), []

    def heard() -> Iterator[Reading]:
        for reading in given:
            viewer.reading(reading)
            yield reading

    with Viewer(pipeline_config, path) as viewer:
        for step in pipeline.run(heard()):
            viewer.step(step, pipeline.state(step.stamp))
            steps.append(step)
    return steps


class Contents:
    """What a file of rerun holds."""

    def __init__(self, path: Path) -> None:
        self.paths: set[str] = set()
        self._rows: dict[tuple[str, str], list[tuple[float, Any]]] = {}
        self.timelines: set[str] = set()
        for chunk in RrdReader(path).stream():
            self._add(chunk)

    def _add(self, chunk: Any) -> None:
        self.paths.add(chunk.entity_path)
        self.timelines |= set(chunk.timeline_names)
        batch = chunk.to_record_batch()
        columns = {name: batch.column(name) for name in batch.schema.names}
        stamps = [np.nan] * batch.num_rows
        if "time" in columns:
            stamps = [value.total_seconds() for value in columns["time"].to_pylist()]
        for name, column in columns.items():
            rows = self._rows.setdefault((chunk.entity_path, name), [])
            rows += [
                (stamp, value)
                for stamp, value in zip(stamps, column.to_pylist(), strict=True)
                if value is not None
            ]

    def rows(self, path: str, component: str) -> list[tuple[float, Any]]:
        """The values of a component with their stamps [s], in order."""
        return sorted(self._rows.get((path, component), []), key=lambda row: row[0])

    def values(self, path: str, component: str) -> list[Any]:
        return [value for _, value in self.rows(path, component)]

    def last(self, path: str, component: str) -> FloatArray:
        return np.array(self.values(path, component)[-1])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("viewing")


@pytest.fixture(scope="module")
def steps(folder: Path) -> list[Step]:
    return recorded(folder / "drive.rrd", readings())


@pytest.fixture(scope="module")
def drive(folder: Path, steps: list[Step]) -> Contents:
    return Contents(folder / "drive.rrd")


class TestTheFile:
    def test_it_holds_robot_sensors_space_and_time_lines(self, drive: Contents) -> None:
        assert drive.timelines == {"time"}
        assert {
            "/world/robot/base",
            "/world/sensors/skin",
            "/world/space/contacts",
            "/world/space/centres",
            "/world/space/voxels/contact",
            "/contacts/likelihood",
            "/shares/skin",
            "/ages/skin",
            "/rates/skin",
            "/states/skin",
            "/events/skin",
        } <= drive.paths

    def test_everything_stands_in_the_frame_of_the_odometry(self, drive: Contents) -> None:
        for path, x in (("robot/base", 0.9), ("space", 0.9), ("sensors/skin", 1.2)):
            place = drive.last(f"/world/{path}", "Transform3D:translation")
            np.testing.assert_allclose(place, [[x, 0.0, 0.0]], atol=1e-6)

    def test_contacts_are_ellipsoids_of_two_sigmas(
        self, drive: Contents, steps: list[Step]
    ) -> None:
        (contact,) = steps[-1].fusion.contacts
        path = "/world/space/contacts"
        np.testing.assert_allclose(
            drive.last(path, "Ellipsoids3D:centers"), [contact.position], atol=1e-6
        )
        x, y, z, w = drive.last(path, "Ellipsoids3D:quaternions")[0]
        assert np.linalg.norm([x, y, z, w]) == pytest.approx(1.0)
        turn = frame_of([x, y, z, w])
        half = drive.last(path, "Ellipsoids3D:half_sizes")[0] / 2.0
        np.testing.assert_allclose(turn @ np.diag(half**2) @ turn.T, contact.covariance, atol=1e-8)
        assert drive.values("/world/space/labels", "Points3D:labels")[-1] == ["0.99: skin 100%"]

    def test_nothing_is_drawn_before_the_first_contact(self, drive: Contents) -> None:
        stamps = [stamp for stamp, _ in drive.rows("/world/space/contacts", "Ellipsoids3D:centers")]
        assert stamps == pytest.approx([0.5, 0.6, 0.7, 0.8, 0.9])

    def test_the_contact_is_the_origin_of_the_near_view(self, drive: Contents) -> None:
        place = drive.last("/world/focus", "Transform3D:translation")
        np.testing.assert_allclose(place, [[1.2, 0.01, 0.0]], atol=1e-6)

    def test_before_the_first_contact_is_looked_at_where_it_will_be(self, drive: Contents) -> None:
        first, then, *_ = drive.rows("/world/focus", "Transform3D:translation")
        assert (first[0], then[0]) == pytest.approx((0.1, 0.6))
        np.testing.assert_allclose(first[1], [[0.8, 0.01, 0.0]], atol=1e-6)

    def test_time_lines_have_a_point_for_each_step(
        self, drive: Contents, steps: list[Step]
    ) -> None:
        counts = drive.rows("/contacts/count", "Scalars:scalars")
        assert [stamp for stamp, _ in counts] == pytest.approx([step.stamp for step in steps])
        assert [count for _, count in counts] == [[len(step.fusion.contacts)] for step in steps]
        assert drive.values("/shares/skin", "Scalars:scalars") == [[0.0]] * 4 + [[1.0]] * 5
        assert drive.values("/rates/skin", "Scalars:scalars")[-1] == [pytest.approx(10.0)]

    def test_the_taxel_that_is_pressed_glows(self, drive: Contents) -> None:
        heat = drive.values("/world/sensors/skin", "Boxes3D:colors")
        cold, hot = packed(ROBOT), packed(tuple(ramp(np.ones(1))[0]))
        assert heat == [[cold] * 4] * 4 + [[cold, hot, cold, cold]] * 5

    def test_the_same_steps_give_the_same_contents(
        self, folder: Path, drive: Contents, tmp_path: Path
    ) -> None:
        recorded(tmp_path / "drive.rrd", readings())
        files = [str(one / "drive.rrd") for one in (folder, tmp_path)]
        command = [program(), "rrd", "compare", "--unordered", *files]
        done = subprocess.run(command, env=quiet_environment(), capture_output=True, text=True)
        assert done.returncode == 0, done.stderr

    def test_it_is_written_whole_or_not_at_all(self, tmp_path: Path) -> None:
        (tmp_path / "old.rrd").write_text("an older file")
        with pytest.raises(ZeroDivisionError), Viewer(PipelineConfig(), tmp_path / "old.rrd"):
            raise ZeroDivisionError
        assert [file.name for file in tmp_path.iterdir()] == ["old.rrd"]
        assert (tmp_path / "old.rrd").read_text() == "an older file"

    def test_a_file_that_the_disk_has_no_room_for_is_an_error(
        self, tmp_path: Path, capfd: pytest.CaptureFixture[str]
    ) -> None:
        with pytest.raises(WritingError, match="a.rrd can't be written"), disk_of(3000):
            recorded(tmp_path / "a.rrd", readings())
        assert not list(tmp_path.iterdir())
        capfd.readouterr()

    def test_a_place_where_no_file_can_be_is_told(self, tmp_path: Path) -> None:
        (tmp_path / "taken").write_text("a file")
        with pytest.raises(ContactFusionError, match="taken cannot be made"):
            Viewer(PipelineConfig(), tmp_path / "taken" / "a.rrd")

    def test_what_the_viewer_shows_first_comes_with_it(self, folder: Path, drive: Contents) -> None:
        reader = RrdReader(folder / "drive.rrd")
        (entry,) = reader.blueprints()
        views = {
            value[0]
            for chunk in reader.stream(store=entry)
            for batch in [chunk.to_record_batch()]
            for name in batch.schema.names
            if name == "ViewBlueprint:class_identifier"
            for value in batch.column(name).to_pylist()
        }
        assert views == {"3D", "TimeSeries", "TextLog", "StateTimeline"}
        (recording,) = reader.recordings()
        assert (recording.application_id, recording.recording_id) == ("contactfusion", "drive")


@pytest.fixture(scope="module")
def seen(folder: Path) -> Contents:
    """Every kind of reading, in the frame `eye` 1 m above the base."""
    place: dict[str, Any] = {"stamp": 0.0, "frame": "eye"}
    turned = np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    depth = np.array([[2.0, np.nan], [0.0, 4.0]])
    given: list[Reading] = [
        PointCloud(**place, sensor="lidar", points=np.array([[1.0, 2.0, 3.0], [np.nan] * 3])),
        DepthImage(**place, sensor="camera", depth=depth, intrinsics=np.eye(3)),
        Wrench(
            **place,
            sensor="wrist",
            force=np.array([0.0, 0.0, -20.0]),
            torque=np.array([1.0, 0.0, 0.0]),
        ),
        Switch(**place, sensor="bumper", closed=True),
        Markers(**place, names=("a", "b"), positions=np.array([[np.nan] * 3, [1.0, 0.0, 0.0]])),
        ObjectPose(**place, name="box", position=np.array([1.0, 0.0, 0.0]), orientation=turned),
        PointCloud(stamp=0.0, frame="moon", sensor="far", points=np.zeros((1, 3))),
        TactileImage(stamp=0.0, frame="eye", sensor="glove", values=np.zeros(5)),
        Wrench(stamp=1.0, frame="eye", force=np.zeros(3), torque=np.zeros(3)),
    ]
    frames = {"eye": {"parent": "base", "xyz": [0.0, 0.0, 1.0]}}
    recorded(folder / "seen.rrd", iter(given), generators={}, frames=frames)
    return Contents(folder / "seen.rrd")


class TestSensors:
    def test_each_is_placed_by_its_frame(self, seen: Contents) -> None:
        for name in ("lidar", "camera", "wrist", "bumper", "eye"):
            place = seen.last(f"/world/sensors/{name}", "Transform3D:translation")
            np.testing.assert_array_equal(place, [[0.0, 0.0, 1.0]])

    def test_points_that_are_no_returns_are_left_out(self, seen: Contents) -> None:
        assert seen.values("/world/sensors/lidar", "Points3D:positions") == [[[1.0, 2.0, 3.0]]]
        assert seen.values("/world/sensors/eye", "Points3D:labels") == [["b"]]

    def test_a_depth_image_is_drawn_as_image_and_as_points(self, seen: Contents) -> None:
        points = seen.values("/world/sensors/camera", "Points3D:positions")
        assert points == [[[0.0, 0.0, 2.0], [4.0, 4.0, 4.0]]]
        (image,) = seen.values("/world/sensors/camera/image", "DepthImage:buffer")
        millimetres = np.frombuffer(bytes(image[0]), np.uint16)
        assert millimetres.tolist() == [2000, 0, 0, 4000]
        assert seen.values("/world/sensors/camera/image", "Pinhole:resolution") == [[[2.0, 2.0]]]

    def test_a_wrench_is_two_arrows(self, seen: Contents) -> None:
        # arrows are at most 0.32 m long: 10 cm are 7 N, as 6 N would be too few, or 0.4 N·m
        for kind, arrow in (("force", [0.0, 0.0, -2.0 / 7.0]), ("torque", [0.25, 0.0, 0.0])):
            (vectors,) = seen.values(f"/world/sensors/wrist/{kind}", "Arrows3D:vectors")
            np.testing.assert_allclose(vectors, [arrow], atol=1e-6)
            (origins,) = seen.values(f"/world/sensors/wrist/{kind}", "Arrows3D:origins")
            assert origins == [[0.0, 0.0, 0.0]]

    def test_an_object_stands_where_it_is_said_to_be(self, seen: Contents) -> None:
        place = seen.last("/world/objects/box", "Transform3D:translation")
        np.testing.assert_allclose(place, [[1.0, 0.0, 1.0]])
        assert seen.values("/world/objects/box/name", "Points3D:labels") == [["box"]]

    def test_what_cannot_be_drawn_is_told(self, seen: Contents) -> None:
        far, glove = sorted(text for (text,) in seen.values("/events/viewer", "TextLog:text"))
        assert far.startswith("0.00 s: PointCloud of 'far' is not drawn: unknown frame 'moon': ")
        assert glove == (
            "0.00 s: TactileImage of 'glove' is not drawn: no patch says where its taxels are"
        )

    def test_a_reading_waits_for_the_step_that_is_not_before_it(self, tmp_path: Path) -> None:
        pipeline = Pipeline(config := PipelineConfig())
        with Viewer(config, tmp_path / "late.rrd") as viewer:
            for stamp in (0.0, 0.2):
                viewer.reading(
                    PointCloud(stamp=stamp, frame="base", points=np.array([[stamp, 0.0, 0.0]]))
                )
            for now in (0.1, 0.3):
                viewer.step(pipeline.step(now), pipeline.state(now))
        points = Contents(tmp_path / "late.rrd").rows("/world/sensors/base", "Points3D:positions")
        assert [stamp for stamp, _ in points] == pytest.approx([0.0, 0.2])


def frame_of(quaternion: list[float]) -> FloatArray:
    from scipy.spatial.transform import Rotation

    matrix: FloatArray = Rotation.from_quat(quaternion).as_matrix()
    return matrix


def packed(colour: tuple[int, ...]) -> int:
    red, green, blue = (int(value) for value in colour)
    return red << 24 | green << 16 | blue << 8 | 255


def drawn(path: Path, fusion: Fusion, command: Command | None = None) -> Contents:
    """Draw one step."""
    pipeline = Pipeline(config := PipelineConfig())
    with Viewer(config, path) as viewer:
        viewer.step(Step(0.0, fusion, command), pipeline.state(0.0))
        viewer.step(Step(1.0, fused(), None), pipeline.state(1.0))
    return Contents(path)


class TestBeliefs:
    def test_voxels_are_told_apart_by_verdict(self, tmp_path: Path) -> None:
        fusion = fused(
            cloud("skin", 0.0, {HERE: 0.9, (1, 0, 0): 0.05}),
            cloud("motion", 0.0, {THERE: 0.5}, SUPPORT),
            cloud("free", 0.0, {(9, 0, 0): 1.0}, NULL),
            rule="de_morgan",
        )
        seen = drawn(tmp_path / "a.rrd", fusion)
        for verdict, x in (
            ("contact", 0.0025),
            ("below_threshold", 0.0075),
            ("support_only", 0.2025),
            ("nulled", 0.0475),
        ):
            path = f"/world/space/voxels/{verdict}"
            first, last = seen.values(path, "Boxes3D:centers")
            np.testing.assert_allclose(first, [[x, 0.0025, 0.0025]], atol=1e-6)
            assert last == []

    def test_the_likelier_a_voxel_the_less_is_seen_through_it(self, tmp_path: Path) -> None:
        fusion = fused(cloud("skin", 0.0, {HERE: 0.9, (1, 0, 0): 0.3}), rule="de_morgan")
        colours = drawn(tmp_path / "a.rrd", fusion).values(
            "/world/space/voxels/contact", "Boxes3D:colors"
        )[0]
        likely, unlikely = (colour & 255 for colour in colours)
        assert 255 > likely > unlikely + 30 > 60
        assert {colour >> 8 for colour in colours} == {packed(VOXELS["contact"]) >> 8}

    def test_the_unlikely_is_as_bright_as_the_likely_is_not(self) -> None:
        brightness = ramp(np.linspace(0.0, 1.0, 11)).astype(float) @ [0.2, 0.7, 0.1]
        assert brightness[0] > 80.0
        assert (np.diff(brightness) > 0.0).all()

    def test_a_contact_that_is_gone_is_drawn_no_more(self, tmp_path: Path) -> None:
        seen = drawn(tmp_path / "a.rrd", fused(cloud("skin", 0.0, {HERE: 0.9})))
        first, last = seen.values("/world/space/contacts", "Ellipsoids3D:half_sizes")
        assert (len(first), len(last)) == (1, 0)

    @pytest.mark.parametrize("newtons", [1e-3, 1.0, 1000.0])
    def test_a_force_ends_at_its_contact_and_is_well_seen(
        self, tmp_path: Path, newtons: float
    ) -> None:
        force = newtons * np.array([[0.0, 3.0, 4.0]])
        fusion = fused(cloud("skin", 0.0, {HERE: 0.9}, forces=force))
        seen = drawn(tmp_path / "a.rrd", fusion)
        vectors, gone = seen.values("/world/space/forces", "Arrows3D:vectors")
        origins, _ = seen.values("/world/space/forces", "Arrows3D:origins")
        assert gone == []
        # 5 N are at most 32 voxels long, so that 10 cm are 4 N at least
        np.testing.assert_allclose(vectors, [[0.0, 0.075, 0.1]], atol=1e-6)
        tip = np.add(origins, vectors)
        np.testing.assert_allclose(tip, [fusion.contacts[0].position], atol=1e-6)
        told = f"0.90, {5.0 * newtons:.3g} N: skin 100%"
        assert seen.values("/world/space/labels", "Points3D:labels")[0] == [told]

    def test_a_command_is_an_arrow_with_its_reason(self, tmp_path: Path) -> None:
        twist = Twist(
            stamp=0.0, frame="base", linear=np.array([0.1, 0.0, 0.0]), angular=np.zeros(3)
        )
        command = Command(twist=twist, mode="push", reason="0.5 m to go")
        seen = drawn(tmp_path / "a.rrd", fused(), command)
        reason = "/world/command/reason"
        assert seen.values(reason, "Points3D:labels")[0] == ["push: 0.5 m to go"]
        (arrow,) = seen.values("/world/command/arrows", "Arrows3D:vectors")[0]
        np.testing.assert_allclose(arrow, [0.2, 0.0, 0.0], atol=1e-6)
        assert seen.values("/states/controller", "StateChange:state") == [["push"]]
        assert seen.values("/events/controller", "TextLog:text") == [["0.00 s: push: 0.5 m to go"]]


def test_the_modes_of_a_controller_have_colours_that_stay(tmp_path: Path) -> None:
    config = PipelineConfig()
    pipeline = Pipeline(config)
    with Viewer(config, tmp_path / "a.rrd") as viewer:
        for stamp, mode in enumerate(["push", "", "push", "back"]):
            command = Command(mode=mode)
            viewer.step(Step(float(stamp), fused(), command), pipeline.state(float(stamp)))
    seen = Contents(tmp_path / "a.rrd")
    modes = seen.values("/states/controller", "StateConfiguration:values")
    colours = seen.values("/states/controller", "StateConfiguration:colors")
    assert modes[-1] == ["push", "no mode", "back"]
    assert all(colours[-1][: len(earlier)] == earlier for earlier in colours)
    assert len(set(colours[-1])) == 3


def test_a_command_starts_above_the_robot(tmp_path: Path) -> None:
    ahead = Twist(stamp=0.0, frame="base", linear=np.array([0.1, 0.0, 0.0]), angular=np.zeros(3))
    config = PipelineConfig(**CONFIG)
    pipeline = Pipeline(config)
    with Viewer(config, tmp_path / "a.rrd") as viewer:
        viewer.step(Step(0.0, fused(), Command(twist=ahead)), pipeline.state(0.0))
    seen = Contents(tmp_path / "a.rrd")
    (origins,) = seen.values("/world/command/arrows", "Arrows3D:origins")
    np.testing.assert_allclose(origins, [[0.0, 0.0, 0.1]], atol=1e-3)


class TestExtent:
    BODY = np.array([[x, y, z] for x in (-0.4, 0.4) for y in (-0.3, 0.3) for z in (0.0, 0.4)])
    NOTHING = np.empty((0, 3))

    def seen_from(self, extent: Extent, points: FloatArray, aspect: float) -> FloatArray:
        """Give how far from the middle points are in the picture; at its edges are -1 and 1."""
        eye = extent.scene_view
        right = np.cross([0.0, 0.0, 1.0], eye)
        right /= np.linalg.norm(right)
        axes = np.stack([right, np.cross(eye, right), eye])
        across, up, towards = axes @ (points - np.mean(extent.box, axis=0)).T
        depth = np.tan(FIELD_OF_VIEW / 2.0) * (extent.distance(aspect) - towards)
        picture: FloatArray = np.stack([across / depth / aspect, up / depth], axis=1)
        return picture

    @pytest.mark.parametrize("far", [1.0, 10.0, 1000.0])
    def test_far_points_make_room_around_a_robot_that_stays_well_seen(self, far: float) -> None:
        extent = Extent()
        ring = far * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
        extent.include(self.BODY, self.NOTHING, ring, np.eye(4))
        picture = self.seen_from(extent, self.BODY, 1.2)
        assert 0.3 < abs(picture).max() < 0.7

    def test_contacts_lie_within_the_picture(self) -> None:
        extent = Extent()
        contacts = np.array([[2.0, 1.0, 0.3], [0.4, 0.0, 0.2]])
        extent.include(self.BODY, contacts, self.NOTHING, np.eye(4))
        assert abs(self.seen_from(extent, contacts, 2.2)).max() < 1.0

    def test_what_is_seen_without_a_robot_is_looked_at_where_most_of_it_is(self) -> None:
        extent = Extent()
        seen = np.concatenate([np.random.default_rng(1).normal(5.0, 0.1, (99, 3)), [[900.0] * 3]])
        extent.include(self.NOTHING, self.NOTHING, seen, np.eye(4))
        np.testing.assert_allclose(np.mean(extent.box, axis=0), 5.0, atol=0.1)
        assert extent.distance(1.0) < 2.0

    def test_a_contact_is_seen_from_where_it_is_on_the_robot_however_that_turns(self) -> None:
        eyes = []
        for turned in np.radians([0.0, 180.0]):
            extent = Extent()
            pose = pose_at([0.0, 0.0, 0.0], [0.0, 0.0, turned])
            contacts = points_in(pose, np.array([[0.4, 0.0, 0.2]]))
            extent.include(points_in(pose, self.BODY), contacts, self.NOTHING, pose)
            eyes.append((extent.contact_view, extent.scene_view))
        np.testing.assert_allclose(eyes[0][0], eyes[1][0], atol=1e-9)
        np.testing.assert_allclose(eyes[0][1][:2], -eyes[1][1][:2], atol=1e-9)


def test_the_links_of_a_robot_are_drawn_once_and_moved_by_its_joints(tmp_path: Path) -> None:
    fields: dict[str, Any] = {"robot": "contactfusion.robots:arm_hand.yaml"}
    config = PipelineConfig(**fields)
    pipeline = Pipeline(config)
    assert pipeline.state(0.0).robot is None
    with Viewer(config, tmp_path / "arm.rrd") as viewer:
        viewer.step(pipeline.step(0.0), pipeline.state(0.0))
        for stamp, turned in ((0.1, 0.0), (0.2, 0.5)):
            pipeline.receive(joints(config, stamp, turned))
            viewer.step(pipeline.step(stamp), pipeline.state(stamp))
    seen, robot = Contents(tmp_path / "arm.rrd"), pipeline.state(0.2).robot
    assert robot is not None
    meshes = seen.rows("/world/robot/palm", "Mesh3D:vertex_positions")
    assert [stamp for stamp, _ in meshes] == pytest.approx([0.1])  # before, nobody knows where
    place = seen.rows("/world/robot/palm", "Transform3D:translation")
    assert [stamp for stamp, _ in place] == pytest.approx([0.1, 0.2])
    np.testing.assert_allclose(place[-1][1], [robot.poses["palm"][:3, 3]], atol=1e-6)


def joints(config: PipelineConfig, stamp: float, turned: float) -> JointState:
    from contactfusion.robots.model import shared_robot

    assert config.robot is not None
    names = shared_robot(config.robot).joint_names
    positions = np.full(len(names), turned)
    return JointState(stamp=stamp, frame="base", names=names, positions=positions)


def test_the_root_of_a_frame_is_the_one_at_the_top() -> None:
    tree = FrameTree({"a": ("b", pose_of([1.0, 0.0, 0.0])), "b": ("c", np.eye(4))})
    assert [tree.root(name) for name in "abcd"] == ["c", "c", "c", "d"]


class TestShowing:
    def test_nothing_is_reported_and_nothing_written_at_home(
        self, folder: Path, drive: Contents, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("HOME", str(tmp_path))
        monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
        for name in ("XDG_CONFIG_HOME", "XDG_DATA_HOME", "CI"):
            monkeypatch.delenv(name, raising=False)
        command = [program(), "rrd", "stats", str(folder / "drive.rrd")]
        subprocess.run(command, env=quiet_environment(), check=True, capture_output=True)
        assert list(tmp_path.rglob("*")) == []

    def test_without_a_screen_the_ways_out_are_named(
        self, folder: Path, drive: Contents, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("sys.platform", "linux")
        for name in ("DISPLAY", "WAYLAND_DISPLAY"):
            monkeypatch.delenv(name, raising=False)
        with pytest.raises(ContactFusionError, match="no screen .*--web.*--screenshot"):
            show(folder / "drive.rrd")

    def test_a_file_that_is_none_or_cut_off_is_told(
        self, folder: Path, drive: Contents, tmp_path: Path
    ) -> None:
        whole = (folder / "drive.rrd").read_bytes()
        (tmp_path / "cut.rrd").write_bytes(whole[: len(whole) // 2])
        (tmp_path / "text.rrd").write_text("no recording")
        for name in ("cut.rrd", "text.rrd"):
            for look in (show, lambda file: screenshot(file, tmp_path / "a.png")):
                with pytest.raises(ContactFusionError, match=f"{name} is no recording"):
                    look(tmp_path / name)
        with pytest.raises(ContactFusionError, match="did you mean 'text.rrd'"):
            show(tmp_path / "txt.rrd")

    def test_without_rerun_the_extra_is_named(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        for name in ("rerun", "rerun_cli"):
            monkeypatch.setitem(sys.modules, name, None)
        with pytest.raises(DependencyError, match=r"pip install 'contactfusion\[view\]'"):
            Viewer(PipelineConfig(), tmp_path / "a.rrd")
        with pytest.raises(DependencyError, match="rerun-sdk is not installed"):
            program()
        assert list(tmp_path.iterdir()) == []

    def test_a_browser_on_this_machine_may_ask_this_machine_only(
        self, folder: Path, drive: Contents
    ) -> None:
        # whoever runs tests in the background has Ctrl+C ignored, and children inherit that
        code = "import signal, sys, pathlib; from contactfusion.view.show import serve; "
        code += "signal.signal(signal.SIGINT, signal.default_int_handler); "
        code += "serve(pathlib.Path(sys.argv[1]))"
        with subprocess.Popen(
            [sys.executable, "-c", code, str(folder / "drive.rrd")],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        ) as server:
            try:
                assert server.stdout is not None
                address = server.stdout.readline().split()[1]
                with pytest.raises(HTTPError) as refused:
                    urlopen(Request(address, headers={"Host": "evil.example:80"}))
                assert refused.value.code == 403
                refused.value.close()
                assert address.startswith("http://127.0.0.1:") and address.endswith("&theme=dark")
                with answered(address) as page:
                    assert b"Rerun Viewer" in page.read()
                    policy = page.headers["Content-Security-Policy"]
                assert "connect-src 'self' data: blob: http://127.0.0.1:*" in policy
                with pytest.raises(ConnectionRefusedError):
                    socket.create_connection((outside(), int(address.split(":")[2].split("/")[0])))
            finally:
                server.send_signal(2)  # as Ctrl+C does
        assert server.returncode == 0


def answered(address: str) -> Any:
    """Ask until somebody answers."""
    for _ in range(100):
        try:
            return urlopen(address)
        except HTTPError:
            time.sleep(0.2)
    raise TimeoutError(address)


def outside() -> str:
    """Give an address of this machine under which others reach it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends nothing
        except OSError:
            pytest.skip("this machine is on no network")
        return str(probe.getsockname()[0])


def drivers() -> bool:
    """Tell whether a Vulkan driver is installed."""
    folders = [Path(f"{top}/vulkan/icd.d") for top in ("/usr/share", "/etc", "/usr/local/share")]
    return any(file for folder in folders if folder.is_dir() for file in folder.glob("*.json"))


class TestPictures:
    @pytest.mark.skipif(not drivers(), reason="no Vulkan driver: apt install mesa-vulkan-drivers")
    def test_a_picture_shows_the_contact(
        self, folder: Path, drive: Contents, tmp_path: Path
    ) -> None:
        from matplotlib.image import imread

        greens = []
        for name, at in (("before", 0.2), ("last", None)):
            screenshot(folder / "drive.rrd", tmp_path / f"{name}.png", at)
            pixels = imread(tmp_path / f"{name}.png")[:, :900, :3]
            assert pixels.shape[0] == 900
            green = (abs(pixels - np.array([60, 255, 150]) / 255.0) < 0.1).all(axis=2)
            greens.append(int(green.sum()))
        assert greens[0] < 20 < 100 < greens[1]
        assert sorted(file.name for file in tmp_path.iterdir()) == ["before.png", "last.png"]

    def test_without_a_driver_the_packages_are_named(
        self, folder: Path, drive: Contents, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        if not sys.platform.startswith("linux"):
            pytest.skip("only on Linux are drivers found by these names")
        for name in ("VK_ICD_FILENAMES", "VK_DRIVER_FILES"):
            monkeypatch.setenv(name, str(tmp_path / "none"))
        with pytest.raises(ContactFusionError, match="apt install mesa-vulkan-drivers libvulkan1"):
            screenshot(folder / "drive.rrd", tmp_path / "a.png")
        assert list(tmp_path.iterdir()) == []


class TestPlot:
    def test_a_step_is_plotted_by_source_and_by_verdict_along_each_axis(self) -> None:
        fusion = fused(
            cloud("skin", 0.0, {HERE: 0.9, (1, 0, 0): 0.9, (2, 0, 0): 0.9}),
            cloud("motion", 0.0, {THERE: 0.5}, SUPPORT),
            cloud("wrist", 0.0, {}),
        )
        figure = plot_fusion(fusion)
        labels = [(axes.get_xlabel()[0], axes.get_ylabel()[0]) for axes in figure.axes]
        assert labels == [("x", "y"), ("x", "y"), ("x", "z"), ("y", "z")]
        sources, verdicts = (axes.get_legend_handles_labels()[1] for axes in figure.axes[:2])
        assert sources == ["motion (support)", "skin (regular)"]
        assert verdicts == ["contact", "support only", "contact 1: 0.90"]
        ellipse: Any = figure.axes[1].patches[0]
        (contact,) = fusion.contacts
        x, y = contact.position[:2] * 1000.0
        assert ellipse.get_center() == pytest.approx((x, y))
        sigmas = np.sqrt(np.linalg.eigvalsh(contact.covariance[:2, :2])) * 1000.0
        assert (ellipse.width, ellipse.height) == pytest.approx(tuple(4.0 * sigmas))

    def test_the_first_view_is_along_the_thinnest_axis(self) -> None:
        figure = plot_fusion(fused(cloud("skin", 0.0, {HERE: 0.9, (0, 9, 0): 0.9, (0, 0, 9): 0.9})))
        assert [axes.get_xlabel()[0] for axes in figure.axes] == ["y", "y", "x", "x"]

    def test_a_step_without_anything_is_plotted(self) -> None:
        assert len(plot_fusion(fused()).axes) == 4

    def test_no_window_is_opened(self) -> None:
        import matplotlib.pyplot as plt

        plot_fusion(fused(cloud("skin", 0.0, {HERE: 0.9})))
        assert plt.get_fignums() == []
