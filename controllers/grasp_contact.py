"""What a contact on a hand says of the object: where it is touched, where its middle should be."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field, model_validator

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.errors import ConfigurationError
from contactfusion.frames import Pose, inverse, points_in, vectors_in
from contactfusion.model import Model
from contactfusion.surface import Surface
from contactfusion.units import Offset, Reach, Spread

IMPLAUSIBLE = 2.5
"""No object is further aside than so many standard deviations."""
APART = 0.5
"""Unit vectors whose median is shorter have no direction in common."""


class HandConfig(Model):
    """A hand that grasps, and what it expects; in the frame of its tool x is aside, z ahead."""

    box: tuple[Offset, Offset] = (
        (-0.15, -0.1, 0.0),
        (0.15, 0.1, 0.3),
    )
    """The contacts of the hand lie in it: its least and its greatest x, y and z [m]."""
    radius: Reach = Field(default=0.032, ge=0)
    """About that of objects: so far behind the place where it is touched lies its middle [m]."""
    sigma: Spread = Field(default=0.03, gt=0)
    """Standard deviation of how far aside the middle of the object is [m]."""

    @model_validator(mode="after")
    def _ordered(self) -> "HandConfig":
        for axis, low, high in zip("xyz", *self.box, strict=True):
            if low >= high:
                raise ConfigurationError(
                    f"give the least, then the greatest: of {axis} these are {low:g} and {high:g}",
                    "box",
                )
        return self


@dataclass(frozen=True, eq=False)
class HandContact:
    """Where the hand is touched, in the frame of the tool: x aside, y up, z ahead.

    Attributes:
        place: shape (3,) [m].
        push: shape (3,), the unit vector in which the hand is pushed.
        sources: who felt it, the greatest share first.
    """

    place: FloatArray
    push: FloatArray
    sources: tuple[str, ...]

    def middle(self, radius: float) -> FloatArray:
        """Give where the middle of a round object should be, shape (3,) [m].

        Args:
            radius: of the object [m].
        """
        place: FloatArray = self.place - radius * self.push
        return place


def on_hand(
    contacts: Sequence[Contact], tool: Pose, surface: Surface | None, hand: HandConfig
) -> HandContact | None:
    """Give the most plausible contact on a hand; None when there is none.

    Its push is that of its force. Where nobody felt a force, it is the normal into the nearest
    point of the robot's surface: who touches it pushes into it. The line of a force may meet the
    hand at several places; as the object should stand ahead, the likelihood of each is weighed by
    that of the place aside where the middle of the object would be then; where it would be further
    off than it can be, the contact is none of the object's.

    Args:
        contacts: of one step.
        tool: its pose in the frame of the contacts.
        surface: of the robot, in that frame.
        hand: the hand, and what is known of the object.
    """
    back, best, found = inverse(tool), 0.0, None
    low, high = np.array(hand.box)
    for contact in contacts:
        place = points_in(back, contact.position[None])[0]
        push = _push(contact, surface)
        if push is None or (place < low).any() or (place > high).any():
            continue
        shares = sorted(contact.shares, key=lambda name: -contact.shares[name])
        sources = tuple(name for name in shares if contact.shares[name] > 0.0)
        touch = HandContact(place, vectors_in(back, push[None])[0], sources)
        aside = float(touch.middle(hand.radius)[0])
        if abs(aside) > IMPLAUSIBLE * hand.sigma:
            continue
        score = contact.likelihood * float(np.exp(-0.5 * (aside / hand.sigma) ** 2))
        if score > best:
            best, found = score, touch
    return found


def typical(touches: Sequence[HandContact]) -> HandContact:
    """Give what several contacts of one touch have in common: medians, by axis.

    Where pushes have no direction in common, that of the contact nearest to the median counts.
    """
    place = np.median([touch.place for touch in touches], axis=0)
    push = np.median([touch.push for touch in touches], axis=0)
    size = float(np.linalg.norm(push))
    if size < APART:
        away = [float(np.linalg.norm(touch.place - place)) for touch in touches]
        push = touches[int(np.argmin(away))].push
        size = 1.0
    return HandContact(place, push / size, touches[-1].sources)


def _push(contact: Contact, surface: Surface | None) -> FloatArray | None:
    """Give the direction in which a contact pushes the robot, shape (3,)."""
    size = float(np.linalg.norm(contact.force))
    if size > 0.0:  # NaN where nobody felt a force
        direct: FloatArray = contact.force / size
        return direct
    if surface is None or not len(surface.points):
        return None
    nearest = np.linalg.norm(surface.points - contact.position, axis=1).argmin()
    inward: FloatArray = -surface.normals[nearest]
    return inward
