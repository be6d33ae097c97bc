"""Where a hand comes from, and where on its way it will touch."""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, points_in, pose_of
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import ObjectModel
from contactfusion.robots.solids import loaded_open3d
from contactfusion_lab.simulation.touch_config import TouchConfig

FAR = 0.5
"""The hand is sent ahead from so far outside the object to find out where it touches first [m]."""


def aimed(config: TouchConfig, target: ObjectModel, rng: np.random.Generator) -> Pose:
    """Draw a pose of the tool far from the target, from which it goes ahead along its z.

    Args:
        config: the directions to come from.
        target: the object to touch.
        rng: draws what is left to chance.

    Returns:
        In the frame of the object's pose.
    """
    azimuth, elevation, roll = np.radians(
        [rng.uniform(*each) for each in (config.azimuth, config.elevation, config.roll)]
    )
    level = np.cos(elevation)
    out = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
    side = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    facing = np.stack([-side, np.cross(-out, -side), -out], axis=1)
    turned = facing @ Rotation.from_euler("z", roll).as_matrix()
    lean = np.radians(config.tilt) * np.sqrt(rng.random())
    about = rng.uniform(0.0, 2.0 * np.pi)
    leaning = Rotation.from_rotvec(lean * np.array([np.cos(about), np.sin(about), 0.0]))
    corners = np.concatenate([vertices for vertices, _ in target.solid.meshes])
    low, high = corners.min(axis=0), corners.max(axis=0)
    beside = rng.uniform(-config.wander, config.wander, 3) * (high - low)
    place = points_in(target.config.pose.pose(), ((low + high) / 2.0 + beside)[None])[0]
    # the tilt turns the way, too: the hand goes where it looks
    turned = turned @ leaning.as_matrix()
    away = FAR + float(np.linalg.norm(high - low)) / 2.0
    return pose_of(place - away * turned[:, 2], turned)


def drawn_posture(config: TouchConfig, model: RobotModel, rng: np.random.Generator) -> FloatArray:
    """Draw where the joints stand, shape (n,) [rad, m], within their limits."""
    low, high = model.limits.T
    positions = np.array(
        [
            rng.uniform(*config.posture[name])
            if name in config.posture
            else model.config.still.get(name, 0.0)
            for name in model.joint_names
        ]
    )
    return np.asarray(np.clip(positions, low, high))


def way_to_touch(
    model: RobotModel,
    links: set[str],
    poses: Mapping[str, Pose],
    ahead: FloatArray,
    target: ObjectModel,
) -> float:
    """Tell how far links go before they touch an object; inf when they pass it by.

    Args:
        model: the robot.
        links: those that may touch.
        poses: of all links where they begin, in the frame of the object's pose.
        ahead: shape (3,), the unit vector along which they go.
        target: the object.

    Returns:
        The way [m], as exact as the samples of the surface are dense.
    """
    open3d = loaded_open3d()
    scene = open3d.t.geometry.RaycastingScene()
    for vertices, triangles in target.solid.meshes:
        corners = points_in(target.config.pose.pose(), vertices).astype(np.float32)
        scene.add_triangles(open3d.core.Tensor(corners), open3d.core.Tensor(triangles))
    placed = (
        points_in(poses[name], part.points) for name, part in model.parts.items() if name in links
    )
    points = np.concatenate([np.empty((0, 3)), *placed])  # a link may have no surface
    rays = np.concatenate([points, np.broadcast_to(ahead, points.shape)], axis=1)
    hits = scene.cast_rays(open3d.core.Tensor(rays.astype(np.float32)))["t_hit"].numpy()
    return float(hits.min(initial=np.inf))
