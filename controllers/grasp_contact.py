"""Contacts on a hand: position, push, and the centre of the touched object."""

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
"""The greatest lateral offset of an object, in standard deviations."""
APART = 0.5
"""The length of the median of unit vectors under which they have no direction in common."""


class HandConfig(Model):
    """A hand, and the expected object; in the frame of its tool x is lateral, z forward."""

    box: tuple[Offset, Offset] = (
        (-0.15, -0.1, 0.0),
        (0.15, 0.1, 0.3),
    )
    """The region of contacts on the hand: its least and its greatest x, y and z [m]."""
    radius: Reach = Field(default=0.032, ge=0)
    """Typical radius of objects: the centre lies this far behind a contact [m]."""
    sigma: Spread = Field(default=0.03, gt=0)
    """Standard deviation of the lateral offset of the object's centre [m]."""

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
    """A contact on the hand, in the frame of the tool: x lateral, y up, z forward.

    Attributes:
        position: shape (3,) [m].
        push: shape (3,), unit vector of the force on the hand.
        sources: of the contact, the greatest share first.
    """

    position: FloatArray
    push: FloatArray
    sources: tuple[str, ...]

    def middle(self, radius: float) -> FloatArray:
        """The centre of a round object with this contact, shape (3,) [m].

        Args:
            radius: of the object [m].
        """
        centre: FloatArray = self.position - radius * self.push
        return centre


def on_hand(
    contacts: Sequence[Contact], tool: Pose, surface: Surface | None, hand: HandConfig
) -> HandContact | None:
    """The most plausible contact on a hand; None when there is none.

    Its push is that of its force; without a force, the normal into the nearest point of the robot's
    surface, since contacts push into it. The line of a force may meet the hand at several
    positions; as the object should stand forward of the hand, the likelihood of each is weighed by
    that of the lateral offset of the object's centre. Where the offset is implausible, the contact
    is not with the object.

    Args:
        contacts: of one step.
        tool: its pose in the frame of the contacts.
        surface: of the robot, in that frame.
        hand: the hand, and the expected object.
    """
    back, best, found = inverse(tool), 0.0, None
    low, high = np.array(hand.box)
    for contact in contacts:
        position = points_in(back, contact.position[None])[0]
        push = _push(contact, surface)
        if push is None or (position < low).any() or (position > high).any():
            continue
        shares = sorted(contact.shares, key=lambda name: -contact.shares[name])
        sources = tuple(name for name in shares if contact.shares[name] > 0.0)
        touch = HandContact(position, vectors_in(back, push[None])[0], sources)
        lateral = float(touch.middle(hand.radius)[0])
        if abs(lateral) > IMPLAUSIBLE * hand.sigma:
            continue
        score = contact.likelihood * float(np.exp(-0.5 * (lateral / hand.sigma) ** 2))
        if score > best:
            best, found = score, touch
    return found


def typical(touches: Sequence[HandContact]) -> HandContact:
    """Medians, by axis, of several contacts of one touch.

    Where pushes have no direction in common, the push of the contact nearest to the median counts.
    """
    position = np.median([touch.position for touch in touches], axis=0)
    push = np.median([touch.push for touch in touches], axis=0)
    size = float(np.linalg.norm(push))
    if size < APART:
        away = [float(np.linalg.norm(touch.position - position)) for touch in touches]
        push = touches[int(np.argmin(away))].push
        size = 1.0
    return HandContact(position, push / size, touches[-1].sources)


def _push(contact: Contact, surface: Surface | None) -> FloatArray | None:
    """The direction in which a contact pushes the robot, shape (3,)."""
    size = float(np.linalg.norm(contact.force))
    if size > 0.0:  # NaN without a measured force
        direct: FloatArray = contact.force / size
        return direct
    if surface is None or not len(surface.points):
        return None
    nearest = np.linalg.norm(surface.points - contact.position, axis=1).argmin()
    inward: FloatArray = -surface.normals[nearest]
    return inward
