"""Contacts that a LiDAR sees, by networks whose weights the tests write."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import Grid, Pipeline, State
from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, FrameError
from contactfusion.frames import FrameTree, Pose, inverse, points_in, pose_at
from contactfusion.generators.lidar_cpm import LidarCpmGenerator
from contactfusion.generators.lidar_rule import LidarRuleConfig, LidarRuleGenerator
from contactfusion.generators.networks import GAP, ContactNetworks, LearnedConfig, Perception
from contactfusion.generators.proximity import ProximityConfig
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import PointCloud
from tests.test_networks import Tensors, some_card, some_weights, write

SIDE = 0.0125
POSE: Pose = pose_at((0.295, 0.0, 0.80), (-np.pi / 2.0, np.pi / 2.0, 0.0))
"""Of the LiDAR in the base's frame."""
ROOT = Path(__file__).parents[1]
STATE = State(now=0.0, grid=Grid("base", SIDE), frames=FrameTree({"lidar": ("base", POSE)}))
NOTHING = np.empty((0, 3))
EMPTY = ProximityConfig().empty


def says(
    none: float = 0.0, point: float = 0.0, line: float = 0.0, lateral: float = 0.05
) -> Tensors:
    """Give networks that always say the same: logits of the type, and a place [m]."""
    weights = {name: np.zeros_like(tensor) for name, tensor in some_weights().items()}
    weights["type.readout.bias"] = np.array([none, point, line], np.float32)
    weights["location.readout.bias"] = np.array([(lateral + 0.25) / 0.6], np.float32)
    return weights


def generator(folder: Path, weights: Tensors, **options: Any) -> LidarCpmGenerator:
    return LidarCpmGenerator("eye", LearnedConfig(weights=write(folder, weights), **options))


def wall(near: float = 0.305, sides: tuple[float, float] = (-0.19, 0.19)) -> FloatArray:
    """Points of a face in the base's frame; it reaches into strips 2 to 9 of 12."""
    y, z = np.meshgrid(np.linspace(*sides, 41), np.linspace(0.0, 0.3, 7))
    return np.stack([np.full(y.size, near), y.ravel(), z.ravel()], axis=1)


def scan(points: FloatArray, stamp: float = 0.0, frame: str = "base") -> PointCloud:
    return PointCloud(stamp=stamp, frame=frame, sensor="lidar", points=points)


def said(one: LidarCpmGenerator, reading: PointCloud) -> Sequence[HypothesisCloud]:
    return one.generate(reading, STATE)


def cloud_of(one: LidarCpmGenerator, reading: PointCloud) -> HypothesisCloud:
    (cloud,) = said(one, reading)
    return cloud


@pytest.fixture
def windows(monkeypatch: pytest.MonkeyPatch) -> list[FloatArray]:
    """Give what the networks are shown, reading by reading."""
    seen: list[FloatArray] = []
    whole = ContactNetworks.perceive

    def perceive(self: ContactNetworks, window: FloatArray) -> Perception:
        seen.append(window)
        return whole(self, window)

    monkeypatch.setattr(ContactNetworks, "perceive", perceive)
    return seen


# What is told of a contact


def test_the_likelihood_is_all_that_is_not_none(tmp_path: Path) -> None:
    one = generator(tmp_path, says(none=1.0, point=0.5, line=1.5))
    odds = np.exp([1.0, 0.5, 1.5])
    assert cloud_of(one, scan(wall())).likelihoods == pytest.approx(1.0 - odds[0] / odds.sum())


@pytest.mark.parametrize(("options", "capped"), [({}, 0.95), ({"p_max": 0.7}, 0.7)])
def test_the_likelihood_is_capped(options: dict[str, float], capped: float, tmp_path: Path) -> None:
    one = generator(tmp_path, says(none=-9.0, point=9.0), **options)
    assert set(cloud_of(one, scan(wall())).likelihoods) == {capped}


@pytest.mark.parametrize(("p_min", "told"), [(0.6, True), (0.7, False), (0.0, True)])
def test_what_is_unlikely_is_no_contact(p_min: float, told: bool, tmp_path: Path) -> None:
    one = generator(tmp_path, says(), p_min=p_min)  # two thirds for a contact
    cloud = cloud_of(one, scan(wall()))
    assert bool(len(cloud)) == told
    assert (cloud.source, cloud.stamp) == ("eye", 0.0)


def test_a_point_is_a_column_over_the_face(tmp_path: Path) -> None:
    cloud = cloud_of(generator(tmp_path, says(point=3.0, lateral=-0.07)), scan(wall()))
    assert cloud.frame == "base"
    assert np.unique(cloud.positions[:, 0]) == pytest.approx([0.30])
    assert np.unique(cloud.positions[:, 1]) == pytest.approx([-0.07])
    z = np.unique(cloud.positions[:, 2])
    assert (z[0], z[-1]) == pytest.approx((-0.40 + SIDE / 2.0, -0.05 - SIDE / 2.0))
    assert cloud.spreads == pytest.approx(0.02)


def test_a_line_reaches_as_far_as_the_nearest_strips(tmp_path: Path) -> None:
    # the middles of strips 2 and 9 are 0.35 m from each other
    cloud = cloud_of(generator(tmp_path, says(line=3.0, lateral=0.01)), scan(wall()))
    y = cloud.positions[:, 1]
    assert (y.min(), y.max()) == pytest.approx((0.01 - 0.175, 0.01 + 0.175))
    assert np.diff(np.unique(y)).max() <= SIDE + 1e-9
    assert cloud.spreads == pytest.approx(0.03)


def test_height_and_frame_are_those_that_are_told(tmp_path: Path) -> None:
    one = generator(tmp_path, says(point=3.0), height=(-0.2, -0.1))
    z = cloud_of(one, scan(wall())).positions[:, 2]
    assert (z.min(), z.max()) == pytest.approx((-0.2 + SIDE / 2.0, -0.1 - SIDE / 2.0))


# What the networks are shown


def test_the_networks_see_proximity_strip_by_strip(
    windows: list[FloatArray], tmp_path: Path
) -> None:
    said(generator(tmp_path, some_weights()), scan(wall(0.405, (-0.19, 0.09))))
    (window,) = windows
    assert window.shape == (20, 12)
    expected = np.full(12, EMPTY)
    expected[2:8] = 0.405 - 0.31
    assert window == pytest.approx(np.tile(expected, (20, 1)))


def test_a_cloud_comes_from_its_own_frame(windows: list[FloatArray], tmp_path: Path) -> None:
    one = generator(tmp_path, some_weights())
    said(one, scan(wall(0.405)))
    said(one, scan(points_in(inverse(POSE), wall(0.405)), 0.1, frame="lidar"))
    assert windows[1][-1] == pytest.approx(windows[0][-1])


@pytest.mark.parametrize(
    "points",
    [NOTHING, np.full((5, 3), np.nan), np.array([[2.0, 0.0, 0.0]]), np.array([[0.4, 0.0, 0.6]])],
    ids=["none", "no return", "beyond", "above"],
)
def test_a_cloud_without_a_point_in_the_region_is_a_scene(
    points: FloatArray, windows: list[FloatArray], tmp_path: Path
) -> None:
    clouds = said(generator(tmp_path, some_weights()), scan(points))
    assert len(clouds) == 1  # it has looked
    assert windows[0] == pytest.approx(np.full((20, 12), EMPTY))


def test_the_robot_itself_does_not_count(windows: list[FloatArray], tmp_path: Path) -> None:
    chassis = np.array([[0.302, 0.0, -0.05], [0.304, 0.1, -0.2]])
    said(generator(tmp_path, some_weights()), scan(chassis))
    assert windows[0] == pytest.approx(np.full((20, 12), EMPTY))
    (tmp_path / "bare").mkdir()
    said(generator(tmp_path / "bare", some_weights(), robot=()), scan(chassis))
    assert np.flatnonzero(windows[1][-1] < 0.01).tolist() == [6, 8]


# What was before


def spoken(one: LidarCpmGenerator, *scans: tuple[float, FloatArray]) -> HypothesisCloud:
    """Show scans, and give what is said of the last."""
    return [cloud_of(one, scan(points, stamp)) for stamp, points in scans][-1]


def same(one: HypothesisCloud, other: HypothesisCloud) -> bool:
    return (
        one.positions.tobytes() == other.positions.tobytes()
        and one.likelihoods.tobytes() == other.likelihoods.tobytes()
    )


def free(folder: Path) -> LidarCpmGenerator:
    """Networks whose answer hangs on all that they were shown; whatever they say is told."""
    return generator(folder, some_weights(), p_min=0.0, p_max=1.0)


PAST = ((0.0, wall(0.5, (0.0, 0.2))), (0.1, wall(0.45, (-0.1, 0.2))))


def test_the_last_two_seconds_count(tmp_path: Path, windows: list[FloatArray]) -> None:
    one = free(tmp_path)
    for cycle in range(30):
        said(one, scan(wall(0.305 + 0.01 * cycle), 0.1 * cycle))
    middles = windows[-1][:, 5] + 0.31
    assert middles == pytest.approx(0.305 + 0.01 * np.arange(10, 30))


def test_a_short_silence_is_bridged(tmp_path: Path) -> None:
    alone = spoken(free(tmp_path), (0.6, wall()))
    after = spoken(free(tmp_path), *PAST, (0.1 + GAP - 0.01, wall()))
    assert not same(alone, after)


def test_a_silence_of_more_than_half_a_second_forgets(tmp_path: Path) -> None:
    assert GAP == 0.5
    alone = spoken(free(tmp_path), (0.61, wall()))
    after = spoken(free(tmp_path), *PAST, (0.61, wall()))
    assert same(alone, after)


def test_a_reset_forgets(tmp_path: Path) -> None:
    one = free(tmp_path)
    spoken(one, *PAST)
    one.reset()
    assert same(spoken(one, (0.2, wall())), spoken(free(tmp_path), (0.2, wall())))


@pytest.mark.parametrize("stamp", [0.1, 0.05, -1.0])
def test_a_reading_that_is_not_newer_gives_nothing(stamp: float, tmp_path: Path) -> None:
    one, other = free(tmp_path), free(tmp_path)
    spoken(one, *PAST)
    assert said(one, scan(wall(), stamp)) == ()
    # and leaves no trace
    spoken(other, *PAST)
    assert same(spoken(one, (0.2, wall())), spoken(other, (0.2, wall())))


# What is wrong


def test_weights_that_are_missing_are_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="gone.safetensors") as told:
        LidarCpmGenerator("eye", LearnedConfig(weights=tmp_path / "gone.safetensors"))
    assert "\n" not in str(told.value)


def test_weights_of_another_shape_are_told(tmp_path: Path) -> None:
    weights = some_weights()
    weights["type.readout.bias"] = np.zeros(4, np.float32)
    path = write(tmp_path, weights)
    with pytest.raises(ConfigurationError) as told:
        LidarCpmGenerator("eye", LearnedConfig(weights=path))
    assert str(told.value) == f"{path}: the tensor type.readout.bias has shape (4,), not (3,)"


def test_weights_that_their_card_does_not_tell_of_are_told(tmp_path: Path) -> None:
    path = write(tmp_path, some_weights())
    path.with_suffix(".json").write_text(some_card(b"others").model_dump_json())
    with pytest.raises(ConfigurationError) as told:
        LidarCpmGenerator("eye", LearnedConfig(weights=path))
    assert str(told.value) == f"{path} holds other weights than its card names"


def test_a_file_that_holds_no_weights_is_told(tmp_path: Path) -> None:
    path = write(tmp_path, some_weights())
    path.write_bytes(b"no weights")
    with pytest.raises(ConfigurationError, match=r"contact.safetensors is no safetensors file"):
        LidarCpmGenerator("eye", LearnedConfig(weights=path))


@pytest.mark.parametrize("kind", ["networks", "rule"])
def test_a_lidar_that_hangs_nowhere_is_told(kind: str, tmp_path: Path) -> None:
    one = (
        generator(tmp_path, says())
        if kind == "networks"
        else LidarRuleGenerator("eye", LidarRuleConfig())
    )
    with pytest.raises(FrameError, match="^unknown frame 'lidr': did you mean 'lidar'"):
        one.generate(scan(wall(), frame="lidr"), STATE)
    apart = State(
        now=0.0,
        grid=Grid("base", SIDE),
        frames=FrameTree({"lidar": ("mast", POSE), "base": ("odom", POSE)}),
    )
    with pytest.raises(FrameError, match="^no transform joins 'lidar' to 'base': 'lidar' hangs"):
        one.generate(scan(wall(), frame="lidar"), apart)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"p_max": 0.0}, "p_max: "),
        ({"p_min": 1.5}, "p_min: "),
        ({"height": (-0.05, -0.4)}, "height: .*give the lower bound, then the upper"),
        ({"wieghts": "x"}, "wieghts: unknown field; did you mean 'weights'"),
    ],
)
def test_wrong_options_are_told(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^{sentence}"):
        LearnedConfig(**options)


# In a pipeline


@pytest.mark.parametrize("page", ["lidar_cpm", "lidar_rule"])
def test_the_example_of_its_page_feels_what_is_pushed(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lateral = 0.1  # of the object on both pages
    text = (ROOT / "docs" / "generators" / f"{page}.md").read_text()
    (code,) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    networks = write(tmp_path, says(point=3.0, lateral=lateral))
    monkeypatch.setattr("contactfusion.generators.networks.shipped", lambda: networks)
    names: dict[str, Any] = {}
    exec(code, names)
    (contact,) = names["contacts"]
    assert contact.position[:2] == pytest.approx([0.3, lateral], abs=0.02)
    assert names["scene"].truth().contact[1] == pytest.approx(lateral, abs=0.02)


@pytest.mark.parametrize("kind", ["lidar_cpm", "lidar_rule"])
def test_in_a_pipeline_it_is_a_source(kind: str, tmp_path: Path) -> None:
    options: dict[str, Any] = {"type": kind, "sensor": "lidar"}
    if kind == "lidar_cpm":
        options["weights"] = str(write(tmp_path, says(line=3.0, lateral=0.0)))
    config: dict[str, Any] = {
        "robot": "contactfusion.robots:mobile_base.yaml",
        "generators": {"eye": options},
        "integrator": {"frame": "base", "voxel_size": SIDE},
    }
    pipeline = Pipeline(PipelineConfig(**config))
    points = points_in(inverse(POSE), np.concatenate([wall(0.3035), wall(0.315)]))
    for cycle in range(5):
        pipeline.receive(scan(points, 0.1 * cycle, frame="lidar"))
    fusion = pipeline.step(0.4).fusion
    source = fusion.report.sources["eye"]
    assert (source.accepted, source.invalid) == (5, 0)
    (contact,) = fusion.contacts
    assert contact.position[:2] == pytest.approx([0.3, 0.0], abs=SIDE)
    assert np.ptp(contact.extent[:, 1]) == pytest.approx(0.35, abs=0.05)


def test_in_a_pipeline_a_lidar_that_hangs_nowhere_is_reported(tmp_path: Path) -> None:
    config: dict[str, Any] = {
        "robot": "contactfusion.robots:mobile_base.yaml",
        "generators": {
            "eye": {"type": "lidar_cpm", "weights": str(write(tmp_path, says())), "sensor": "lidar"}
        },
        "integrator": {"frame": "base", "voxel_size": SIDE},
    }
    pipeline = Pipeline(PipelineConfig(**config))
    pipeline.receive(scan(wall(), frame="lidr"))
    step = pipeline.step(0.0)
    assert step.fusion.report.sources["eye"].invalid == 1
    assert not step.fusion.contacts
