"""What else stands and walks around a push: LiDARs and cameras see it, and nothing touches it."""

import math
from collections.abc import Sequence
from typing import NamedTuple, final

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.frames import PlanarPose, planar_rotation
from contactfusion_lab.scenes.push.objects import Part, Triangles, extruded, polygon, rectangle

WALL, NEAREST, FARTHEST = (0.10, 6.0, 2.0), 1.5, 3.5
"""Thickness, length and height of the wall, and its distance from the origin [m]."""
BOXES, FIELD = 5, 3.0
"""Number of boxes, which stand within this of the origin along x and y [m]."""
BEHIND = (0.6, 1.0)
"""One more stands so far behind the object at the start, from middle to middle [m]."""
SMALLEST, LARGEST = (0.2, 0.2, 0.3), (0.6, 0.6, 1.2)
"""Edges of a box [m]."""
BESIDE = 0.05
"""Distance from base and object within which wall and boxes step aside [m]."""
LEG, TALL, SIDES = 0.06, 0.85, 12
"""Radius and height of a leg [m], and the corners of its outline."""
KEPT = 0.15
"""Distance that legs keep from base and object [m]."""
HIP, STRIDE, GAIT = 0.10, 0.15, 0.9
"""How far legs stand to either side of their person, and step ahead and back [m], and the rate of
steps [Hz]."""


class _Person(NamedTuple):
    """How a person walks along beside the object.

    Attributes:
        bearing: in which they are seen from the object, from the base's heading on [rad].
        sway: of the bearing, either way [rad].
        sway_period: [s].
        apart: mean distance of legs from the object, beyond `KEPT` [m].
        drift: of that distance, either way [m].
        drift_period: [s].
        phases: of sway, drift and steps [rad].
    """

    bearing: float
    sway: float
    sway_period: float
    apart: float
    drift: float
    drift_period: float
    phases: tuple[float, float, float]


@final
class Clutter:
    """A wall and boxes that stand in `odom`, and the legs of a person who walks along.

    None of them is solid: what base or object would run into has stepped aside, and is not seen in
    that cycle.

    Args:
        base: outline of the base in its frame, shape (n, 2) [m], convex.
        pushed: outlines of the object in its frame likewise.
        start: pose of the object at the start.
        rng: draws all of them.
    """

    def __init__(
        self,
        base: FloatArray,
        pushed: Sequence[FloatArray],
        start: PlanarPose,
        rng: np.random.Generator,
    ) -> None:
        self._base, self._pushed = base, pushed
        self._still = [_wall(rng)]
        places = [rng.uniform(-FIELD, FIELD, 2) for _ in range(BOXES)]
        places.append(np.array([start[0] + rng.uniform(*BEHIND), start[1]]))
        self._still += [_box(place, rng) for place in places]
        self._person = _drawn(rng)
        self._leg = Part(polygon(SIDES, LEG), LEG, 0.0, TALL, 0.0)

    def seen(self, stamp: float, base: PlanarPose, pushed: PlanarPose) -> list[Triangles]:
        """The surfaces of all that is there, in `odom`.

        Args:
            stamp: [s].
            base: true pose of the base.
            pushed: true pose of the object.
        """
        solid = [_placed(self._base, base), *(_placed(each, pushed) for each in self._pushed)]
        bodies = [body for body in self._still if _clear(body, solid, BESIDE)]
        bodies += [leg for leg in self.legs(stamp, base, pushed) if _clear(leg, solid, KEPT)]
        return [extruded(body) for body in bodies]

    def legs(self, stamp: float, base: PlanarPose, pushed: PlanarPose) -> list[Part]:
        """Both legs, in `odom`, wherever the base may be."""
        person = self._person
        swaying = _wave(stamp, person.sway_period, person.phases[0])
        drifting = _wave(stamp, person.drift_period, person.phases[1])
        bearing = base[2] + person.bearing + person.sway * swaying
        towards = np.array([math.cos(bearing), math.sin(bearing)])
        corners = np.concatenate([_placed(outline, pushed) for outline in self._pushed])
        middle = np.array(pushed[:2])
        # so far along the bearing that no leg is nearer than it shall be, however it steps
        reach = float(((corners - middle) @ towards).max()) + KEPT + LEG + math.hypot(HIP, STRIDE)
        middle = middle + towards * (reach + person.apart + person.drift * drifting)
        step = STRIDE * _wave(stamp, 1.0 / GAIT, person.phases[2])
        turn = planar_rotation(base[2])
        feet = turn @ np.array([step, HIP]), turn @ np.array([-step, -HIP])
        return [self._leg.moved(middle + foot, 0.0, 0.0) for foot in feet]


def gap(outline: FloatArray, other: FloatArray) -> float:
    """A lower bound of the distance between two convex outlines [m]; below 0 they overlap.

    It is the widest strip between them that is parallel to an edge of either.

    Args:
        outline: shape (n, 2) [m].
        other: shape (m, 2) [m].
    """
    edges = np.concatenate([np.roll(each, -1, axis=0) - each for each in (outline, other)])
    normals = np.stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)
    here, there = outline @ normals, other @ normals
    beyond, before = there.min(axis=0) - here.max(axis=0), here.min(axis=0) - there.max(axis=0)
    return float(np.maximum(beyond, before).max())


def _clear(body: Part, solid: Sequence[FloatArray], distance: float) -> bool:
    return all(gap(body.outline, outline) >= distance for outline in solid)


def _placed(outline: FloatArray, pose: PlanarPose) -> FloatArray:
    placed: FloatArray = outline @ planar_rotation(pose[2]).T + pose[:2]
    return placed


def _wave(stamp: float, period: float, phase: float) -> float:
    return math.sin(2.0 * math.pi * stamp / period + phase)


def _wall(rng: np.random.Generator) -> Part:
    thick, length, height = WALL
    yaw, distance = rng.uniform(-math.pi, math.pi), rng.uniform(NEAREST, FARTHEST)
    at = distance * np.array([math.cos(yaw), math.sin(yaw)])
    return Part(rectangle(thick, length), None, 0.0, height, 0.0).moved(at, yaw, 0.0)


def _box(place: FloatArray, rng: np.random.Generator) -> Part:
    x, y, height = rng.uniform(SMALLEST, LARGEST).tolist()
    yaw = rng.uniform(-math.pi, math.pi)
    return Part(rectangle(x, y), None, 0.0, height, 0.0).moved(place, yaw, 0.0)


def _drawn(rng: np.random.Generator) -> _Person:
    side = 1.0 if rng.random() < 0.5 else -1.0
    bearing, sway = np.radians(rng.uniform((50.0, 10.0), (130.0, 40.0))).tolist()
    sway_period, drift_period = rng.uniform(6.0, 15.0, 2).tolist()
    apart, drift = rng.uniform((0.15, 0.05), (0.40, 0.15)).tolist()
    sways, drifts, steps = rng.uniform(-math.pi, math.pi, 3).tolist()
    return _Person(
        side * bearing, sway, sway_period, apart, drift, drift_period, (sways, drifts, steps)
    )
