"""The robot that is described on the network, beside that of the configuration."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.recordings.mcap import DESCRIPTION

TOPIC = f"/{DESCRIPTION}"
"""The topic of a URDF, as std_msgs/String; who comes late receives it, too."""
APART, TURNED = 1e-3, 5e-3
"""Origins of a joint that differ by less are the same [m, rad]."""
NAMED = 4
"""The most joints that a clause names."""


class _Joint(NamedTuple):
    place: FloatArray
    turn: Rotation


def differences(theirs: str, ours: str) -> Iterator[str]:
    """How the robot on the network is another than that of the configuration, as clauses.

    Args:
        theirs: the URDF on the network.
        ours: the URDF of the configuration.
    """
    try:
        there, here = _joints(theirs), _joints(ours)
    except (ElementTree.ParseError, ValueError) as error:
        yield f"it can't be read: {error}"
        return
    if lacking := [name for name in here if name not in there]:
        yield f"it lacks {_named(lacking)}"
    if further := [name for name in there if name not in here]:
        yield f"it has {_named(further)} besides"
    for name in (name for name in here if name in there):
        apart = float(np.linalg.norm(there[name].place - here[name].place))
        turned = float((there[name].turn * here[name].turn.inv()).magnitude())
        if apart > APART or turned > TURNED:
            yield (
                f"its joint {name} stands {1e3 * apart:.1f} mm and {np.degrees(turned):.1f} "
                "degrees beside that of the configuration"
            )


def _joints(urdf: str) -> Mapping[str, _Joint]:
    """The joints of a URDF with their origins, by name.

    Raises:
        ElementTree.ParseError: it is no XML.
        ValueError: an origin holds no three finite numbers.
    """
    joints = {}
    for joint in ElementTree.fromstring(urdf).findall("joint"):
        origin = joint.find("origin")
        fields = {} if origin is None else origin.attrib
        place, angles = (_three(fields.get(key, "0 0 0")) for key in ("xyz", "rpy"))
        joints[joint.get("name", "")] = _Joint(place, Rotation.from_euler("xyz", angles))
    return joints


def _three(text: str) -> FloatArray:
    numbers = np.array([float(each) for each in text.split()])
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise ValueError(f"'{text}' is no origin of a joint")
    return numbers


def _named(joints: list[str]) -> str:
    more = f" and {len(joints) - NAMED} more" if len(joints) > NAMED else ""
    kind = "the joint" if len(joints) == 1 else "the joints"
    return f"{kind} {', '.join(sorted(joints)[:NAMED])}{more}"
