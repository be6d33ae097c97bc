"""The columns of a table that hold the joints of an arm, by their names."""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from os.path import commonprefix
from typing import final

from contactfusion.readings.columns import Column, written_out
from contactfusion.vendors import EFFORTS, convention_of

UNITS = {"positions": "rad", "velocities": "rad/s", "efforts": "N·m or A"}
WORDS = {
    **dict.fromkeys(("q", "pos", "position", "positions", "angle", "angles"), "positions"),
    **dict.fromkeys(("dq", "qd", "qdot", "vel", "velocity", "velocities"), "velocities"),
    **dict.fromkeys(("tau", "effort", "efforts", "torque", "torques"), "efforts"),
    **dict.fromkeys(("current", "currents"), "efforts"),
}
"""What columns hold whose name ends with a word."""
NOT_MEASURED = {"target", "desired", "cmd", "command", "commanded", "ref", "reference", "goal"}
NUMBERED = re.compile(r"(?P<group>.*?)[^A-Za-z0-9]*(?P<joint>\d{1,2})\]?")
"""A column of an array: `q1`, `actual_q_0`, `state.q[0]`."""
NAMED = re.compile(r"(?P<before>.*?)(?P<joint>[^/.\s]+)[/.](?P<group>position|velocity|effort)")
"""A value of a message: `/joint_states/elbow_joint/position`."""
LEAST = 2
"""The least number of joints of an arm: a single numbered column may be anything."""


@final
@dataclass(frozen=True)
class JointColumns:
    """The columns of an arm's joints.

    Attributes:
        sensor: a name for them, which holds the convention of the efforts where one is known.
        names: the joints, in the order of the columns; empty where columns have but numbers.
        positions: their columns, as many as joints.
        velocities: likewise, or empty.
        efforts: likewise, or empty.
    """

    sensor: str
    names: tuple[str, ...]
    positions: tuple[Column, ...]
    velocities: tuple[Column, ...]
    efforts: tuple[Column, ...]

    @property
    def by_kind(self) -> dict[str, tuple[Column, ...]]:
        """The columns of all that is held, in the order of a description."""
        held = {name: getattr(self, name) for name in UNITS}
        return {name: columns for name, columns in held.items() if columns}

    def uses(self) -> Iterator[tuple[Column, str]]:
        """Each column with its probable meaning."""
        singular = {"positions": "position", "velocities": "velocity", "efforts": "effort"}
        for kind, columns in self.by_kind.items():
            for number, column in enumerate(columns):
                joint = self.names[number] if self.names else f"joint {number + 1}"
                yield column, f"{singular[kind]} of {joint} [{UNITS[kind]}]"


def joint_columns(names: Sequence[Column], robot: Sequence[str] = ()) -> JointColumns | None:
    """The joints that columns hold: positions, and the velocities and efforts of the same joints.

    Of several arms it is the first; of several efforts one that a driver is known to report.

    Args:
        names: of the columns, in their order.
        robot: the joints of the robot that they move, where it is known: where nothing else shows
            joints, columns with their names are positions.
    """
    held = _groups(names)
    arms = (key for key, found in held.items() if key[0] == "positions" and _whole(found))
    if (arm := next(arms, None)) is None:
        called = tuple(str(name) for name in names if name in robot)
        return JointColumns("joints", called, called, (), ()) if called else None
    joints = held[arm].keys()
    chosen = {"positions": arm[1], "velocities": "", "efforts": ""}
    for kind in ("velocities", "efforts"):
        fit = [key[1] for key, found in held.items() if key[0] == kind and found.keys() == joints]
        chosen[kind] = max(fit, key=lambda group: _fit(group, arm[1]), default="")
    columns = {
        kind: tuple(held[kind, group][joint] for joint in joints) if group else ()
        for kind, group in chosen.items()
    }
    vendor = convention_of("joint_torque", chosen["efforts"])
    named = tuple(joint for joint in joints if not joint.isdecimal())
    return JointColumns(chosen["efforts"] if vendor else "joints", named, **columns)


def range_of(columns: Sequence[Column]) -> str:
    """The range of a description that stands for columns; empty where they are none."""
    text = f"{columns[0]}..{columns[-1]}"
    with suppress(ValueError):  # it is no range
        if written_out(text) == [*columns]:
            return text
    return ""


def _groups(names: Sequence[Column]) -> Mapping[tuple[str, str], dict[str, Column]]:
    """Columns by joint, by what they hold and the text that their names share."""
    held: dict[tuple[str, str], dict[str, Column]] = {}
    for name in names:
        if match := NAMED.fullmatch(str(name)):
            kind, group = WORDS[match["group"]], f"{match['before']}{match['group']}"
        elif isinstance(name, str) and (match := NUMBERED.fullmatch(name)):
            group = match["group"]
            kind = _kind(group)
        else:
            continue
        if kind:
            held.setdefault((kind, group), {})[match["joint"]] = name
    return held


def _kind(group: str) -> str:
    """What the columns of an array hold; empty where its name says nothing of joints."""
    if convention_of("joint_torque", group):
        return "efforts"
    words = re.findall(r"[a-z]+", group.lower())
    if not words or NOT_MEASURED.intersection(words):
        return ""
    return WORDS.get(words[-1], "efforts" if words[0] == "tau" else "")


def _whole(found: Mapping[str, Column]) -> bool:
    """Whether columns are those of an arm: several, and none between them is missing."""
    numbers = [int(joint) for joint in found if joint.isdecimal()]
    gaps = bool(numbers) and numbers != [*range(numbers[0], numbers[0] + len(numbers))]
    return len(found) >= LEAST and not gaps


def _fit(group: str, arm: str) -> tuple[int, int]:
    """How well a group goes with the positions: by a common beginning, then a known driver."""
    vendor = convention_of("joint_torque", group)
    known = [*EFFORTS].index(vendor) if vendor else len(EFFORTS)
    return len(commonprefix([group, arm])), -known
