"""Of the contacts of a set: who made each, what was taken for clutter, why two are not one."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from contactfusion import HypothesisCloud, Integrator, IntegratorConfig
from contactfusion.explain.explanation import Explanation, PlaceExplanation, as_json, explanation_of
from contactfusion.explain.moment import Settings, moment_at
from contactfusion.explain.text import as_text, explain_fusion
from contactfusion.hypotheses import Resultant
from contactfusion.pipeline import Step
from contactfusion.reason import Why
from contactfusion.surface import Surface
from tests.clouds import NULL, SUPPORT
from tests.test_sets import DOWN, FINGERS, PALM, PATCH, emit, fused

FACE = [(0, y, z) for y in range(-475, 476, 50) for z in (-150, -100, -50)]
SKIN = emit("skin", (0.9, 0.5, 0.4), [(0, 1, 0), (5, 1, 0), (0, 6, 0)])
STUCK = emit("skin", 0.95, (-30, -20, 0))
CAMERA = emit("camera", 0.4, PATCH + (28, 14, 0), 12.0)
FORCES: dict[str, Any] = {"single": True, "forces": np.array([DOWN] * 9)}
WRIST = emit("wrist", 0.1, PATCH + (20, 10, 0), 6.0, **FORCES)


def explained(
    *rounds: tuple[HypothesisCloud, ...],
    surface: Surface | None = PALM,
    at: Any = None,
    silent: str = "",
    **config: Any,
) -> Explanation:
    """The account of the last of some steps, 20 ms apart; a place is in mm."""
    law = IntegratorConfig(frame="hand", **config)
    integrator, steps = Integrator(law), []
    for cloud in rounds[0]:
        sensitivity = 0.5 * (cloud.source == silent)
        integrator.plug(cloud.source, cloud.kind, replace=True, sensitivity=sensitivity)
    for number, clouds in enumerate(rounds):
        now = 1.0 + 0.02 * number
        for cloud in clouds:
            integrator.receive(replace(cloud, stamp=now))
        steps.append(Step(now, integrator.step(now, surface), None))
    place = None if at is None else [each / 1e3 for each in at]
    moment = moment_at(steps, steps[-1].stamp, 0.01)
    return explanation_of(moment, Settings(law, {}), place)


def why(*clouds: HypothesisCloud, **options: Any) -> str:
    """How the likelihood of the likeliest contact comes about."""
    return explained(clouds, **options).contacts[0].combination


def place(*clouds: HypothesisCloud, **options: Any) -> PlaceExplanation:
    (found,) = explained(clouds, **options).places
    return found


# Which sources made this contact


@pytest.mark.parametrize("at", [(0, 475, -100), (0, -325, -150), (0, 0, -100)])
def test_what_is_part_of_a_line_or_a_patch_belongs_to_it(at: Any) -> None:
    face = emit("skin", 0.9, FACE, 50 / 12**0.5)
    one = explained((face,), surface=None)
    assert one.places == () and one.contacts[0].said[0].voxels == len(FACE)
    there = place(face, surface=None, at=at)
    assert there.reasons[0].why == Why.CONTACT


def test_at_the_end_of_a_contact_a_source_is_worth_what_it_is_worth_to_the_contact() -> None:
    line = [(x, 0, 0) for x in range(-30, 31, 5)]
    skins = [emit(name, 0.9, line, 2.0) for name in ("skin", "other")]
    there = place(*skins, at=(28, 0, 0))
    assert all(rest.contact and rest.moved < 1e-3 for rest in there.without)


def test_two_sources_apart_that_make_one_contact_are_named_with_all_that_they_gave() -> None:
    camera = emit("camera", 0.4, PATCH + (18, 8, 0), 12.0)
    (contact,) = explained((SKIN, camera)).contacts
    assert contact.combination == "P(contact) 0.94 by camera 0.40 and skin 0.90"
    assert {said.source: said.voxels for said in contact.said} == {"camera": 9, "skin": 3}
    (reason,) = place(SKIN, camera, at=(18, 8, 0)).reasons
    assert reason.why == Why.ELSEWHERE
    assert reason.sentence == "what camera gave here is explained by contact 1, 16.7 mm away"


def test_support_and_silence_tell_what_they_change() -> None:
    skin, here = emit("skin", 0.8, (0, 0, 0)), emit("motion", 0.5, (0, 0, 0), kind=SUPPORT)
    raised = "P(contact) 0.90 by skin 0.80; motion (support) raises it from 0.80 to 0.90"
    assert why(skin, here, surface=None) == raised
    lowered = why(skin, emit("wrist", 0.0, []), silent="wrist")
    assert lowered.endswith("; the silence of wrist lowers it from 0.80 to 0.67")


def test_support_that_confirms_a_contact_from_afar_has_its_line_and_share() -> None:
    far = emit("motion", 0.5, (20, 0, 0), 12.0, SUPPORT)
    one = explained((emit("skin", 0.8, (0, 0, 0)), far))
    shares = {said.source: said.share for said in one.contacts[0].said}
    assert shares["motion"] > 0.2 and sum(shares.values()) == pytest.approx(1.0)
    assert "motion (support): reaches here from 18.1 mm: 0.50" in as_text(one)


def test_a_force_that_needs_a_contact_is_named_and_so_is_each_of_two() -> None:
    two = emit("skin", 0.8, [(-30, 0, 0), (30, 0, 0)])
    between = emit("wrist", 0.1 / 3, PATCH / 2, 4.0, **FORCES)
    assert "the force of wrist, which needs it, raises it from 0.80 to " in why(two, between)
    (reason,) = place(two, between, at=(0, 0, 0)).reasons
    told = "what wrist gave here is explained by contact 1, 30.0 mm away, and by contact 2, "
    assert reason.sentence.startswith(told)
    sums = [
        emit(
            name, 0.0, [], resultant=Resultant(np.array(DOWN), np.zeros(3), np.zeros(3), 0.2, 0.01)
        )
        for name in ("arm", "wrist")
    ]
    told = why(two, *sums)
    assert "the force of arm, which needs it" in told and "the force of wrist, which" in told


def test_a_contact_of_which_nothing_tells_in_this_step_says_so() -> None:
    here, there = emit("skin", 0.9, (0, 0, 0)), emit("skin", 0.9, (30, 20, 0))
    one = explained(*[(here,)] * 5, (there,))
    (contact,) = one.contacts
    assert contact.combination.endswith(" over time; in this step no source tells of it")
    assert contact.said == () and contact.missing[0].why == Why.WITHDRAWN
    assert "but one step alone makes no contact" in one.places[0].reasons[0].sentence


# What was taken for clutter


def test_a_stuck_taxel_tells_whose_force_is_explained_without_it() -> None:
    one = explained((STUCK, CAMERA, WRIST))
    (found,) = one.places
    assert found.reasons[0].why == Why.IMPROBABLE
    assert found.reasons[0].sentence == (
        "P(contact) 0.31 by skin 0.95; the force of wrist, explained without it, lowers it from "
        "0.95 to 0.31, under the existence 0.5 that is asked for"
    )
    assert as_text(one).count("explained without it") == 1
    assert one.contacts[0].combination.startswith("P(contact) 1.00 by camera 0.40 and wrist 0.90")


def test_clutter_amid_what_a_contact_explains_is_a_place_of_its_own() -> None:
    stuck, camera = emit("skin", 0.95, (-5, -5, 0)), emit("camera", 0.4, PATCH * 3 + (13, 4, 0), 12)
    wrist = emit("wrist", 0.1, PATCH + (25, 10, 0), **FORCES)
    first, second = place(stuck, camera, wrist).reasons
    assert "explained without it, lowers it from 0.95" in first.sentence
    assert second.sentence == "what camera gave here is explained by contact 1, 27.4 mm away"


def test_what_is_too_faint_or_off_the_surface_is_not_said_to_be_explained() -> None:
    skin = emit("skin", 0.8, (0, 0, 0))
    faint = place(skin, emit("camera", 0.05, (30, 20, 0))).reasons
    assert [reason.sentence for reason in faint] == [
        "what camera gave here is too faint for a contact: 0.05"
    ]
    (off,) = place(skin, emit("camera", 0.9, (0, 0, 400))).reasons
    assert off.sentence.startswith("no contact explains what camera gave here: it lies off the")


# Why two are not one


def test_two_presses_are_two_by_the_detections_of_their_source_or_by_sources_of_their_own() -> None:
    two = [(-10, 0, 0), (10, 0, 0)]
    assert why(emit("skin", 0.8, two, 3.0)) == (
        "P(contact) 0.80 by skin 0.80; contact 2, 20.0 mm away, is another: skin gave a detection "
        "of each"
    )
    apart = [emit(f"tip_{x}", 0.8, (x, 0, 0), 2.0) for x in (-20, 20)]
    assert why(*apart).endswith("is another: no source tells of both")
    assert "another" not in why(emit("skin", 0.8, [(-30, 0, 0), (30, 0, 0)]))


# Null


def test_null_tells_what_it_does_to_the_probability_and_rules_nothing_out() -> None:
    free = emit("camera", 0.6, PATCH + (5, 2, 0), kind=NULL)
    told = "P(contact) 0.82 by skin 0.90; camera (null) lowers it from 0.90 to 0.82"
    assert why(SKIN, free) == told
    beside = emit("camera", 0.9, [(12, 2, 0), (16, 2, 0)], kind=NULL)
    (reason,) = place(SKIN, beside, at=(24, 2, 0)).reasons
    assert reason.why == Why.NULLED and reason.source == "camera"
    assert reason.sentence.startswith("camera (null) gave 0.90 here, where no other source says")
    assert reason.sentence.endswith("; it lowers contact 1, 23.9 mm away, from 0.90 to 0.89")
    sure = explained((emit("skin", 0.6, (0, 0, 0)), emit("camera", 0.95, PATCH, kind=NULL)))
    assert sure.contacts == () and sure.places[0].reasons[0].why == Why.IMPROBABLE
    for one in (explained((SKIN, free)), explained((SKIN, beside)), sure):
        assert "ruled out" not in as_text(one)
    assert explain_fusion(fused(SKIN, free, surface=PALM)).endswith("9 with null")


def test_support_where_null_is_was_felt_by_no_sensor() -> None:
    far = [emit(name, 0.9, (30, 20, 0), kind=kind) for name, kind in (("m", SUPPORT), ("f", NULL))]
    first, second = place(SKIN, *far, at=(30, 20, 0)).reasons
    assert first.sentence == "predicted by m, but no sensor felt it"
    assert second.sentence == "f (null) gave 0.90 here"


# Where else


def test_a_contact_that_may_lie_at_another_end_tells_where_and_how_probably() -> None:
    ends = [(x, y, z) for x in (-34, 34) for y in (-2, 2) for z in (-2, 2)]
    force = emit("force", 0.9 / 8, ends, single=True)
    told = why(force, surface=FINGERS)
    assert "P(contact) 0.90 by force 0.90; it lies here with 50%, else with 50% at (" in told
    contact = explained((force,), surface=FINGERS).contacts[0]
    other = -np.sign(contact.position[0]) * 34
    (reason,) = place(force, surface=FINGERS, at=(other, 0, 0)).reasons
    assert reason.why == Why.ELSEWHERE
    assert reason.sentence.startswith("what force gave here is explained by contact 1, 6")
    assert reason.sentence.endswith(" mm away, which lies here with 50%")


# What is printed of the law


@pytest.mark.parametrize(
    ("condensation", "law"),
    [
        ("members", "(sets, members, threshold 0.5)"),
        (
            "cluster_centroid",
            "(de_morgan, cluster_centroid, threshold 0.1, tolerance 10.0 mm)",
        ),
    ],
)
def test_only_what_a_condensation_goes_by_is_printed(condensation: str, law: str) -> None:
    one = explained((SKIN,), condensation=condensation)
    assert as_text(one).split("\n")[0] == f"1.000 s: 1 contact in 'hand' {law}"
    kept = json.loads(as_json(one))
    assert (kept["tolerance"] is None) == math.isnan(one.tolerance) == ("tolerance" not in law)
    assert (kept["threshold"] is None) == ("threshold" not in law)


def test_of_clusters_of_a_set_the_contact_near_a_voxel_is_told() -> None:
    (contact,) = explained((SKIN,), rule="sets", condensation="cluster_centroid").contacts
    assert contact.combination == "P(contact) 0.90 by skin 0.90"
    assert {said.source for said in contact.said} == {"skin"}


def test_over_time_a_source_is_compared_with_the_step_by_itself() -> None:
    both = emit("skin", 0.8, PATCH), emit("lidar", 0.3, PATCH, 5.0)
    account = explained(
        *[both] * 10, (emit("skin", 0.8, PATCH), emit("motion", 0.001, PATCH, 5.0, SUPPORT))
    )
    (contact,) = account.contacts
    rest = {each.source: each for each in contact.without}
    assert contact.likelihood > 0.95 > rest["motion"].before
    assert rest["motion"].likelihood == pytest.approx(rest["motion"].before, abs=0.005)
    (line,) = [each for each in as_text(account).splitlines() if each.startswith("  motion")]
    assert line.endswith("; without it: the same")


def test_a_contact_over_time_of_which_the_step_has_none_says_so() -> None:
    faint = emit("skin", 0.3, PATCH), emit("motion", 0.3, PATCH, 5.0, SUPPORT)
    account = explained(*[(emit("skin", 0.9, PATCH),)] * 10, faint)
    (contact,) = account.contacts
    assert contact.likelihood > 0.5
    assert all(math.isnan(each.before) for each in contact.without)
    assert "this step by itself has no contact here, with or without it" in as_text(account)
