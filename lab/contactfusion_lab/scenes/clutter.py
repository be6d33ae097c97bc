"""Clutter: bodies that stand around an object, of which the pipeline knows nothing."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, points_in
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import ObjectConfig, ObjectModel

CLEAR = 0.02
"""Least distance of clutter from the robot on its path [m]."""
DRAWS = 50
"""How often a place is drawn; a body that finds none is left out."""
BESIDE, BESIDE_ANGLE = (0.05, 0.2), 100.0
"""Distance of bodies from the object [m], and their greatest angle from straight behind it
[degrees]."""
HEIGHT, HALF_WIDTH = (0.08, 0.25), (0.02, 0.05)
"""Height of these, and half their width [m]."""
LEG, LEG_ANGLE, LEG_RADIUS, LEG_HEIGHT = (0.6, 0.9), (80.0, 110.0), (0.06, 0.08), 0.9
"""Distance of a leg from the object [m], its angle from straight behind it [degrees], and its size,
from the floor up [m]."""
WALL, WALL_SIZE = (0.3, 0.6), (0.04, 2.5, 2.0)
"""Distance of a wall behind the object's middle, and its thickness, width and height [m]."""


def clutter(
    parent: str, target: FloatArray, out: float, free: FloatArray, rng: np.random.Generator
) -> list[ObjectModel]:
    """A wall behind an object, a leg to a side of it, and one or two bodies near it, all upright.

    Args:
        parent: the frame of all positions, the robot's root link; its z points up, and its origin
            lies on the floor.
        target: shape (n, 3), the corners of the object [m].
        out: azimuth of the direction from the object to the hand [rad].
        free: shape (m, 3), where the robot is on its path; it stays free [m].
        rng: draws number, sizes and places.
    """
    low, high = target.min(axis=0), target.max(axis=0)
    middle = (low + high)[:2] / 2.0
    radius = float(np.linalg.norm(high[:2] - low[:2])) / 2.0
    around = _Clear(free)
    behind = -np.array([np.cos(out), np.sin(out)])
    nearest = float(((np.concatenate([free, target])[:, :2] - middle) @ behind).max()) + CLEAR
    wall = max(float(rng.uniform(*WALL)), nearest)
    found = [_wall(parent, middle + wall * behind, out)]
    for _ in range(DRAWS):
        size, height = rng.uniform(*LEG_RADIUS), LEG_HEIGHT
        angle = out + np.pi + np.radians(rng.choice([-1.0, 1.0]) * rng.uniform(*LEG_ANGLE))
        place = middle + rng.uniform(*LEG) * np.array([np.cos(angle), np.sin(angle)])
        if around.admits(place, size, height):
            found.append(_upright(parent, place, 0.0, height, {"radius": size}, 0.0))
            break
    for _ in range(int(rng.integers(1, 3))):
        for _ in range(DRAWS):
            boxy, width, depth = rng.random() < 0.5, *rng.uniform(*HALF_WIDTH, 2)
            height, yaw = rng.uniform(*HEIGHT), rng.uniform(-np.pi, np.pi)
            size = float(np.hypot(width, depth)) if boxy else width
            angle = out + np.pi + np.radians(rng.uniform(-BESIDE_ANGLE, BESIDE_ANGLE))
            away = radius + rng.uniform(*BESIDE) + size
            ahead = np.array([np.cos(angle), np.sin(angle)])
            place = middle + away * ahead
            within = away * float(ahead @ behind) + size + CLEAR < wall
            if within and around.admits(place, size, low[2] + height):
                edges = {"size": (2.0 * width, 2.0 * depth)} if boxy else {"radius": width}
                found.append(_upright(parent, place, low[2], height, edges, yaw))
                break
    return found


class _Clear:
    """What is taken: the points of the robot, and the upright bodies that stand already."""

    def __init__(self, points: FloatArray) -> None:
        self._points, self._bodies = points, list[tuple[FloatArray, float]]()

    def admits(self, place: FloatArray, radius: float, top: float) -> bool:
        """Whether an upright body fits, which is then there.

        Args:
            place: shape (2,), of its axis [m].
            radius: its greatest distance from that [m].
            top: of its upper end [m].
        """
        beneath = self._points[self._points[:, 2] < top + CLEAR, :2]
        free = np.linalg.norm(beneath - place, axis=1).min(initial=np.inf) > radius + CLEAR
        apart = all(
            np.linalg.norm(there - place) > size + radius + CLEAR for there, size in self._bodies
        )
        if free and apart:
            self._bodies.append((place, radius))
        return bool(free and apart)


def _wall(parent: str, place: FloatArray, yaw: float) -> ObjectModel:
    thick, wide, high = WALL_SIZE
    out = np.array([np.cos(yaw), np.sin(yaw)])
    return _upright(parent, place - thick / 2.0 * out, 0.0, high, {"size": (thick, wide)}, yaw)


def _upright(
    parent: str,
    place: FloatArray,
    bottom: float,
    height: float,
    across: Mapping[str, Any],
    yaw: float,
) -> ObjectModel:
    """A box with a `size` across, or a cylinder with a `radius`."""
    if "radius" in across:
        shape = {"shape": "cylinder", "radius": across["radius"], "length": height}
    else:
        shape = {"shape": "box", "size": (*across["size"], height)}
    x, y = place.tolist()
    pose = {
        "parent": parent,
        "xyz": (x, y, bottom + height / 2.0),
        "rpy": (0.0, 0.0, math.remainder(yaw, math.tau)),
    }
    return ObjectModel(ObjectConfig.model_validate({"shapes": [shape], "pose": pose}))


def points_of(
    robot: RobotModel, poses: Mapping[str, Pose], links: Iterable[str]
) -> Iterator[FloatArray]:
    """Where links are, shape (n, 3) each [m]: their surfaces, and the cameras on them.

    Args:
        robot: the links are its.
        poses: of all links.
        links: of which.
    """
    wanted = set(links)
    yield from (
        points_in(poses[name], part.points) for name, part in robot.parts.items() if name in wanted
    )
    for camera in robot.config.cameras.values():
        if robot.link_of(camera.frame) in wanted:
            pose = poses[robot.link_of(camera.frame)] @ robot.pose_on_link(camera.frame)
            yield pose[None, :3, 3]


def swept(robot: RobotModel, path: Sequence[FloatArray]) -> FloatArray:
    """Where a robot is along a path of joint positions, shape (n, 3) [m]."""
    found = [
        points
        for positions in path
        for points in points_of(robot, robot.poses_at(positions), robot.link_names)
    ]
    return np.concatenate(found)
