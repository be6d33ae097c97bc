import numpy as np
import pytest

from contactfusion.generators.lidar_rule import (
    LidarRuleConfig,
    LidarRuleGenerator,
    RuleProximityConfig,
)
from contactfusion.generators.perceived import NOTHING_NEAR, Kind, Memory, Percept, half_length
from contactfusion.grid import Grid
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.readings import PointCloud
from contactfusion.state import State

SIDE = 0.0125
STATE = State(now=1.0, grid=Grid(frame="base", voxel_size=SIDE))
PROXIMITY = RuleProximityConfig(occupied=1)


def lengths_with(nearest: dict[int, float]) -> np.ndarray:
    lengths = np.full(12, 0.31)
    for strip, length in nearest.items():
        lengths[strip] = length
    return lengths


def cloud_of(percept: Percept, lengths: np.ndarray) -> HypothesisCloud:
    generator = LidarRuleGenerator("lidar", LidarRuleConfig())
    reading = PointCloud(stamp=1.0, frame="base", points=np.empty((0, 3)))
    return generator.face_cloud(reading, STATE, percept, lengths, PROXIMITY)


def by_rule(*points: tuple[float, float, float]) -> HypothesisCloud:
    generator = LidarRuleGenerator("lidar", LidarRuleConfig(proximity=PROXIMITY))
    reading = PointCloud(stamp=1.0, frame="base", points=np.array(points).reshape(-1, 3))
    (cloud,) = generator.generate(reading, STATE)
    return cloud


def test_a_cell_holds_two_points_whatever_else_of_it_is_given() -> None:
    given = LidarRuleConfig(proximity={"cell": (0.04, 0.05)})  # type: ignore[arg-type]
    assert given.proximity.occupied == LidarRuleConfig().proximity.occupied == 2


def test_a_point_is_a_column_of_voxels_over_the_faces_height() -> None:
    cloud = cloud_of(Percept(Kind.POINT, 0.1, 0.9, 0.02), lengths_with({8: 0.0}))
    assert np.unique(cloud.positions[:, 0]) == pytest.approx([0.30])
    assert np.unique(cloud.positions[:, 1]) == pytest.approx([0.1])
    z = np.sort(cloud.positions[:, 2])
    assert (z[0], z[-1]) == pytest.approx((-0.39375, -0.05625))
    assert np.diff(z).max() <= SIDE + 1e-9
    assert set(cloud.likelihoods) == {0.9}
    assert cloud.spreads is not None and set(cloud.spreads) == {0.02}


def test_a_line_reaches_as_far_as_the_nearest_strips() -> None:
    lengths = lengths_with({4: 0.0, 5: 0.004, 6: 0.002, 7: 0.02})
    cloud = cloud_of(Percept(Kind.LINE, 0.02, 0.9, 0.02), lengths)
    y = cloud.positions[:, 1]
    assert (y.min(), y.max()) == pytest.approx((-0.03, 0.07))


def test_a_line_ends_with_the_face_and_keeps_its_middle() -> None:
    lengths = lengths_with({strip: 0.0 for strip in range(4, 12)})
    y = cloud_of(Percept(Kind.LINE, 0.2, 0.9, 0.02), lengths).positions[:, 1]
    assert (y.min(), y.max()) == pytest.approx((0.1, 0.3))


def test_a_place_beside_the_face_is_moved_onto_it() -> None:
    cloud = cloud_of(Percept(Kind.POINT, 0.4, 0.9, 0.02), lengths_with({11: 0.0}))
    assert np.unique(cloud.positions[:, 1]) == pytest.approx([0.3])


@pytest.mark.parametrize(
    "percept",
    [Percept(Kind.NONE, 0.0, 0.9, 0.02), Percept(Kind.POINT, 0.0, 0.49, 0.02)],
)
def test_no_contact_is_an_empty_cloud(percept: Percept) -> None:
    assert len(cloud_of(percept, lengths_with({6: 0.0}))) == 0


def test_before_an_empty_region_there_is_no_contact_whatever_is_perceived() -> None:
    cloud = cloud_of(Percept(Kind.POINT, 0.0, 0.99, 0.02), lengths_with({}))
    assert len(cloud) == 0 and cloud.notes == (NOTHING_NEAR,)
    assert cloud_of(Percept(Kind.NONE, 0.0, 0.99, 0.02), lengths_with({3: 0.2})).notes == ()


def test_a_likelihood_is_capped() -> None:
    cloud = cloud_of(Percept(Kind.POINT, 0.0, 1.0, 0.02), lengths_with({6: 0.0}))
    assert set(cloud.likelihoods) == {0.95}


def test_the_shortest_line_is_as_long_as_a_line_must_be() -> None:
    assert half_length(lengths_with({3: 0.0}), PROXIMITY, 0.005) == pytest.approx(0.025)


def test_the_rule_puts_a_point_in_the_middle_of_its_strip() -> None:
    cloud = by_rule((0.312, 0.06, 0.0))
    assert np.unique(cloud.positions[:, 1]) == pytest.approx([0.075])


def test_by_the_rule_two_neighbouring_strips_are_a_point() -> None:
    cloud = by_rule((0.312, 0.06, 0.0), (0.312, 0.04, 0.0))
    assert np.unique(cloud.positions[:, 1]) == pytest.approx([0.05])


def test_by_the_rule_distant_strips_are_a_line_about_their_middle() -> None:
    y = by_rule((0.312, 0.16, 0.0), (0.312, -0.01, 0.0), (0.340, -0.2, 0.0)).positions[:, 1]
    assert (y.min() + y.max()) / 2.0 == pytest.approx(0.075)
    assert y.max() > y.min()


@pytest.mark.parametrize("points", [(), ((0.45, 0.0, 0.0),)])
def test_the_rule_feels_nothing_where_nothing_is_near(
    points: tuple[tuple[float, float, float], ...],
) -> None:
    assert len(by_rule(*points).positions) == 0


def rows(window: np.ndarray | None) -> list[float]:
    assert window is not None
    kept: list[float] = window[:, 0].tolist()
    return kept


def test_a_window_that_begins_is_filled_with_its_first_descriptor() -> None:
    memory = Memory(4, 0.1, 0.5)
    assert rows(memory.window(1.0, np.array([1.0]))) == [1.0, 1.0, 1.0, 1.0]
    assert rows(memory.window(1.1, np.array([2.0]))) == [1.0, 1.0, 1.0, 2.0]


def test_in_a_gap_the_nearest_descriptor_is_repeated() -> None:
    memory = Memory(6, 0.1, 0.5)
    memory.window(1.0, np.array([1.0]))
    memory.window(1.1, np.array([2.0]))
    assert rows(memory.window(1.45, np.array([3.0]))) == [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]


def test_after_a_long_silence_the_past_is_forgotten() -> None:
    memory = Memory(3, 0.1, 0.5)
    memory.window(1.0, np.array([1.0]))
    assert rows(memory.window(1.6, np.array([2.0]))) == [2.0, 2.0, 2.0]


def test_faster_descriptors_are_thinned_to_the_rate() -> None:
    memory = Memory(3, 0.1, 0.5)
    for step in range(10):
        memory.window(step * 0.05, np.array([float(step)]))
    assert rows(memory.window(0.5, np.array([10.0]))) == [6.0, 8.0, 10.0]


def test_what_is_not_newer_than_the_last_is_left_out() -> None:
    memory = Memory(3, 0.1, 0.5)
    memory.window(1.0, np.array([1.0]))
    assert memory.window(1.0, np.array([2.0])) is None
    assert memory.window(0.9, np.array([2.0])) is None


def test_a_memory_that_is_cleared_begins_anew() -> None:
    memory = Memory(2, 0.1, 0.5)
    memory.window(1.0, np.array([1.0]))
    memory.clear()
    assert rows(memory.window(0.5, np.array([2.0]))) == [2.0, 2.0]
