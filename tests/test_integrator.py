"""The integrator: every rule of method §1 and §2 as a case that a hand can compute."""

import itertools
import math
from typing import Any

import numpy as np
import pytest

from contactfusion import Fusion, HypothesisCloud, HypothesisKind, Integrator, IntegratorConfig
from contactfusion.errors import (
    ContactFusionError,
    FrameError,
    InvalidCloudError,
    PluginError,
    SourceError,
    TimeError,
)
from contactfusion.integrator.sources import EventKind
from tests.clouds import (
    HERE,
    NULL,
    REGULAR,
    SIDE,
    SUPPORT,
    THERE,
    Voxel,
    by_voxel,
    centres,
    cloud,
    contents,
    fused,
    given,
    verdicts,
    voxels_of,
)


def integrator(**config: Any) -> Integrator:
    return Integrator(IntegratorConfig(**config))


def events(fusion: Fusion, kind: EventKind) -> list[str]:
    return [event.message for event in fusion.report.events if event.kind == kind]


def force(fusion: Fusion, voxel: Voxel = HERE) -> list[float]:
    vector: list[float] = fusion.space.forces[voxels_of(fusion).index(voxel)].tolist()
    return vector


# Entries: the newest of each voxel and source


def test_the_newest_entry_of_a_source_wins_also_when_it_is_less_likely() -> None:
    fusion = fused(cloud("a", 0.0, {HERE: 0.75}), cloud("a", 0.25, {HERE: 0.5}), now=0.25)
    assert by_voxel(fusion) == {HERE: 0.5}


def test_the_newest_entry_wins_across_steps() -> None:
    one = integrator()
    for stamp, p in ((0.0, 0.75), (0.25, 0.5)):
        one.receive(cloud("a", stamp, {HERE: p}))
        fusion = one.step(stamp)
        assert by_voxel(fusion) == {HERE: p}
        assert fusion.space.stamps.tolist() == [stamp]


def test_of_entries_with_one_stamp_the_most_likely_wins_in_one_cloud_in_two_and_in_two_steps() -> (
    None
):
    twice = cloud("a", 0.0, [(HERE, 0.25), (HERE, 0.5), (HERE, 0.125)])
    assert by_voxel(fused(twice)) == {HERE: 0.5}
    high, low = cloud("a", 0.0, {HERE: 0.5}), cloud("a", 0.0, {HERE: 0.25})
    for first, second in ((high, low), (low, high)):
        assert by_voxel(fused(first, second)) == {HERE: 0.5}
        one = integrator()
        one.receive(first)
        one.step(0.0)
        one.receive(second)
        assert by_voxel(one.step(0.0)) == {HERE: 0.5}


def test_zero_makes_no_entry() -> None:
    fusion = fused(cloud("a", 0.0, {HERE: 0.0}))
    assert by_voxel(fusion) == {} and fusion.report.sources["a"].accepted == 1


def test_zero_removes_the_older_entry_of_its_own_source_only() -> None:
    old = [cloud("a", 0.0, {HERE: 0.5, THERE: 0.5}), cloud("b", 0.0, {HERE: 0.25})]
    fusion = fused(*old, cloud("a", 0.1, {HERE: 0.0}), now=0.1)
    assert given(fusion, "a") == {THERE: 0.5} and given(fusion, "b") == {HERE: 0.25}


def test_zero_removes_nothing_of_its_own_stamp() -> None:
    assert by_voxel(fused(cloud("a", 0.0, [(HERE, 0.5), (HERE, 0.0)]))) == {HERE: 0.5}
    assert by_voxel(fused(cloud("a", 0.0, [(HERE, 0.0), (HERE, 0.5)]))) == {HERE: 0.5}


def test_a_likelihood_that_is_zero_as_float32_is_zero() -> None:
    assert by_voxel(fused(cloud("a", 0.0, {HERE: 1e-46}))) == {}


def test_likelihoods_are_kept_as_float32() -> None:
    assert by_voxel(fused(cloud("a", 0.0, {HERE: 0.1}))) == {HERE: 1 - (1 - float(np.float32(0.1)))}


@pytest.mark.parametrize("likelihoods", [{}, {THERE: 0.5}])
def test_a_new_or_empty_cloud_leaves_the_other_voxels(likelihoods: dict[Voxel, float]) -> None:
    fusion = fused(cloud("a", 0.0, {HERE: 0.5}), cloud("a", 0.1, likelihoods), now=0.1)
    assert by_voxel(fusion) == {HERE: 0.5, **likelihoods}


@pytest.mark.parametrize("likelihoods", [{}, {THERE: 0.5}])
def test_a_source_that_replaces_keeps_its_newest_cloud_only(
    likelihoods: dict[Voxel, float],
) -> None:
    one = integrator()
    one.plug("a", replace=True)
    one.receive(cloud("a", 0.0, {HERE: 0.5}))
    one.receive(cloud("b", 0.0, {HERE: 0.25}))
    one.step(0.0)
    one.receive(cloud("a", 0.1, likelihoods))
    fusion = one.step(0.1)
    assert given(fusion, "a") == likelihoods and given(fusion, "b") == {HERE: 0.25}


def test_of_two_clouds_in_one_step_a_source_that_replaces_keeps_the_second() -> None:
    one = integrator()
    one.plug("a", replace=True)
    for stamp, voxel in ((0.0, HERE), (0.1, THERE)):
        one.receive(cloud("a", stamp, {voxel: 0.5}))
    assert by_voxel(one.step(0.1)) == {THERE: 0.5}


# Expiry


def test_an_entry_lives_until_exactly_its_timeout_and_not_a_nanosecond_longer() -> None:
    one = integrator(timeout=0.5)
    one.receive(cloud("a", 0.1, {HERE: 0.5}))
    assert by_voxel(one.step(0.1 + 0.5)) == {HERE: 0.5}
    assert by_voxel(one.step(0.600000001)) == {}


def test_each_source_has_a_timeout_of_its_own() -> None:
    one = integrator(timeout=0.5)
    one.plug("quick", timeout=0.1)
    one.plug("slow", timeout=2.0)
    for name in ("quick", "slow", "usual"):
        one.receive(cloud(name, 0.0, {HERE: 0.5}))
    assert [by_voxel(one.step(now)).get(HERE, 0.0) for now in (0.1, 0.5, 2.0, 2.1)] == [
        0.875,
        0.75,
        0.5,
        0.0,
    ]


def test_what_has_died_does_not_come_back_when_the_timeout_is_made_longer() -> None:
    one = integrator(timeout=0.5)
    one.receive(cloud("a", 0.0, {HERE: 0.5}))
    assert by_voxel(one.step(1.0)) == {}
    one.plug("a", timeout=10.0)
    assert by_voxel(one.step(1.0)) == {}


def test_a_cloud_that_is_too_old_when_it_comes_counts_as_a_report_only() -> None:
    fusion = fused(cloud("a", 0.0, {HERE: 0.5}), now=5.0, timeout=0.5)
    assert by_voxel(fusion) == {} and fusion.report.sources["a"].accepted == 1


def test_by_source_a_silent_source_dies_although_another_refreshes_the_voxel() -> None:
    one = integrator(timeout=0.5)
    one.receive(cloud("silent", 0.0, {HERE: 0.5}))
    one.receive(cloud("loud", 0.4, {HERE: 0.5}))
    assert by_voxel(one.step(0.8)) == {HERE: 0.5}


def test_by_voxel_a_silent_source_lives_on_while_another_refreshes_the_voxel() -> None:
    one = integrator(timeout=0.5, expiry="voxel")
    one.receive(cloud("silent", 0.0, {HERE: 0.5, THERE: 0.5}))
    one.receive(cloud("loud", 0.4, {HERE: 0.5}))
    assert by_voxel(one.step(0.8)) == {HERE: 0.75}
    assert by_voxel(one.step(0.9)) == {HERE: 0.75}
    assert by_voxel(one.step(0.900000001)) == {}


def test_by_voxel_a_null_keeps_evidence_alive_and_timeouts_of_sources_are_unused() -> None:
    one = integrator(rule="de_morgan", timeout=0.5, expiry="voxel")
    one.plug("a", timeout=0.01)
    one.receive(cloud("a", 0.0, {HERE: 0.5}))
    one.receive(cloud("free", 0.4, {HERE: 1.0}, NULL))
    fusion = one.step(0.8)
    assert verdicts(fusion) == {HERE: "nulled"} and by_voxel(fusion) == {HERE: 0.5}


# Order


def test_a_late_cloud_is_dropped_counted_and_named() -> None:
    one = integrator()
    one.receive(cloud("a", 0.2, {HERE: 0.5}))
    one.step(0.2)
    one.receive(cloud("a", 0.1, {THERE: 0.5, HERE: 0.9}))
    fusion = one.step(0.2)
    assert by_voxel(fusion) == {HERE: 0.5}
    assert (fusion.report.sources["a"].late, fusion.report.sources["a"].accepted) == (1, 1)
    assert events(fusion, EventKind.LATE) == ["a cloud of 'a' is 0.1 s late: dropped"]


def test_a_cloud_is_late_also_within_one_step_and_by_its_own_source_only() -> None:
    clouds = [cloud("a", 0.2, {HERE: 0.5}), cloud("a", 0.1, {THERE: 0.5}), cloud("b", 0.1, {})]
    fusion = fused(*clouds, now=0.2)
    assert by_voxel(fusion) == {HERE: 0.5}
    assert [fusion.report.sources[name].late for name in "ab"] == [1, 0]


def test_a_stamp_that_rounds_to_the_same_nanosecond_is_not_late() -> None:
    fusion = fused(cloud("a", 0.1 + 0.2, {HERE: 0.5}), cloud("a", 0.3, {THERE: 0.5}), now=0.3)
    assert len(by_voxel(fusion)) == 2


def test_an_early_cloud_is_held_until_its_time_and_counted_once() -> None:
    one = integrator(max_ahead=0.1)
    one.receive(cloud("a", 1.0, {HERE: 0.5}))
    for now in (0.5, 0.899):
        fusion = one.step(now)
        assert by_voxel(fusion) == {} and fusion.report.sources["a"].early == 1
    fusion = one.step(0.9)
    assert by_voxel(fusion) == {HERE: 0.5}
    assert (fusion.report.sources["a"].early, fusion.report.sources["a"].accepted) == (1, 1)
    assert events(fusion, EventKind.EARLY) == []


def test_an_early_cloud_is_told_of_once() -> None:
    one = integrator()
    one.receive(cloud("a", 1.0, {HERE: 0.5}))
    assert events(one.step(0.5), EventKind.EARLY) == ["a cloud of 'a' is 0.5 s early: held back"]
    assert events(one.step(0.6), EventKind.EARLY) == []


def test_an_early_cloud_does_not_make_the_next_one_late() -> None:
    one = integrator()
    one.receive(cloud("a", 1.0, {HERE: 0.5}))
    one.step(0.0)
    one.receive(cloud("a", 0.1, {THERE: 0.5}))
    fusion = one.step(0.1)
    assert by_voxel(fusion) == {THERE: 0.5} and fusion.report.sources["a"].late == 0


def test_a_little_ahead_is_not_early() -> None:
    fusion = fused(cloud("a", 0.1, {HERE: 0.5}), max_ahead=0.1)
    assert by_voxel(fusion) == {HERE: 0.5} and fusion.report.sources["a"].age == -0.1


def test_time_never_runs_backwards() -> None:
    one = integrator()
    one.step(1.0)
    one.step(1.0)
    with pytest.raises(TimeError, match="the step at 0.5 s comes after one at 1 s; reset()"):
        one.step(0.5)
    assert one.step(1.5).contacts == ()


@pytest.mark.parametrize("now", [math.nan, math.inf, 1e18])
def test_a_time_that_is_none_is_refused_and_changes_nothing(now: float) -> None:
    one = integrator()
    one.receive(cloud("a", 0.0, {HERE: 0.5}))
    for ask in (one.step, one.ready):
        with pytest.raises(TimeError):
            ask(now)
    assert by_voxel(one.step(0.0)) == {HERE: 0.5}


def test_after_a_reset_a_clock_may_start_again_with_the_same_plugs() -> None:
    one = integrator(rule="de_morgan")
    one.plug("a", replace=True)
    one.receive(cloud("a", 5.0, {HERE: 0.5}))
    one.receive(cloud("a", 50.0, {HERE: 0.5}))
    before = one.step(5.0)
    one.unplug("a")
    one.plug("a", SUPPORT)
    one.reset()
    fusion = one.step(0.0)
    assert by_voxel(fusion) == {} and fusion.report.sources["a"].kind == SUPPORT
    one.receive(cloud("a", 0.0, {THERE: 0.5}, SUPPORT))
    assert by_voxel(one.step(0.0)) == {THERE: 0.5}
    assert by_voxel(before) == {HERE: 0.5}


def test_a_reset_forgets_clouds_that_were_never_fused_and_all_stamps() -> None:
    one = integrator()
    one.receive(cloud("a", 5.0, {HERE: 0.5}))
    one.reset()
    fusion = one.step(0.0)
    assert by_voxel(fusion) == {} and math.isnan(fusion.report.sources["a"].age)


def test_an_unplugged_source_stays_unplugged_after_a_reset() -> None:
    one = integrator()
    one.plug("a")
    one.unplug("a")
    one.reset()
    with pytest.raises(SourceError, match="'a' is unplugged"):
        one.receive(cloud("a", 0.0, {}))


# Bad clouds


REFUSED = [
    (cloud("a", 0.0, {HERE: 0.5}, frame="tool"), FrameError, "in frame 'tool', but .* 'base'"),
    (cloud("a", 0.0, {HERE: 0.5}, SUPPORT), SourceError, "plugged as regular but sent .* support"),
    (
        cloud("a", 0.0, [(HERE, 0.5), (THERE, 0.5)], positions=[[0, 0, 0], [0, 1e4, 0]]),
        InvalidCloudError,
        r"row 1 of the positions of 'a' is out of reach: \(0, 10000, 0\) m, .* ±5242.88 m",
    ),
    (
        cloud("a", 0.0, {HERE: 0.5}, positions=[[1e29, 0, 0]]),
        InvalidCloudError,
        "row 0 .* out of reach",
    ),
]


@pytest.mark.parametrize(("bad", "error", "sentence"), REFUSED, ids=["frame", "kind", "10 km", "∞"])
def test_a_bad_cloud_is_refused_as_a_whole_counted_and_named(
    bad: HypothesisCloud, error: type[ContactFusionError], sentence: str
) -> None:
    one = integrator()
    one.receive(cloud("a", 0.0, {(7, 7, 7): 0.5}))
    with pytest.raises(error, match=sentence):
        one.receive(bad)
    fusion = one.step(0.0)
    assert by_voxel(fusion) == {(7, 7, 7): 0.5}
    assert (fusion.report.sources["a"].invalid, fusion.report.sources["a"].accepted) == (1, 1)
    assert len(events(fusion, EventKind.REFUSED)) == 1


@pytest.mark.parametrize("corner", list(itertools.product((-1, 0, 1), repeat=3)))
def test_the_space_reaches_to_the_last_voxel_before_two_to_the_twentieth(corner: Voxel) -> None:
    x, y, z = (((1 << 20) - 1) * sign for sign in corner)
    fusion = fused(cloud("a", 0.0, {(x, y, z): 0.5}, side=1.0), voxel_size=1.0)
    assert voxels_of(fusion) == [(x, y, z)] and len(fusion.contacts) == 1


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("beyond", [1 << 20, -(1 << 20), 1 << 40])
def test_the_space_ends_at_two_to_the_twentieth_voxel(axis: int, beyond: int) -> None:
    place = np.zeros((1, 3))
    place[0, axis] = beyond
    with pytest.raises(InvalidCloudError, match="row 0 .* is out of reach"):
        fused(cloud("a", 0.0, {HERE: 0.5}, positions=place), voxel_size=1.0)


def test_a_cloud_that_could_not_even_be_made_can_be_counted() -> None:
    one = integrator()
    one.plug("a")
    with pytest.raises(InvalidCloudError) as caught:
        cloud("a", 0.0, {HERE: math.nan})
    one.refuse("a", str(caught.value))
    fusion = one.step(0.0)
    assert fusion.report.sources["a"].invalid == 1
    assert "row 0 of the likelihoods of 'a'" in events(fusion, EventKind.REFUSED)[0]


def test_a_refused_cloud_does_not_count_as_a_report() -> None:
    one = integrator()
    one.plug("a")
    with pytest.raises(FrameError):
        one.receive(cloud("a", 0.0, {}, frame="tool"))
    assert not one.ready(0.0)


# Plugging


def test_an_unknown_source_plugs_itself_in_as_what_its_cloud_is() -> None:
    fusion = fused(cloud("a", 0.0, {HERE: 0.5}, SUPPORT))
    assert fusion.report.sources["a"].kind == SUPPORT
    assert events(fusion, EventKind.PLUGGED) == ["'a' was plugged in as support"]


def test_a_strict_integrator_refuses_strangers_by_the_nearest_name() -> None:
    one = integrator(strict_sources=True)
    one.plug("skin")
    with pytest.raises(SourceError, match="unknown source 'skni'; did you mean 'skin'"):
        one.receive(cloud("skni", 0.0, {HERE: 0.5}))
    fusion = one.step(0.0)
    assert set(fusion.report.sources) == {"skin"} and by_voxel(fusion) == {}
    assert len(events(fusion, EventKind.REFUSED)) == 1


def test_unplugging_takes_away_all_that_a_source_gave_also_what_waits() -> None:
    one = integrator()
    one.receive(cloud("a", 0.0, {HERE: 0.5}))
    one.receive(cloud("b", 0.0, {HERE: 0.25}))
    one.step(0.0)
    one.receive(cloud("a", 0.0, {THERE: 0.5}))
    one.receive(cloud("a", 0.3, {THERE: 0.5}))
    one.unplug("a")
    one.plug("a")
    fusion = one.step(0.3)
    assert by_voxel(fusion) == {HERE: 0.25}
    assert fusion.report.sources["a"].accepted == 0


def test_an_unplugged_source_is_refused_until_it_is_plugged() -> None:
    one = integrator()
    one.receive(cloud("a", 0.0, {HERE: 0.5}))
    one.unplug("a")
    with pytest.raises(SourceError, match="'a' is unplugged; plug it before it sends clouds"):
        one.receive(cloud("a", 0.0, {HERE: 0.5}))
    one.plug("a")
    one.receive(cloud("a", 0.0, {HERE: 0.25}))
    assert by_voxel(one.step(0.0)) == {HERE: 0.25}


def test_unplugging_forgets_stamps_kind_and_timeouts() -> None:
    one = integrator(timeout=0.5)
    one.plug("a", REGULAR, timeout=10.0, replace=True)
    one.receive(cloud("a", 5.0, {HERE: 0.5}))
    one.step(5.0)
    one.unplug("a")
    one.plug("a", NULL)
    for voxel in (HERE, THERE):
        one.receive(cloud("a", 4.9, {voxel: 0.5}, NULL))
    assert verdicts(one.step(5.0)) == {HERE: "nulled", THERE: "nulled"}
    assert verdicts(one.step(5.5)) == {}


def test_plugging_again_changes_how_but_not_what() -> None:
    one = integrator(timeout=0.5)
    one.receive(cloud("a", 0.0, {HERE: 0.5}))
    one.plug("a", timeout=2.0)
    assert by_voxel(one.step(2.0)) == {HERE: 0.5}
    with pytest.raises(SourceError, match="'a' is plugged as regular; unplug it before .* null"):
        one.plug("a", NULL)


def test_unplugging_a_stranger_names_who_is_there() -> None:
    one = integrator()
    one.plug("wrist")
    with pytest.raises(SourceError, match="unknown source 'wirst'; did you mean 'wrist'"):
        one.unplug("wirst")


@pytest.mark.parametrize("options", [{"timeout": math.nan}, {"stale_after": math.inf}])
@pytest.mark.parametrize("known", [False, True])
def test_a_plug_that_is_refused_changes_nothing(options: dict[str, Any], known: bool) -> None:
    one = integrator(timeout=0.5)
    if known:
        one.plug("a")
        one.step(0.0)
    with pytest.raises(ContactFusionError):
        one.plug("a", **{"timeout": 9.0, **options}, replace=True)
    assert one.step(0.0).report.events == ()
    assert set(one.step(0.0).report.sources) == ({"a"} if known else set())
    one.receive(cloud("a", 0.0, {HERE: 0.5}))
    assert by_voxel(one.step(0.6)) == {}


@pytest.mark.parametrize("option", ["timeout", "stale_after"])
def test_a_source_cannot_live_for_less_than_no_time(option: str) -> None:
    options: dict[str, Any] = {option: -1.0}
    with pytest.raises(ContactFusionError, match=option):
        integrator().plug("a", **options)


def test_an_unknown_rule_or_condensation_gets_the_nearest_name() -> None:
    with pytest.raises(PluginError, match="there is no rule 'de_morgn'; did you mean 'de_morgan'"):
        integrator(rule="de_morgn")
    with pytest.raises(PluginError, match="no condensation 'treshold'; did you mean 'threshold'"):
        integrator(condensation="treshold")


# Verdicts


@pytest.mark.parametrize(
    ("kinds", "verdict", "likelihood"),
    [
        ({REGULAR: 0.5}, "contact", 0.5),
        ({REGULAR: 0.05}, "below_threshold", 0.05),
        ({SUPPORT: 0.5}, "support_only", 0.5),
        ({NULL: 0.5}, "nulled", 0.0),
        ({REGULAR: 0.5, SUPPORT: 0.5}, "contact", 0.75),
        ({REGULAR: 0.06, SUPPORT: 0.06}, "contact", 1 - 0.94**2),
        ({REGULAR: 0.5, NULL: 1e-6}, "nulled", 0.5),
        ({SUPPORT: 0.5, NULL: 1.0}, "nulled", 0.5),
        ({REGULAR: 0.5, SUPPORT: 0.5, NULL: 1.0}, "nulled", 0.75),
    ],
)
def test_each_voxel_has_its_verdict(
    kinds: dict[HypothesisKind, float], verdict: str, likelihood: float
) -> None:
    clouds = [cloud(str(kind), 0.0, {HERE: p}, kind) for kind, p in kinds.items()]
    fusion = fused(*clouds, rule="de_morgan")
    assert verdicts(fusion) == {HERE: verdict}
    assert by_voxel(fusion) == {HERE: pytest.approx(likelihood, abs=1e-7)}
    assert len(fusion.contacts) == (verdict == "contact")


@pytest.mark.parametrize("threshold", [0.1, 0.3, 0.6, 0.9, 1.0])
def test_a_likelihood_at_the_threshold_is_a_contact(threshold: float) -> None:
    at, under = (
        fused(cloud("a", 0.0, {HERE: p}), rule="de_morgan", threshold=threshold)
        for p in (threshold, threshold - 2e-6)
    )
    assert (verdicts(at), verdicts(under)) == ({HERE: "contact"}, {HERE: "below_threshold"})


def test_support_that_came_first_counts_when_evidence_follows() -> None:
    one = integrator()
    one.receive(cloud("motion", 0.0, {HERE: 0.5}, SUPPORT))
    assert verdicts(one.step(0.0)) == {HERE: "support_only"}
    one.receive(cloud("skin", 0.1, {HERE: 0.5}))
    assert by_voxel(one.step(0.1)) == {HERE: 0.75}


# Readiness and silence


def test_ready_means_that_every_source_has_reported_since_the_last_step() -> None:
    one = integrator()
    one.plug("a")
    one.plug("b")
    assert not one.ready(0.0)
    one.receive(cloud("a", 0.0, {HERE: 0.5}))
    assert not one.ready(0.0)
    one.receive(cloud("b", 0.0, {}))
    assert one.ready(0.0)
    one.step(0.0)
    assert not one.ready(0.0)


def test_a_step_is_taken_whether_ready_or_not() -> None:
    one = integrator()
    one.plug("silent")
    one.receive(cloud("a", 0.0, {HERE: 0.5}))
    assert not one.ready(0.0) and by_voxel(one.step(0.0)) == {HERE: 0.5}


def test_a_cloud_that_would_be_late_or_early_is_no_report() -> None:
    one = integrator()
    one.receive(cloud("a", 1.0, {}))
    one.step(1.0)
    one.receive(cloud("a", 0.5, {}))
    assert not one.ready(1.0)
    one.receive(cloud("a", 1.5, {}))
    assert not one.ready(1.0) and one.ready(1.4)


def test_a_source_that_was_silent_for_too_long_is_not_waited_for_and_comes_back_by_itself() -> None:
    one = integrator(stale_after=1.0, timeout=5.0)
    one.receive(cloud("a", 0.0, {HERE: 0.5}))
    one.receive(cloud("b", 0.0, {}))
    one.step(0.0)
    assert events(one.step(1.0), EventKind.STALE) == []
    one.receive(cloud("b", 1.0, {}))
    assert not one.ready(1.0) and one.ready(1.1)
    fusion = one.step(1.1)
    assert events(fusion, EventKind.STALE) == ["'a' has been silent for too long"]
    assert [fusion.report.sources[name].active for name in "ab"] == [False, True]
    assert by_voxel(fusion) == {HERE: 0.5}, "its entries count until they expire"
    one.receive(cloud("a", 1.2, {}))
    fusion = one.step(1.2)
    assert events(fusion, EventKind.BACK) == ["'a' is back"]
    assert fusion.report.sources["a"].active


def test_a_source_that_never_spoke_is_silent_since_its_first_step() -> None:
    one = integrator(stale_after=1.0)
    one.step(10.0)
    one.plug("a")
    assert [one.step(now).report.sources["a"].active for now in (20.0, 21.0, 21.1)] == [
        True,
        True,
        False,
    ]


def test_each_source_has_a_patience_of_its_own() -> None:
    one = integrator(stale_after=1.0)
    one.plug("a", stale_after=0.1)
    one.plug("b", stale_after=9.0)
    one.step(0.0)
    fusion = one.step(2.0)
    assert [fusion.report.sources[name].active for name in "ab"] == [False, True]


# Report


def test_the_report_tells_rate_age_and_notes() -> None:
    one = integrator()
    for stamp in (0.0, 0.1, 0.2):
        one.receive(cloud("a", stamp, {}, notes=("saturated",) if stamp else ("cold",)))
    one.receive(cloud("b", 0.2, {}))
    report = one.step(0.3).report
    assert report.sources["a"].rate == pytest.approx(10.0)
    assert report.sources["a"].age == pytest.approx(0.1)
    assert math.isnan(report.sources["b"].rate)
    assert report.notes == (("a", "saturated"),)


def test_the_report_counts_how_many_clouds_came_with_each_remark() -> None:
    one = integrator()
    for stamp in (0.0, 0.1, 0.2):
        one.receive(cloud("a", stamp, {}, notes=("saturated", "saturated") if stamp else ("cold",)))
    one.receive(cloud("a", 0.1, {}, notes=("late",)))
    assert one.step(0.3).report.sources["a"].remarks == {"cold": 1, "saturated": 2}


def test_remarks_that_are_always_new_do_not_fill_the_memory() -> None:
    one = integrator()
    for stamp in range(100):
        one.receive(cloud("a", stamp, {}, notes=(f"at {stamp} s",)))
    assert len(one.step(100.0).report.sources["a"].remarks) == 32


def test_an_event_is_told_once() -> None:
    one = integrator()
    one.plug("a")
    assert len(one.step(0.0).report.events) == 1
    assert one.step(0.1).report.events == ()


# Forces


def test_the_force_of_a_voxel_is_the_weighted_mean_of_the_rows_of_a_source() -> None:
    rows = cloud("a", 0.0, [(HERE, 0.25), (HERE, 0.75)], forces=[[4.0, 0, 0], [0, 8.0, 0]])
    assert force(fused(rows)) == [1.0, 6.0, 0.0]


def test_the_force_of_a_voxel_is_the_weighted_mean_across_sources_that_have_one() -> None:
    fusion = fused(
        cloud("a", 0.0, {HERE: 0.25}, forces=[[4.0, 0.0, 0.0]]),
        cloud("b", 0.0, {HERE: 0.75}, forces=[[0.0, 8.0, 0.0]]),
        cloud("c", 0.0, {HERE: 0.5}),
        cloud("motion", 0.0, {HERE: 0.5}, SUPPORT, forces=[[99.0, 99.0, 99.0]]),
        cloud("free", 0.0, {HERE: 0.5}, NULL, forces=[[99.0, 99.0, 99.0]]),
    )
    assert force(fusion) == [1.0, 6.0, 0.0]


def test_opposite_forces_cancel() -> None:
    fusion = fused(
        cloud("a", 0.0, {HERE: 0.5}, forces=[[0.0, 0.0, 5.0]]),
        cloud("b", 0.0, {HERE: 0.5}, forces=[[0.0, 0.0, -5.0]]),
    )
    assert force(fusion) == [0.0, 0.0, 0.0]


def test_without_a_force_there_is_none() -> None:
    fusion = fused(cloud("a", 0.0, {HERE: 0.5}), cloud("b", 0.0, {THERE: 0.5}, forces=[[1, 2, 3]]))
    assert np.isnan(force(fusion)).all() and force(fusion, THERE) == [1.0, 2.0, 3.0]


def test_a_newer_cloud_without_forces_clears_the_force_where_it_speaks() -> None:
    one = integrator()
    one.receive(cloud("a", 0.0, {HERE: 0.5, THERE: 0.5}, forces=[[1, 2, 3], [4, 5, 6]]))
    one.step(0.0)
    one.receive(cloud("a", 0.1, {HERE: 0.5}))
    fusion = one.step(0.1)
    assert np.isnan(force(fusion)).all() and force(fusion, THERE) == [4.0, 5.0, 6.0]


def test_the_force_of_rows_with_one_stamp_is_their_mean_also_over_two_clouds() -> None:
    fusion = fused(
        cloud("a", 0.0, {HERE: 0.25}, forces=[[4.0, 0.0, 0.0]]),
        cloud("a", 0.0, {HERE: 0.75}, forces=[[0.0, 8.0, 0.0]]),
    )
    assert force(fusion) == [1.0, 6.0, 0.0]


# The step


def test_an_empty_integrator_gives_an_empty_step() -> None:
    one = integrator()
    assert one.ready(0.0)
    fusion = one.step(0.0)
    assert fusion.contacts == () and fusion.report.sources == {}
    space = fusion.space
    assert (space.voxels.shape, space.positions.shape, space.forces.shape) == ((0, 3),) * 3
    assert (space.source_likelihoods.shape, space.sources) == ((0, 0), ())


@pytest.mark.parametrize("rule", ["de_morgan", "sets"])
@pytest.mark.parametrize("condensation", ["threshold", "cluster_centroid"])
@pytest.mark.parametrize("expiry", ["source", "voxel"])
def test_empty_clouds_give_an_empty_step(rule: str, condensation: str, expiry: str) -> None:
    clouds = [cloud("a", 0.0, {}), cloud("b", 0.0, {}, NULL, forces=np.empty((0, 3)))]
    fusion = fused(*clouds, rule=rule, condensation=condensation, expiry=expiry)
    assert fusion.contacts == () and fusion.space.source_likelihoods.shape == (0, 2)


def test_rows_come_by_ascending_voxel_and_sources_by_name() -> None:
    voxels = [(1, 0, 0), (-1, 5, 5), (0, 0, 1), (0, 0, -1), (0, -1, 9)]
    fusion = fused(*(cloud(name, 0.0, dict.fromkeys(voxels, 0.5)) for name in ("b", "a", "B")))
    assert voxels_of(fusion) == sorted(voxels)
    assert fusion.space.sources == ("B", "a", "b")
    assert np.array_equal(fusion.space.positions, centres(sorted(voxels)))


def test_where_a_source_says_nothing_its_likelihood_is_nan() -> None:
    space = fused(cloud("a", 0.0, {HERE: 0.5}), cloud("b", 0.0, {THERE: 0.25})).space
    assert np.array_equal(space.source_likelihoods, [[0.5, np.nan], [np.nan, 0.25]], equal_nan=True)


def test_what_a_step_gave_cannot_be_written() -> None:
    space = fused(cloud("a", 0.0, {HERE: 0.5}, forces=[[1, 2, 3]])).space
    for value in vars(space).values():
        assert not isinstance(value, np.ndarray) or not value.flags.writeable


@pytest.mark.parametrize("look_late", [False, True])
@pytest.mark.parametrize("expiry", ["source", "voxel"])
def test_a_later_step_never_changes_an_earlier_one(look_late: bool, expiry: str) -> None:
    rng = np.random.default_rng(1)
    one, twin = integrator(expiry=expiry), integrator(expiry=expiry)
    first = _random_clouds(rng, 0.0)
    for one_cloud in first:
        one.receive(one_cloud)
        twin.receive(one_cloud)
    fusion, expected = one.step(0.0), contents(twin.step(0.0))
    if not look_late:
        assert contents(fusion) == expected
    for stamp in (0.1, 0.2, 0.9, 2.0):
        for one_cloud in _random_clouds(rng, stamp):
            one.receive(one_cloud)
        one.step(stamp)
    one.unplug("a")
    one.reset()
    assert contents(fusion) == expected


def _random_clouds(rng: np.random.Generator, stamp: float) -> list[HypothesisCloud]:
    kinds = {"a": REGULAR, "b": REGULAR, "c": SUPPORT, "d": NULL}
    return [
        HypothesisCloud(
            name,
            kind,
            stamp,
            "base",
            rng.integers(-3, 3, (20, 3)).astype(np.float64) * SIDE,
            rng.choice([0.0, 0.1, 0.5, 1.0], 20),
            rng.normal(size=(20, 3)) if name != "b" else None,
        )
        for name, kind in kinds.items()
    ]


def test_equal_input_gives_equal_bytes() -> None:
    results = []
    for _ in range(2):
        rng, one = np.random.default_rng(2), integrator()
        for stamp in np.arange(20) * 0.05:
            for one_cloud in _random_clouds(rng, float(stamp)):
                one.receive(one_cloud)
            results.append(contents(one.step(float(stamp))))
    assert results[:20] == results[20:]


@pytest.mark.parametrize("gone", "abcd")
def test_without_a_source_is_as_if_it_had_never_spoken(gone: str) -> None:
    clouds = _random_clouds(np.random.default_rng(3), 0.0)
    fusion = fused(*clouds)
    expected = fused(*(one for one in clouds if one.source != gone))
    assert contents(fusion.without(gone)) == contents(expected.alone)
    assert contents(fusion) == contents(fused(*clouds))


def test_a_step_can_be_asked_without_several_sources() -> None:
    clouds = _random_clouds(np.random.default_rng(4), 0.0)
    twice = fused(*clouds).without("a").without("c")
    assert contents(twice) == contents(fused(*(c for c in clouds if c.source in "bd")))


def test_without_a_stranger_names_who_is_there() -> None:
    with pytest.raises(SourceError, match="unknown source 'b': the sources are: a"):
        fused(cloud("a", 0.0, {HERE: 0.5})).without("b")


def test_of_two_million_points_none_is_lost() -> None:
    rng = np.random.default_rng(5)
    points = rng.uniform(-1.0, 1.0, (2_000_000, 3))
    big = HypothesisCloud("lidar", REGULAR, 0.0, "base", points, np.full(len(points), 0.05))
    fusion = fused(big, cloud("skin", 0.0, {HERE: 0.5}))
    x, y, z = np.floor(points * (1.0 / SIDE)).astype(np.int64).T
    expected = np.unique(np.append((x * 1000 + y) * 1000 + z, 0))
    assert len(fusion.space.voxels) == len(expected)
    assert [contact.voxels for contact in fusion.contacts] == [1]


# Silence of a source that would have told


def told(sensitivity: float = 0.99, rule: str = "sets", **plug: Any) -> Integrator:
    """Give an integrator with a source `watch` of some sensitivity, and evidence of 0.95."""
    one = integrator(rule=rule, timeout=0.5)
    one.plug("watch", sensitivity=sensitivity, **plug)
    one.receive(cloud("skin", 0.0, {HERE: 0.95}))
    return one


def existence(fusion: Fusion) -> float:
    return max((member.contact.likelihood for member in fusion.field.members or ()), default=0.0)


LOWERED = 0.95 * 0.01 / (0.05 + 0.95 * 0.01)
"""By Bayes: 0.95 that there is a contact, one that a sensitivity of 0.99 misses."""


def test_silence_of_a_source_that_would_have_told_lowers_existence_by_bayes() -> None:
    assert LOWERED == pytest.approx(0.15966, abs=1e-5)
    one = told()
    one.receive(cloud("watch", 0.0, {}))
    assert existence(one.step(0.0)) == pytest.approx(LOWERED, abs=1e-6)


@pytest.mark.parametrize(("sensitivity", "expected"), [(0.0, 0.95), (0.5, 0.475 / 0.525)])
def test_silence_says_as_much_as_the_sensitivity(sensitivity: float, expected: float) -> None:
    one = told(sensitivity)
    one.receive(cloud("watch", 0.0, {}))
    assert existence(one.step(0.0)) == pytest.approx(expected, abs=1e-6)


def test_the_silence_of_two_counts_twice() -> None:
    one = told(0.9)
    one.plug("guard", sensitivity=0.8)
    one.receive(cloud("watch", 0.0, {}))
    one.receive(cloud("guard", 0.0, {}))
    assert existence(one.step(0.0)) == pytest.approx(0.95 * 0.02 / (0.05 + 0.95 * 0.02), abs=1e-6)


def test_silence_makes_no_contact_and_speaks_against_one_that_is_said_to_be_certain() -> None:
    one = integrator()
    one.plug("watch", sensitivity=0.99)
    one.receive(cloud("watch", 0.0, {}))
    assert existence(one.step(0.0)) == 0.0
    one.receive(cloud("skin", 0.1, {HERE: 1.0}))
    assert existence(one.step(0.1)) == pytest.approx(0.99 * 0.01 / (0.01 + 0.99 * 0.01), abs=1e-6)


def test_a_source_that_never_spoke_has_not_looked() -> None:
    assert existence(told().step(0.0)) == pytest.approx(0.95)


def test_silence_with_a_note_takes_nothing_away() -> None:
    one = told()
    one.receive(cloud("watch", 0.0, {}, notes=("off the surface",)))
    assert existence(one.step(0.0)) == pytest.approx(0.95)


def test_likelihoods_of_nothing_are_silence() -> None:
    one = told()
    one.receive(cloud("watch", 0.0, {HERE: 0.0}))
    assert existence(one.step(0.0)) == pytest.approx(LOWERED, abs=1e-6)


def test_where_voxels_keep_entries_silence_lasts_as_long_as_these() -> None:
    for now, expected in ((0.4, LOWERED), (0.6, 0.95)):
        one = integrator(timeout=0.5, expiry="voxel")
        one.plug("watch", sensitivity=0.99, timeout=5.0)
        one.receive(cloud("watch", 0.0, {}))
        one.receive(cloud("skin", now, {HERE: 0.95}))
        assert existence(one.step(now)) == pytest.approx(expected, abs=1e-6)


def test_a_source_that_tells_of_a_contact_is_not_silent_and_its_newest_cloud_counts() -> None:
    one = told(replace=True)
    one.receive(cloud("watch", 0.0, {HERE: 0.5}))
    assert existence(one.step(0.0)) == pytest.approx(0.975)
    one.receive(cloud("watch", 0.1, {}))
    assert existence(one.step(0.1)) == pytest.approx(LOWERED, abs=1e-6)
    one.receive(cloud("watch", 0.2, {HERE: 0.5}))
    assert existence(one.step(0.2)) == pytest.approx(0.975)


def test_silence_counts_until_exactly_the_timeout_of_its_source() -> None:
    one = told(timeout=0.25)
    one.receive(cloud("watch", 0.0, {}))
    found = [existence(one.step(now)) for now in (0.0, 0.25, 0.250000001)]
    assert found == pytest.approx([LOWERED, LOWERED, 0.95], abs=1e-6)


def test_a_silence_that_is_held_back_or_late_does_not_count() -> None:
    one = told()
    one.receive(cloud("watch", 0.3, {}))
    assert existence(one.step(0.0)) == pytest.approx(0.95)
    one.receive(cloud("watch", 0.35, {HERE: 0.5}))
    one.step(0.35)
    one.receive(cloud("watch", 0.3, {}))
    assert existence(one.step(0.4)) == pytest.approx(0.975)


def test_after_a_reset_nobody_has_been_silent() -> None:
    one = told()
    one.receive(cloud("watch", 0.0, {}))
    one.step(0.0)
    one.reset()
    one.receive(cloud("skin", 0.0, {HERE: 0.95}))
    assert existence(one.step(0.0)) == pytest.approx(0.95)
    one.receive(cloud("watch", 0.0, {}))
    assert existence(one.step(0.0)) == pytest.approx(LOWERED, abs=1e-6), "the plug stays"


def test_plugging_again_or_anew_changes_the_sensitivity() -> None:
    one = told()
    one.receive(cloud("watch", 0.0, {}))
    one.plug("watch")
    assert existence(one.step(0.0)) == pytest.approx(0.95)
    one.unplug("watch")
    one.plug("watch", sensitivity=0.99)
    assert existence(one.step(0.0)) == pytest.approx(0.95), "its cloud was of an earlier plug"


def test_without_a_source_its_silence_is_taken_back() -> None:
    one = told()
    one.receive(cloud("watch", 0.0, {}))
    fusion = one.step(0.0)
    assert existence(fusion.without("watch")) == pytest.approx(0.95)
    assert existence(fusion.without("skin")) == 0.0
    assert existence(fusion) == pytest.approx(LOWERED, abs=1e-6)


def test_silence_moves_no_contact_and_adds_to_no_share() -> None:
    found = []
    for sensitivity in (0.0, 0.3):
        one = integrator()
        one.plug("watch", sensitivity=sensitivity)
        one.receive(cloud("skin", 0.0, {HERE: 0.95, (1, 0, 0): 0.5}))
        one.receive(cloud("watch", 0.0, {}))
        found.append(one.step(0.0).contacts[0])
    assert found[0].position.tolist() == found[1].position.tolist()
    assert found[0].shares == found[1].shares == {"skin": 1.0, "watch": 0.0}
    assert found[1].likelihood / found[0].likelihood == pytest.approx(
        0.7 / (0.05 + 0.95 * 0.7), rel=1e-5
    )


def test_a_rule_of_voxels_does_not_hear_silence() -> None:
    silent, deaf = told(rule="de_morgan"), told(0.0, rule="de_morgan")
    for one in (silent, deaf):
        one.receive(cloud("watch", 0.0, {}))
    assert contents(silent.step(0.0)) == contents(deaf.step(0.0))


@pytest.mark.parametrize("kind", [SUPPORT, NULL])
def test_only_evidence_has_a_sensitivity(kind: HypothesisKind) -> None:
    one = integrator()
    with pytest.raises(SourceError, match=f"sensitivity of 'a' .* not 0.5 of {kind}"):
        one.plug("a", kind, sensitivity=0.5)
    one.plug("a", kind, sensitivity=0.0)
    assert one.step(0.0).report.sources["a"].kind == kind


@pytest.mark.parametrize("sensitivity", [1.0, -0.01, 2.0, math.nan, math.inf])
def test_a_sensitivity_is_a_probability_under_one(sensitivity: float) -> None:
    one = integrator()
    with pytest.raises(SourceError, match="the sensitivity of 'a' is a probability under 1"):
        one.plug("a", sensitivity=sensitivity)
    assert one.step(0.0).report.sources == {}
