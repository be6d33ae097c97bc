"""Why there is a contact, and why there is none: of each place, each source, each rule."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import ContactFusionError, TimeError
from contactfusion.explain.explanation import Explanation, PlaceExplanation, as_json
from contactfusion.explain.moment import Past, moment_at
from contactfusion.explain.neighbourhood import MOST
from contactfusion.explain.text import as_text
from contactfusion.reason import Why
from contactfusion.surface import Surface
from tests.clouds import HERE, NULL, REGULAR, SUPPORT, THERE, Voxel, centres, cloud
from tests.explained import Round, explanation, stepped

BESIDE: Voxel = (1, 0, 0)
X, Y, _ = np.eye(3)
PLATE = Surface.rectangle("base", np.zeros(3), 0.3 * X, 0.1 * Y, 0.004)


def skin(stamp: float, likelihood: float = 0.8, voxel: Voxel = HERE) -> Any:
    return cloud("skin", stamp, {voxel: likelihood})


def lidar(stamp: float, likelihood: float = 0.5, voxel: Voxel = HERE) -> Any:
    return cloud("lidar", stamp, {voxel: likelihood})


def free(stamp: float, voxel: Voxel = HERE) -> Any:
    return cloud("free", stamp, {voxel: 1.0}, NULL)


def motion(stamp: float, voxel: Voxel = HERE) -> Any:
    return cloud("motion", stamp, {voxel: 0.3}, SUPPORT)


def place(one: Explanation) -> PlaceExplanation:
    (found,) = one.places
    return found


def lines(*rounds: Round, **options: Any) -> list[str]:
    return as_text(explanation(*rounds, **options)).split("\n")


# Contacts


def test_a_contact_tells_how_its_likelihood_comes_about_and_who_gave_what() -> None:
    told_ = lines((0.0, [skin(0.0)]), (0.2, [lidar(0.2)]))
    assert told_[0] == (
        "0.200 s: 1 contact in 'base' (de_morgan, cluster_centroid, threshold 0.1, "
        "tolerance 10.0 mm)"
    )
    assert told_[2:7] == [
        "contact 1 at (0.003, 0.003, 0.003) m, likelihood 0.90, ± 1.4 mm, 1 voxel",
        "  lidar and skin: 1 - (1 - 0.50)(1 - 0.80) = 0.90",
        "  skin (evidence): 0.80, 0.20 s old, share 62%; without it: a contact of likelihood 0.50",
        "  lidar (evidence): 0.50, 0.00 s old, share 38%; without it: a contact of likelihood 0.80",
        "  motion has never reported anything",
    ]


def test_the_name_of_a_source_ends_no_line() -> None:
    told = lines((0.0, [cloud("skin\ncontact 2", 0.0, {HERE: 0.8})]))
    assert not any(line.startswith("contact 2") for line in told)


def test_one_source_alone_needs_no_formula_and_without_it_nothing_remains() -> None:
    (contact,) = explanation((0.0, [skin(0.0)])).contacts
    assert contact.combination == ""
    (without,) = contact.without
    assert not without.contact and math.isnan(without.likelihood) and math.isnan(without.moved)


def test_a_wide_contact_owns_all_its_voxels_and_makes_no_place_of_them() -> None:
    row = {(x, 0, z): 0.5 for x in range(30) for z in range(10)}
    one = explanation((0.0, [cloud("skin", 0.0, row)]))
    assert [said.voxels for said in one.contacts[0].said] == [300] and one.places == ()
    asked = explanation((0.0, [cloud("skin", 0.0, row)]), at=centres([(29, 0, 9)])[0])
    assert place(asked).reasons[0].why == Why.CONTACT


def test_further_contacts_are_counted_only() -> None:
    many = {(10 * x, 0, 0): 0.5 for x in range(11)}
    one = explanation((0.0, [cloud("skin", 0.0, many)]))
    assert (len(one.contacts), one.omitted) == (8, 3)
    assert "and 3 further contacts, less likely" in as_text(one)


# Places


def test_null_is_named_with_its_likelihood_and_age() -> None:
    one = explanation((0.0, [free(0.0), skin(0.0)]), (0.25, [skin(0.25)]))
    found = place(one)
    assert one.contacts == () and found.reasons[0].why == Why.NULLED
    assert found.reasons[0].sentence == (
        "ruled out by free (likelihood 1.00, 0.25 s old) in 1 of 1 voxel"
    )
    assert found.reasons[0].values["free.age_s"] == pytest.approx(0.25)
    assert {rest.source: rest.contact for rest in found.without} == {"free": True, "skin": False}
    assert any(
        "without it: a contact of likelihood 0.80" in line for line in as_text(one).split("\n")
    )


def test_what_is_under_the_threshold_tells_by_how_much() -> None:
    (reason,) = place(explanation((0.0, [skin(0.0, 0.0625)]))).reasons
    assert reason.why == Why.BELOW_THRESHOLD
    assert reason.sentence == "likelihood 0.06 is 0.04 under the threshold 0.1"


def test_very_little_under_the_threshold_is_not_told_as_nothing() -> None:
    (reason,) = place(explanation((0.0, [skin(0.0, 0.0999)]))).reasons
    assert reason.sentence == "likelihood 0.0999 is 0.0001 under the threshold 0.1"


def test_support_alone_is_named() -> None:
    found = place(explanation((0.0, [motion(0.0)])))
    assert found.reasons[0].sentence == "predicted by motion, but no sensor felt it"


def test_support_that_would_stay_under_the_threshold_is_no_place_but_can_be_asked_for() -> None:
    rounds = (0.0, [cloud("motion", 0.0, {HERE: 0.05}, SUPPORT)])
    assert explanation(rounds).places == ()
    assert place(explanation(rounds, at=(0.0, 0.0, 0.0))).reasons[0].why == Why.SUPPORT_ONLY


def test_null_alone_is_no_place() -> None:
    assert explanation((0.0, [free(0.0)])).places == ()


def test_a_cluster_of_too_few_voxels_says_so() -> None:
    few = place(explanation((0.0, [skin(0.0)]), min_voxels=3))
    assert few.reasons[0].why == Why.TOO_FEW_VOXELS and "wants 3" in few.reasons[0].sentence


def test_evidence_comes_before_prediction_and_the_likelier_first() -> None:
    weak = {HERE: 0.02, THERE: 0.05}
    one = explanation(
        (0.0, [cloud("skin", 0.0, weak), cloud("motion", 0.0, {(90, 0, 0): 0.9}, SUPPORT)])
    )
    assert [found.position for found in one.places] == [
        pytest.approx(centre) for centre in centres([THERE, HERE, (90, 0, 0)])
    ]


def test_no_more_than_a_few_places_are_told() -> None:
    weak = {(10 * x, 0, 0): 0.05 for x in range(20)}
    assert len(explanation((0.0, [cloud("skin", 0.0, weak)])).places) == MOST


# What is missing


def test_a_contact_that_died_tells_who_told_it_and_how_long_its_hypotheses_live() -> None:
    rounds = [(0.0, [skin(0.0)]), (0.5, []), (0.62, [])]
    found = place(explanation(*rounds))
    assert found.last_contact == pytest.approx(0.12)
    assert found.reasons[0].why == Why.EXPIRED
    assert found.reasons[0].sentence == (
        "skin reported 0.80 here 0.62 s ago; its hypotheses live 0.5 s, and nothing came since"
    )


def test_the_timeout_is_the_one_of_the_source() -> None:
    rounds = [(0.0, [skin(0.0)]), (0.2, [])]
    found = place(explanation(*rounds, timeouts={"skin": 0.1}))
    assert "its hypotheses live 0.1 s" in found.reasons[0].sentence


def test_a_source_that_takes_back_what_it_said_is_told_apart_from_one_that_is_silent() -> None:
    rounds = [(0.0, [skin(0.0)]), (0.1, [cloud("skin", 0.1, {})])]
    found = place(explanation(*rounds))
    assert found.reasons[0].why == Why.WITHDRAWN
    assert found.reasons[0].sentence == (
        "skin reported 0.80 here 0.10 s ago, and took it back: 0.00 s ago it found nothing"
    )


def test_a_contact_that_moved_did_not_die() -> None:
    path = [(0.1 * n, [skin(0.1 * n, voxel=(2 * n, 0, 0))]) for n in range(9)]
    assert explanation(*path).places == ()


def test_a_source_that_never_came_or_fell_silent_elsewhere_is_told() -> None:
    rounds = [(0.0, [lidar(0.0, voxel=THERE), skin(0.0)]), (1.3, [skin(1.3)])]
    (contact,) = explanation(*rounds).contacts
    why = {reason.source: reason for reason in contact.missing}
    assert why["lidar"].sentence == "lidar has been silent for 1.30 s; its hypotheses live 0.5 s"
    assert why["motion"].why == Why.NEVER_CAME


def test_sources_that_look_elsewhere_share_a_line() -> None:
    told_ = lines((0.0, [lidar(0.0, voxel=THERE), motion(0.0, voxel=THERE), skin(0.0)]))
    assert "  nothing here from lidar, motion" in told_


def test_late_and_refused_clouds_are_told_of_their_source() -> None:
    rounds = [(0.1, [skin(0.1)]), (0.2, [skin(0.05)])]
    told_ = lines(*rounds)
    assert "skin: clouds 1 late so far; 0.00 s ago: a cloud of 'skin' is 0.05 s late: dropped" in (
        told_
    )


def test_a_silent_source_is_told_at_the_end() -> None:
    told_ = lines((0.0, [skin(0.0)]), (0.7, [lidar(0.7)]))
    assert "skin: silent for 0.70 s; its hypotheses live 0.5 s" in told_
    assert told_[-1] == "the newest cloud of every other source is at most 0.00 s old"


def test_remarks_are_told() -> None:
    told_ = lines((0.0, [cloud("skin", 0.0, {HERE: 0.8}, notes=("saturated",))]))
    assert "skin: remarks: saturated" in told_


# A place that is asked for


def test_a_place_may_be_asked_for_and_tells_all_within_the_tolerance() -> None:
    found = place(explanation((0.0, [skin(0.0, 0.05, BESIDE)]), at=(0.0, 0.0025, 0.0025)))
    assert found.asked and [said.source for said in found.said] == ["skin"]
    assert found.reasons[0].why == Why.BELOW_THRESHOLD


def test_a_place_of_a_contact_says_so() -> None:
    found = place(explanation((0.0, [skin(0.0)]), at=(0.005, 0.0025, 0.0025)))
    assert found.reasons[0].sentence == (
        "this is contact 1, of likelihood 0.80, whose middle is 2.5 mm away"
    )


def test_a_place_with_something_not_far_says_what_is_nearest() -> None:
    found = place(explanation((0.0, [skin(0.0)]), at=(0.0425, 0.0025, 0.0025)))
    assert found.reasons[0].why == Why.NOTHING
    assert "the nearest hypothesis is 40.0 mm away, of skin" in found.reasons[0].sentence


def test_a_place_far_from_everything_is_refused() -> None:
    with pytest.raises(ContactFusionError) as error:
        explanation((0.0, [skin(0.0)]), at=(0.1225, 0.0025, 0.0025))
    assert str(error.value) == (
        "nothing was within 5 cm of (0.122, 0.003, 0.003) m in 'base' at 0 s; the nearest "
        "hypothesis is 12 cm away, of skin"
    )


def test_a_place_where_something_lately_was_is_not_refused() -> None:
    rounds = [(0.0, [skin(0.0)]), (0.1, [skin(0.1, voxel=THERE)])]
    assert place(explanation(*rounds, at=(0.0, 0.0, 0.0))).reasons[0].why == Why.WITHDRAWN


@pytest.mark.parametrize("at", [(np.nan, 0.0, 0.0), (0.0, 0.0)])
def test_what_is_no_place_is_refused(at: tuple[float, ...]) -> None:
    with pytest.raises(ContactFusionError, match="is no place: give x, y and z in m"):
        explanation((0.0, [skin(0.0)]), at=at)


# Over a surface


def unsure(source: str, z: float, x: float = 0.0, stamp: float = 0.0, spread: float = 0.01) -> Any:
    places, spreads = np.array([[x, 0.0, z]]), np.array([spread])
    return cloud(source, stamp, {HERE: 0.8}, positions=places, spreads=spreads)


@pytest.mark.parametrize("rule", ["de_morgan", "sets"])
def test_only_a_newer_cloud_takes_back_what_a_source_said(rule: str) -> None:
    """The camera's hypothesis lies beside the contact, not in it, and is alive."""
    beside = cloud("lidar", 0.0, {(0, 0, 1): 0.05}, spreads=np.array([0.004]))
    clouds = [unsure("skin", 0.0), beside]
    text = as_text(explanation((0.0, clouds), rule=rule, surface=PLATE))
    assert "took it back" not in text


# The moment


def test_the_moment_is_the_last_step_until_then() -> None:
    steps = [*stepped((0.1, [skin(0.1)]), (0.2, []), (0.30000000000000004, []))]
    assert moment_at(steps, 0.25, 0.01).step is steps[1]
    assert moment_at(steps, 0.3, 0.01).step is steps[2]


@pytest.mark.parametrize("time", [0.0, 0.5, math.nan, math.inf])
def test_a_time_outside_the_recording_says_what_there_is(time: float) -> None:
    with pytest.raises(TimeError, match=f"there is nothing at {time:g} s: the (first )?step"):
        moment_at(stepped((0.1, []), (0.2, [])), time, 0.01)


def test_a_recording_without_steps_has_no_moment() -> None:
    with pytest.raises(TimeError, match="leads to no step"):
        moment_at([], 0.0, 0.01)


def test_a_contact_that_leaps_keeps_its_track_and_did_not_die() -> None:
    def leaping(track: int) -> Past:
        past = Past(0.01)
        for stamp, (step,) in enumerate(
            [[*stepped((0.0, [skin(0.0, voxel=(40 * n, 0, 0))]))] for n in range(2)]
        ):
            tracked = tuple(replace(contact, track=track) for contact in step.fusion.contacts)
            past.add(float(stamp), replace(step.fusion, contacts=tracked))
        return past

    assert [dead.stamp for dead in leaping(track=0).dead(1.0)] == [0.0]
    assert leaping(track=7).dead(1.0) == []


def test_where_nothing_is_found_it_is_said_who_found_nothing() -> None:
    nothing = [(0.0, [cloud("skin", 0.0, {})])]
    plugs = {"skin": REGULAR, "lidar": REGULAR}
    assert lines(*nothing, plugs=plugs)[2:] == [
        "found nothing: skin",
        "lidar: never came",
        "the newest cloud of every other source is at most 0.00 s old",
    ]


def test_steps_after_the_moment_are_not_made() -> None:
    left = stepped((0.1, []), (0.2, []), (0.3, []), (0.4, []))
    moment_at(left, 0.2, 0.01)
    assert [step.stamp for step in left] == [0.4]


def test_what_is_long_ago_is_forgotten() -> None:
    past = Past(0.01, seconds=1.0)
    for step in stepped(*((0.1 * n, [skin(0.1 * n, voxel=(5 * n, 0, 0))]) for n in range(40))):
        past.add(step.stamp, step.fusion)
    early, late = centres([(5, 0, 0), (175, 0, 0)])
    assert past.last_reported("skin", early, 0.01) is None
    assert past.last_reported("skin", late, 0.01) == pytest.approx((0.8, 3.5))
    assert len(past.dead(3.9)) == 10


# The account


def test_json_has_no_nan_and_the_names_of_the_account() -> None:
    text = as_json(explanation((0.0, [free(0.0), skin(0.0), lidar(0.0, voxel=THERE)])))
    held = json.loads(text)
    assert held["contacts"][0]["force"] == [None, None, None]
    assert held["places"][0]["reasons"][0]["why"] == "nulled"
    assert held["sources"][0] | {"source": "free", "kind": "null", "late": 0} == held["sources"][0]
    assert "NaN" not in text


def test_the_same_is_told_twice() -> None:
    rounds = [(0.0, [skin(0.0), free(0.0)]), (0.4, [lidar(0.4)])]
    assert as_json(explanation(*rounds)) == as_json(explanation(*rounds))


def test_a_source_without_clouds_is_told_so() -> None:
    assert lines((0.0, []))[0].startswith("0.000 s: no contact in 'base'")
    assert "skin: never came" in lines((0.0, []), plugs={"skin": REGULAR})
