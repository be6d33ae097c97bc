"""The contact on the face that a robot pushes with, by fused contacts alone (O §III-A)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from contactfusion.contacts import Contact
from contactfusion.errors import ConfigurationError
from contactfusion.model import Model
from contactfusion.units import Nearby, Reach, Spread

NARROW = 0.05
"""The span that separates a point from a line (O §III-A) [m]."""


class FaceConfig(Model):
    """The face that a robot pushes with, upright and square to the x of its frame."""

    frame: str = "base"
    """The robot's frame; contacts must be in it."""
    ahead: Nearby = 0.30
    """The x of the face [m]."""
    half_width: Reach = Field(default=0.30, gt=0)
    """Half the width of the face along y [m]."""
    tolerance: Spread = Field(default=0.03, gt=0)
    """The greatest distance of a contact from the face [m]."""
    blur: Spread = Field(default=0.125, gt=0)
    """The width at which the sensor may show one point: twice the width of a taxel, and a bit
    [m]."""


@dataclass(frozen=True, slots=True)
class FaceContact:
    """The contact of the object with the face.

    Attributes:
        lateral: l, the middle of the contact, to the left of the robot's middle [m].
        kind: point or line.
        right: the right end of the contact [m].
        left: the left end of the contact [m].
        likelihood: of the likeliest contact on the face.
    """

    lateral: float
    kind: Literal["point", "line"]
    right: float
    left: float
    likelihood: float


def on_face(contacts: Sequence[Contact], face: FaceConfig) -> FaceContact | None:
    """The contact of the object with the face; None when there is none.

    A contact wider than the sensor's blur counts by its two ends, any other by its position; over
    all contacts on the face, the outermost of these count, as if only they touched (O §III-A).

    Args:
        contacts: of one step, in the face's frame.
        face: the face.

    Raises:
        ConfigurationError: the contacts are in another frame.
    """
    right, left, likelihood = np.inf, -np.inf, 0.0
    for contact in contacts:
        if contact.frame != face.frame:
            raise ConfigurationError(
                f"contacts come in '{contact.frame}', but the face lies in '{face.frame}'; "
                "set `integrator.frame` to the robot's frame"
            )
        x, y = float(contact.position[0]), float(contact.position[1])
        if abs(x - face.ahead) > face.tolerance or abs(y) > face.half_width + face.tolerance:
            continue
        half = _half_width(contact)
        half = half if 2.0 * half > face.blur else 0.0
        right, left = min(right, y - half), max(left, y + half)
        likelihood = max(likelihood, contact.likelihood)
    if right > left:
        return None
    kind: Literal["point", "line"] = "line" if left - right > NARROW else "point"
    return FaceContact((left + right) / 2.0, kind, right, left, likelihood)


def _half_width(contact: Contact) -> float:
    """Half the width along y of a line of even likelihood with the contact's scatter [m].

    `extent` cannot serve: it runs along the longest axis, which is upright for all contacts that
    are narrower than the skin is high.
    """
    return float(np.sqrt(3.0 * max(float(contact.scatter[1, 1]), 0.0)))


def beside(contacts: Sequence[Contact], face: FaceConfig) -> float:
    """The side of the robot, behind its face, with a contact.

    Args:
        contacts: of one step, in the face's frame.
        face: the face.

    Returns:
        1.0 on the left, -1.0 on the right, 0.0 on neither or both.
    """
    sides = {
        float(np.sign(contact.position[1]))
        for contact in contacts
        if contact.position[0] < face.ahead - face.tolerance
        and abs(abs(contact.position[1]) - face.half_width) <= face.tolerance
    }
    return sides.pop() if len(sides) == 1 else 0.0
