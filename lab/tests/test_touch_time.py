"""Touches over time: what is known when, how long a report takes, and what the force does to it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.grid import Grid
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.pipeline import Pipeline
from contactfusion.robots.model import shared_robot
from contactfusion_lab.experiments.methods import DE_MORGAN, DEFAULT_METHOD, POSTERIOR, Method
from contactfusion_lab.experiments.touch import rows, tables
from contactfusion_lab.experiments.touch.course import course_of
from contactfusion_lab.experiments.touch.experiment import METHODS
from contactfusion_lab.experiments.touch.plan import DEFAULT, Plan, read_plan
from contactfusion_lab.experiments.touch.record import (
    COARSEST,
    Arrived,
    Record,
    arrays_of,
    fields_of,
    record_of,
    thinned,
    worth_keeping,
)
from contactfusion_lab.experiments.touch.rows import (
    ALL,
    TIMED,
    everything,
    fused,
    reported,
)
from contactfusion_lab.experiments.touch.trial import Trial, run_trial
from contactfusion_lab.scenes.touch.scene import TouchScene
from lab.tests.test_touch_experiment import (
    PLACE,
    cloud,
    equal_clouds,
    outcomes,
    touch,
    trial,
)

COARSE = Method("de_morgan", "cluster_centroid", options=(("voxel_size", COARSEST),))
NOWHERE = np.empty((0, 3))
GRID = Grid("base", 0.005)


@pytest.fixture(scope="module")
def plan() -> Plan:
    return read_plan(DEFAULT, [], 15, "prototype", (), 3)[0]


@pytest.fixture(scope="module")
def felt(plan: Plan) -> Trial:
    return run_trial(plan, touch())


def arrived(source: str, *stamps: float, places: object = PLACE) -> list[Arrived]:
    """Clouds that arrive 10 ms after they were measured."""
    return [
        Arrived(stamp + 0.01, replace(cloud(source, places, 0.9), stamp=stamp)) for stamp in stamps
    ]


def over_time(history: dict[str, list[Arrived]], onset: float, places: FloatArray = PLACE) -> Trial:
    """A touch of 1 s with its joints at 20 Hz, touched from an onset on."""
    stamps = np.arange(0.0, 1.01, 0.05)
    contacts = [places[None] if stamp >= onset else NOWHERE for stamp in stamps]
    felt = Record(1.0, history, stamps, np.zeros((len(stamps), 15)), contacts, ())
    return Trial(touch(), felt, places[None], ("palm",), True, 6.0, onset)


class TestRecord:
    def test_what_has_not_arrived_is_not_known(self) -> None:
        one = over_time({"tip_1": arrived("tip_1", 0.1, 0.2), "tip_2": arrived("tip_2", 0.3)}, 0.5)
        assert not one.record.at(0.105).clouds
        assert one.record.at(0.11).clouds["tip_1"].stamp == 0.1
        known = one.record.at(0.3).clouds
        assert known["tip_1"].stamp == 0.2 and "tip_2" not in known
        assert len(one.record.at(0.499).contacts) == 0 and len(one.record.at(0.5).contacts) == 1

    def test_cycles_come_at_20_hertz_and_the_end_is_one(self) -> None:
        felt = replace(over_time({}, 0.5).record, end=0.72)
        stamps = [each.stamp for each in felt.cycles(0.503)]
        assert stamps == pytest.approx([0.55, 0.6, 0.65, 0.7, 0.72])
        assert next(iter(felt.cycles(0.55))).stamp == pytest.approx(0.55)
        assert [each.stamp for each in felt.cycles(0.71)] == [0.72]

    def test_an_ending_ends_as_the_whole(self, felt: Trial) -> None:
        whole, ending = felt.last, felt.ending.last
        assert whole.clouds.keys() == ending.clouds.keys()
        assert all(ending.clouds[name] is each for name, each in whole.clouds.items())
        np.testing.assert_array_equal(whole.joints, ending.joints)

    def test_a_source_that_stops_is_known_by_its_stamps(self) -> None:
        """Clouds without hypotheses are kept, too: they say that a source still measures."""
        empty = [
            Arrived(0.1 * n, replace(cloud("wrist", [], 0.0), stamp=0.1 * n)) for n in range(5)
        ]
        one = over_time({"wrist": [*empty, *arrived("wrist", 0.6)]}, 0.5).record
        back = record_of(
            fields_of(one), {name: np.asarray(a) for name, a in arrays_of(one).items()}
        )
        assert [each.stamp for each in back.history["wrist"]] == pytest.approx(
            [0.0, 0.1, 0.2, 0.3, 0.4, 0.61]
        )
        for before, after in zip(one.history["wrist"], back.history["wrist"], strict=True):
            equal_clouds(before.cloud, after.cloud, 1e-6)

    def test_clouds_without_forces_lie_beside_those_with(self) -> None:
        plain = cloud("wrist", [PLACE, PLACE + 0.1], 0.4)
        forceful = replace(plain, forces=np.arange(6.0).reshape(2, 3), notes=("saturated",))
        exact = replace(plain, spreads=None)
        clouds = (plain, forceful, exact, forceful, plain)
        history = {"wrist": [Arrived(0.1 * n, each) for n, each in enumerate(clouds)]}
        one = over_time(history, 0.5).record
        back = record_of(
            fields_of(one), {name: np.asarray(a) for name, a in arrays_of(one).items()}
        )
        for before, after in zip(history["wrist"], back.history["wrist"], strict=True):
            equal_clouds(before.cloud, after.cloud, 1e-6)


class TestNull:
    def null(self, *places: FloatArray) -> HypothesisCloud:
        return replace(cloud("air", places, 1.0), kind=HypothesisKind.NULL)

    def test_null_is_kept_where_another_hypothesis_is(self) -> None:
        null = self.null(PLACE, PLACE + [0.0, 0.0, 0.1])
        kept = thinned(null, [PLACE[None] + 1e-4], GRID)
        np.testing.assert_array_equal(kept.positions, PLACE[None])
        assert len(thinned(null, [], GRID)) == 0

    def test_null_around_evidence_is_kept_for_large_voxels(self) -> None:
        near, far = PLACE + [0.0, 0.0, 0.9 * COARSEST], PLACE + [0.0, 0.0, 1.1 * COARSEST]
        kept = thinned(self.null(near, far), [], GRID, [PLACE[None]])
        np.testing.assert_array_equal(kept.positions, near[None])

    def test_each_cloud_is_thinned_by_those_of_its_time(self) -> None:
        early, late = PLACE, PLACE + [0.2, 0.0, 0.0]
        air = [Arrived(0.1, self.null(early, late)), Arrived(0.4, self.null(early, late))]
        seen = [*arrived("believed", 0.2, places=early), *arrived("believed", 0.3, places=late)]
        kept = worth_keeping({"air": air, "believed": seen}, [], GRID, ())
        first, second = (each.cloud.positions for each in kept["air"])
        np.testing.assert_array_equal(first, [early, late])
        np.testing.assert_array_equal(second, [late])

    def test_a_veto_of_large_voxels_survives(
        self, plan: Plan, felt: Trial, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """What is kept of Null decides as all of it on the coarsest grid, too."""
        config, row = plan.pipeline_of("box"), everything(plan.pipeline)
        clouds: dict[str, HypothesisCloud] = {}
        pipeline = Pipeline(config, tell=lambda each: clouds.update({each.source: each}))
        assert config.robot is not None
        scene = TouchScene(plan.scene_of(touch()), shared_robot(config.robot), touch().seed)
        for reading in scene.readings():
            pipeline.receive(reading)
        kept = fused(felt.last, row, COARSE, plan.pipeline).space
        monkeypatch.setattr(rows, "thinned", lambda null, *rest: null)
        whole = fused(replace(felt.last, clouds=clouds), row, COARSE, plan.pipeline).space
        assert len(felt.clouds["air"]) < len(clouds["air"])
        contacts = [space.positions[space.verdicts == "contact"] for space in (kept, whole)]
        assert len(contacts[0]) and (whole.verdicts == "nulled").any()
        np.testing.assert_array_equal(contacts[0], contacts[1])


class TestLatency:
    def test_it_lasts_from_the_first_contact_to_the_first_report_near_it(self, plan: Plan) -> None:
        history = {
            "tip_1": [*arrived("tip_1", 0.3, places=PLACE + 0.1), *arrived("tip_1", 0.72)],
        }
        one = over_time(history, 0.52)
        assert course_of(one, ALL, DE_MORGAN, plan.pipeline).latency == pytest.approx(0.75 - 0.52)

    def test_a_report_far_away_or_before_is_none(self, plan: Plan) -> None:
        far = over_time({"tip_1": arrived("tip_1", 0.7, places=PLACE + 0.1)}, 0.52)
        assert np.isnan(course_of(far, ALL, DE_MORGAN, plan.pipeline).latency)
        before = over_time({"tip_1": arrived("tip_1", 0.2)}, 0.8)  # it has timed out
        assert np.isnan(course_of(before, ALL, DE_MORGAN, plan.pipeline).latency)
        in_air = trial(cloud("tip_1", PLACE, 0.9), places=(), short=True)
        assert np.isnan(course_of(in_air, ALL, DE_MORGAN, plan.pipeline).latency)

    def test_a_report_that_is_lost_and_comes_again_is_counted(self, plan: Plan) -> None:
        history = {
            "tip_1": [
                *arrived("tip_1", 0.3),
                *arrived("tip_1", 0.45, places=PLACE + 0.1),
                *arrived("tip_1", 0.6),
            ],
        }
        one = over_time(history, 0.2)
        assert course_of(one, ALL, DE_MORGAN, plan.pipeline).lost == 1
        often = [cloud for k in range(8) for cloud in arrived("tip_1", 0.3 + 0.1 * k)]
        steady = over_time({"tip_1": often}, 0.2)
        assert course_of(steady, ALL, DE_MORGAN, plan.pipeline).lost == 0

    def test_without_evidence_no_rule_reports_anything(self, plan: Plan) -> None:
        support = trial(cloud("believed", PLACE, 0.9), cloud("tip_1", [], 0.0))
        for method in METHODS:
            row = everything(plan.pipeline)
            assert not len(reported(support.last, row, method, plan.pipeline))
            assert not fused(support.last, row, method, plan.pipeline).contacts

    def test_a_real_touch_is_reported_within_its_time(self, plan: Plan, felt: Trial) -> None:
        assert 0.0 < felt.onset < felt.record.end
        before = [len(places) for places in felt.record.contacts]
        first = felt.record.stamps[np.flatnonzero(before)[0]]
        assert first - 0.05 < felt.onset <= first
        for method in (DEFAULT_METHOD, DE_MORGAN, POSTERIOR):
            seconds = course_of(felt, everything(plan.pipeline), method, plan.pipeline).latency
            assert 0.0 <= seconds <= felt.record.end - felt.onset

    def test_the_force_is_what_presses_in_the_end(self, plan: Plan, felt: Trial) -> None:
        press = plan.scene_of(touch()).press
        assert felt.force == pytest.approx(press, rel=0.25)
        assert run_trial(plan, touch(short=True)).force == 0.0


class TestTables:
    def frame(self, forces: Sequence[float], latencies: Sequence[float]) -> pd.DataFrame:
        frame = outcomes(np.full(len(forces), 0.02))
        touched = ~frame["short"]
        frame.loc[touched, "force"], frame.loc[touched, "latency"] = forces, latencies
        frame.loc[touched, "detected"] = np.asarray(forces) > 2.0
        return frame

    def test_detection_by_press_force(self) -> None:
        frame = self.frame([1.0, 1.9, 2.0, 3.9, 4.0, 30.0], [0.1] * 6)
        made = list(tables.measures_of(frame, 0))
        found = {each.metric: (each.value, each.n) for each in made}
        assert found["detected at under 2 N"] == (0.0, 2)
        assert found["detected at 2 to 4 N"] == (0.5, 2)
        assert found["detected at over 8 N"] == (1.0, 1)
        text = tables.force_text(made, ["all"], "m")
        assert "| all | 2 to 4 N | 2 | 50 [" in text

    def test_equal_forces_make_no_table(self) -> None:
        made = list(tables.measures_of(self.frame([5.0, 6.0, 7.0], [0.1] * 3), 0))
        assert tables.force_text(made, ["all"], "m") == ""

    def test_touches_that_are_never_reported_are_counted(self) -> None:
        frame = self.frame([6.0] * 4, [0.1, 0.2, np.nan, 0.3])
        made = list(tables.measures_of(frame, 0))
        found = {each.metric: each for each in made}
        assert found["latency median"].value == pytest.approx(0.2)
        assert (found["never reported"].value, found["never reported"].n) == (0.25, 4)
        assert "| all | 3 | 0.20 [" in tables.time_text(made, ["all", "fingers"], "m")

    def test_other_rows_are_not_timed(self) -> None:
        frame = self.frame([6.0], [np.nan]).assign(row="tactile")
        assert "tactile" not in TIMED
        assert not any("reported" in each.metric for each in tables.measures_of(frame, 0))
