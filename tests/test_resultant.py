"""The force and torque of all contacts: what is known of some says where the others are."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactfusion import Fusion, HypothesisCloud, Integrator, IntegratorConfig
from contactfusion.arrays import FloatArray
from contactfusion.errors import InvalidCloudError
from contactfusion.frames import points_in, pose_at, vectors_in
from contactfusion.hypotheses import HypothesisKind, Resultant
from contactfusion.integrator.resultant import Superposition
from contactfusion.shapes import ShapeConfig
from tests.test_sets import emit

BOX = ShapeConfig(shape="box", size=(0.2, 0.1, 0.04)).sampled("hand", 0.005)
ON_TOP, BESIDE = np.array([-0.08, 0.0, 0.02]), np.array([0.06, 0.05, 0.0])
PUSHES = np.array([[0.0, 0.0, -4.0], [0.0, -5.0, 0.0]])
DEVIATION, FRICTION = 0.003, 1.0


def resultant(places: Any, forces: FloatArray, **options: Any) -> Resultant:
    torques = np.cross(places, forces)
    return Resultant(forces.sum(axis=0), torques.sum(axis=0), np.zeros(3), 0.05, 0.002, **options)


def sum_of(places: Any, forces: FloatArray) -> Superposition:
    return Superposition("wrist", resultant(places, forces), None, DEVIATION, FRICTION)


def nearest(place: FloatArray) -> int:
    return int(np.linalg.norm(BOX.points - place, axis=1).argmin())


BOTH = sum_of([ON_TOP, BESIDE], PUSHES)


def gains(known: FloatArray, measured: Superposition = BOTH) -> FloatArray:
    """Of a further contact everywhere on the box, beside one at a known place."""
    row = [nearest(known)]
    found = measured.maps(BOX.points[row], BOX.normals[row])
    return measured.gains(measured.maps(BOX.points, BOX.normals), found)


@pytest.mark.parametrize(("known", "wanted"), [(ON_TOP, BESIDE), (BESIDE, ON_TOP)])
def test_beside_a_known_contact_few_places_explain_the_rest(
    known: FloatArray, wanted: FloatArray
) -> None:
    found = gains(known)
    assert found[nearest(wanted)] > 5.0
    assert np.mean(found > found[nearest(wanted)]) < 0.03


def test_a_sum_that_is_explained_asks_for_no_further_contact() -> None:
    one = sum_of([ON_TOP], PUSHES[:1])
    row = [nearest(ON_TOP)]
    assert one.unexplained(one.maps(BOX.points[row], BOX.normals[row])) < 1.0
    assert gains(ON_TOP, one).max() < 0.0
    assert BOTH.unexplained(BOTH.maps(BOX.points[row], BOX.normals[row])) > 10.0


def test_contacts_push_and_do_not_pull() -> None:
    across = np.array([0.06, -0.05, 0.0])
    found = gains(ON_TOP)
    assert found[nearest(across)] < found[nearest(BESIDE)] - 10.0


def test_contacts_that_oppose_each_other_are_found_by_their_torque() -> None:
    against = np.array([0.06, 0.0, -0.02])
    measured = sum_of([ON_TOP, against], np.array([[0.0, 0.0, -4.0], [0.0, 0.0, 3.5]]))
    found = gains(ON_TOP, measured)
    best = BOX.points[found.argmax()]
    assert best[2] == pytest.approx(-0.02, abs=0.003) and found.max() > 10.0


@given(st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6))
def test_no_frame_is_special(pose: list[float]) -> None:
    moved = pose_at(pose[:3], pose[3:])
    measured = resultant([ON_TOP, BESIDE], PUSHES)
    other = Superposition("wrist", measured.moved(moved), None, DEVIATION, FRICTION)
    rows = [nearest(ON_TOP), nearest(BESIDE)]
    points, normals = points_in(moved, BOX.points[rows]), vectors_in(moved, BOX.normals[rows])
    maps, here = other.maps(points, normals), BOTH.maps(BOX.points[rows], BOX.normals[rows])
    np.testing.assert_allclose(
        other.gains(maps.at([1]), maps.at([0])), BOTH.gains(here.at([1]), here.at([0])), rtol=1e-6
    )


@pytest.mark.parametrize(
    ("field", "value", "problem"),
    [
        ("force", (0.0, np.nan, 1.0), "force of a resultant"),
        ("origin", (0.0, 0.0), "origin of a resultant"),
        ("torque_deviation", 0.0, "torque_deviation of a resultant is 0, not positive"),
        ("force_deviation", np.inf, "force_deviation of a resultant"),
    ],
)
def test_a_resultant_that_cannot_be_is_refused_by_its_field(
    field: str, value: Any, problem: str
) -> None:
    with pytest.raises(InvalidCloudError, match=problem):
        replace(resultant([ON_TOP], PUSHES[:1]), **{field: value})


# In the fusion


def fused(*clouds: HypothesisCloud) -> Fusion:
    integrator = Integrator(IntegratorConfig(frame="hand"))
    for cloud in clouds:
        integrator.receive(cloud)
    return integrator.step(1.0, BOX)


def wrist(**options: Any) -> HypothesisCloud:
    """A wrench of both contacts, which no single one explains."""
    measured = resultant([ON_TOP, BESIDE], PUSHES, **options)
    return emit("wrist", 0.0, [], notes=("more than one contact",), resultant=measured)


SKIN = emit("skin", 0.95, ON_TOP * 1e3)
AHEAD = emit("ahead", 0.5, BESIDE * 1e3, 6.0, kind=HypothesisKind.SUPPORT)


def test_a_contact_that_the_skin_misses_is_found_by_the_wrench_where_it_is_predicted() -> None:
    found = fused(SKIN, AHEAD, wrist()).contacts
    assert len(found) == 2
    away = [np.linalg.norm(found[0].position - place) for place in (ON_TOP, BESIDE)]
    other = [np.linalg.norm(found[1].position - place) for place in (ON_TOP, BESIDE)]
    assert min(away) < 0.005 and min(other) < 0.015 and np.argmin(away) != np.argmin(other)
    assert max(contact.shares["wrist"] for contact in found) > 0.0


def test_without_the_wrench_a_prediction_makes_none() -> None:
    assert len(fused(SKIN, AHEAD).contacts) == 1


def test_a_sensor_tells_nothing_of_links_that_it_does_not_carry() -> None:
    assert len(fused(SKIN, AHEAD, wrist(links=("forearm",))).contacts) == 1


def test_what_is_felt_without_a_place_is_the_contact_that_the_skin_locates() -> None:
    rows = np.flatnonzero(BOX.points[:, 2] > 0.019)
    finger = emit("finger", 0.9 / len(rows), BOX.points[rows] * 1e3, 6.0, single=True)
    elsewhere = emit("ahead", 0.5, (80, 0, 20), 6.0, kind=HypothesisKind.SUPPORT)
    (contact,) = fused(SKIN, finger, elsewhere).contacts
    assert np.linalg.norm(contact.position - ON_TOP) < 0.006
    assert contact.likelihood > 0.95
