"""The parts of a first configuration, as lines of YAML with comments."""

import re
from collections.abc import Iterable, Iterator, Sequence
from os.path import relpath
from pathlib import Path
from textwrap import wrap

import numpy as np
import yaml

from contactfusion.readings import Wrench
from contactfusion.robots.model import RobotModel
from contactfusion.vendors import EFFORTS, WRENCHES

REST = 0.5
"""The first seconds of a sensor, from which noise and bias are estimated [s]."""
FORCE_NOISE, TORQUE_NOISE = 0.2, 0.01
"""The least noise that is written [N, N·m], as a sensor drifts, too."""
PLAIN = re.compile(r"[A-Za-z_][\w/.-]*")
"""Text that YAML takes without quotes, also within braces."""


def robot_lines(urdf: str, model: RobotModel, unreported: Sequence[str]) -> Iterator[str]:
    """The robot, with the joints that no topic reports, and its links and joints by name."""
    yield "robot:  # its collision shapes are the surface that is touched"
    yield f"  urdf: {text_of(urdf)}"
    if unreported:
        still = ", ".join(f"{text_of(joint)}: 0.0" for joint in unreported)
        yield "  # no topic reports these joints: say where they stand still [rad, m]"
        yield f"  still: {{{still}}}"
    yield "  # frames of sensors that are no links: {wrist: {parent: LINK, xyz: [0.0, 0.0, 0.0]}}"
    for what, names in ("links", model.link_names), ("joints", model.joint_names):
        listing = f"{what}: {', '.join(names) or 'none'}"
        yield from wrap(listing, 98, initial_indent="  # ", subsequent_indent="  #   ")


def stand_in_lines(sensor: str, frame: str) -> Iterator[str]:
    """A ball in place of the surface that a sensor carries."""
    yield f"# Contacts lie on a surface. This ball stands in for what hangs on {sensor}: put in its"
    yield "# shapes (box, cylinder, sphere, rectangle), or in its place a `robot` by its URDF."
    yield "# The `xyz` of a shape is its centre, the axis of a cylinder is z: from z = 3 to 23 cm"
    yield "# reaches {shape: cylinder, radius: 0.01, length: 0.2, xyz: [0.0, 0.0, 0.13]}."
    yield "surface:  # a stand-in: contacts lie on this ball, wherever the robot is touched"
    yield f"  frame: {text_of(frame)}"
    yield "  shapes: [{shape: sphere, radius: 0.05}]  # [m]"


def integrator_lines(space: str) -> Iterator[str]:
    """The hypothesis space, and the cycle."""
    yield "integrator:"
    yield f"  frame: {text_of(space)}  # of the contacts"
    yield "  voxel_size: 0.005  # [m]"
    yield ""
    yield "cycle: {every: 0.05}  # fuse at this period [s]"


def force_torque_lines(
    name: str,
    sensor: str,
    wrenches: Sequence[Wrench] | None,
    vendor: str = "",
    model: RobotModel | None = None,
) -> Iterator[str]:
    """A six-axis force-torque sensor.

    Args:
        name: of the generator.
        sensor: its name.
        wrenches: its first ones; None where they are unknown.
        vendor: the convention of its driver; empty where it is unknown.
        model: the robot, or None.
    """
    yield f"{text_of(name)}:  # a six-axis force-torque sensor"
    yield "  type: force_torque"
    yield f"  sensor: {text_of(sensor)}"
    options = WRENCHES[vendor].options if vendor else {"sign": "on_robot"}
    axes = options.get("axes")
    if vendor and (axes is None or (model and axes in model.link_names)):
        yield f"  vendor: {vendor}  # sign: {options['sign']}; its frame: {WRENCHES[vendor].frame}"
    else:
        yield f"  sign: {options['sign']}  # or the reverse, where contacts come on the far side"
        if vendor:
            yield f"  # vendor: {vendor}  # in place of sign; it needs a robot with link '{axes}'"
    force, torque, rest = FORCE_NOISE, TORQUE_NOISE, "bias is their mean, taken untouched"
    if wrenches is not None:
        force, torque, bias = _noise(wrenches)
        rest = f"their mean, {bias:.3g} N, is bias" if bias else ""
    yield f"  force_noise: {force:.2g}  # of one sample, by axis [N]"
    yield f"  torque_noise: {torque:.2g}  # [N·m]"
    if rest:
        yield f"  tare: {REST}  # the first {REST} s, at rest: {rest} [s]"
    yield "  # average: 0.1  # over the newest 0.1 s: steadier places, reported that much later [s]"


def _noise(wrenches: Sequence[Wrench]) -> tuple[float, float, float]:
    """The noise of force [N] and torque [N·m], and the bias that a tare removes [N], or 0."""
    if len(wrenches) < 3:
        return FORCE_NOISE, TORQUE_NOISE, 0.0
    samples = np.array([[*wrench.force, *wrench.torque] for wrench in wrenches])
    noise = np.diff(samples, axis=0).std(axis=0) / np.sqrt(2.0)
    force, torque = max(FORCE_NOISE, *noise[:3]), max(TORQUE_NOISE, *noise[3:])
    lasts = wrenches[-1].stamp - wrenches[0].stamp >= 0.9 * REST  # a tare needs all of it
    at_rest = lasts and (samples.std(axis=0) <= 2.0 * np.repeat([force, torque], 3)).all()
    bias = float(np.linalg.norm(samples[:, :3].mean(axis=0)))
    return force, torque, bias if at_rest and bias > force else 0.0


def range_lines(name: str, sensor: str, link: str) -> Iterator[str]:
    """A range camera or a LiDAR."""
    yield f"{text_of(name)}:  # a range camera or a LiDAR: objects that move"
    yield "  type: range"
    yield f"  sensor: {text_of(sensor)}"
    yield from _links(link)


def tactile_lines(name: str, sensor: str, channels: int) -> Iterator[str]:
    """A tactile sensor."""
    yield f"{text_of(name)}:  # taxels in known places"
    yield "  type: tactile"
    yield f"  sensor: {text_of(sensor)}"
    yield f"  patch: {{grid: {{rows: 1, columns: {channels}, pitch: [0.005, 0.005]}}}}  # [m]"
    yield "  baseline: {values: 0.0, noise: 1.0}  # of untouched taxels, in the sensor's unit"


def joint_torque_lines(name: str, sensor: str, vendor: str, joints: Sequence[str]) -> Iterator[str]:
    """Joints that report their efforts; `vendor` is empty where no convention is known."""
    yield f"{text_of(name)}_torque:  # contacts anywhere on the arm, by the torques of its joints"
    yield "  type: joint_torque"
    yield f"  sensor: {text_of(sensor)}"
    if vendor:
        yield f"  vendor: {vendor}"
        yield f"  joints:  # {EFFORTS[vendor].frame}"
    else:
        yield "  effort: external  # or measured, or current: docs/arm_without_skin.md"
        yield "  joints:"
    for joint in joints:
        yield f"    {text_of(joint)}: {{noise: 0.5}}  # what is left in free motion [N·m]"


def switch_lines(name: str, sensor: str, link: str) -> Iterator[str]:
    """A switch."""
    yield f"{text_of(name)}:  # a foot switch or a bumper"
    yield "  type: switch"
    yield f"  sensor: {text_of(sensor)}"
    yield from _links(link, "a contact on which closes it; []: the link that carries its frame")
    yield "  # inverted: true  # where it reports closed while nothing presses it"


def free_space_lines(name: str, sensor: str, link: str) -> Iterator[str]:
    """A depth camera."""
    yield f"{text_of(name)}:  # a depth camera: free space"
    yield "  type: free_space"
    yield f"  sensor: {text_of(sensor)}"
    yield from _links(link)


def motion_lines(name: str, sensor: str) -> Iterator[str]:
    """Joint states."""
    yield f"{text_of(name)}:  # joint states: where the robot is about to be"
    yield "  type: motion"
    yield f"  sensor: {text_of(sensor)}"


def _links(link: str, meaning: str = "those that may touch; []: the whole robot") -> Iterator[str]:
    chosen = f"[{link}]" if link else "[]"
    yield f"  links: {chosen}  # {meaning}"


def indented(lines: Iterable[str]) -> Iterator[str]:
    """Lines one level deeper."""
    return (f"  {line}" for line in lines)


def text_of(text: str) -> str:
    """Text as YAML."""
    plain = PLAIN.fullmatch(text) and yaml.safe_load(text) == text
    return text if plain else yaml.safe_dump(text, default_style='"', width=10**6).strip()


def named_from(path: Path, out: Path) -> str:
    """The path of a file from the folder of the configuration; MODULE:FILE as it is."""
    return str(path) if ":" in str(path) else relpath(path.resolve(), out.parent.resolve())
