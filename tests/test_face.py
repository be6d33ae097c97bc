"""Contacts tell where the object touches the face."""

import numpy as np
import pytest

from contactfusion.contacts import Contact
from contactfusion.controllers.face import FaceConfig, on_face
from contactfusion.errors import ConfigurationError

FACE = FaceConfig()


def contact(
    y: float,
    half: float = 0.0,
    x: float = 0.3,
    likelihood: float = 0.8,
    frame: str = "base",
    spread: float = 0.0,
) -> Contact:
    """Make a contact 20 cm high that reaches `half` to both sides of y, evenly likely."""
    position, scatter = np.array([x, y, 0.2]), np.array([0.0, half**2 / 3.0, 0.1**2 / 3.0])
    return Contact(
        position=position,
        likelihood=likelihood,
        scatter=np.diag(scatter),
        covariance=np.diag(scatter) + np.eye(3) * (1e-5 + spread**2),
        extent=np.array([position, position]),
        force=np.full(3, np.nan),
        voxels=1,
        shares={"skin": 1.0},
        stamp=0.0,
        frame=frame,
    )


def test_nothing_is_no_contact() -> None:
    assert on_face([], FACE) is None


def test_one_narrow_contact_is_a_point_where_it_is() -> None:
    touch = on_face([contact(0.12)], FACE)
    assert touch is not None
    assert touch.kind == "point"
    assert (touch.lateral, touch.right, touch.left) == pytest.approx((0.12, 0.12, 0.12))


def test_the_width_of_a_taxel_or_two_is_blur_not_width() -> None:
    touch = on_face([contact(-0.1, half=0.06)], FACE)
    assert touch is not None
    assert (touch.kind, touch.right, touch.left) == ("point", -0.1, -0.1)


def test_hypotheses_that_are_unsure_of_their_place_do_not_widen_a_contact() -> None:
    for half in (0.0, 0.15):
        sharp, blurred = (on_face([contact(0.05, half, spread=s)], FACE) for s in (0.0, 0.08))
        assert sharp is not None and blurred is not None and sharp.kind == blurred.kind
        assert (blurred.right, blurred.left) == pytest.approx((sharp.right, sharp.left))


def test_two_contacts_are_a_line_between_them() -> None:
    """A flat side that touches at both ends."""
    touch = on_face([contact(0.2, likelihood=0.5), contact(-0.1, likelihood=0.9)], FACE)
    assert touch is not None
    assert touch.kind == "line"
    assert (touch.lateral, touch.right, touch.left) == pytest.approx((0.05, -0.1, 0.2))
    assert touch.likelihood == 0.9


def test_two_contacts_close_together_are_a_point() -> None:
    touch = on_face([contact(0.10), contact(0.14)], FACE)
    assert touch is not None
    assert touch.kind == "point"
    assert touch.lateral == pytest.approx(0.12)


def test_a_wide_contact_is_told_by_its_ends() -> None:
    touch = on_face([contact(0.05, half=0.15)], FACE)
    assert touch is not None
    assert touch.kind == "line"
    assert (touch.right, touch.left, touch.lateral) == pytest.approx((-0.10, 0.20, 0.05))


def test_the_outermost_ends_count() -> None:
    """A point within a wide contact changes nothing, one beyond it does."""
    wide = contact(0.0, half=0.1)
    for other, ends in ((contact(0.05), (-0.1, 0.1)), (contact(0.25), (-0.1, 0.25))):
        touch = on_face([wide, other], FACE)
        assert touch is not None
        assert (touch.right, touch.left) == pytest.approx(ends)


@pytest.mark.parametrize(
    "elsewhere",
    [
        contact(0.3, x=0.1),  # on the left side
        contact(0.0, x=-0.42),  # behind
        contact(0.0, x=0.40),  # before the face
        contact(0.40, x=0.30),  # past its end
    ],
)
def test_what_is_not_on_the_face_does_not_count(elsewhere: Contact) -> None:
    assert on_face([elsewhere], FACE) is None
    touch = on_face([elsewhere, contact(0.1)], FACE)
    assert touch is not None
    assert touch.lateral == 0.1


def test_the_order_of_contacts_does_not_matter() -> None:
    several = [contact(0.2, likelihood=0.9), contact(-0.25, half=0.04), contact(0.0, half=0.1)]
    assert on_face(several, FACE) == on_face(several[::-1], FACE)


def test_a_contact_in_another_frame_is_told_in_a_sentence() -> None:
    with pytest.raises(ConfigurationError, match="come in 'map', but the face lies in 'base'"):
        on_face([contact(0.0, frame="map")], FACE)
