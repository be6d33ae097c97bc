"""Images of a box on the floor before the mobile base, drawn pixel by pixel from straight above."""

import numpy as np

from contactfusion import Grid, State
from contactfusion.arrays import FloatArray
from contactfusion.frames import FrameTree, Pose, points_in, pose_at
from contactfusion.readings import DepthImage
from contactfusion.vision import back_projected

HEIGHT, FLOOR = 1.1, -0.45
"""Of the camera and of the floor in the robot's frame [m]."""
POSE: Pose = pose_at((0.40, 0.0, HEIGHT), (np.pi, 0.0, -np.pi / 2.0))
"""Of the camera: ahead is up in the image, left is left."""
PAINT, GREY = (200, 120, 60), (120, 118, 112)


def intrinsics(width: int, height: int) -> FloatArray:
    """Of a lens of 55 degrees."""
    focal = width / 2.0 / np.tan(np.radians(27.5))
    middle = (width - 1) / 2.0, (height - 1) / 2.0
    return np.array([[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]])


def picture(
    near: float = 0.301,
    sides: tuple[float, float] = (-0.2, 0.2),
    top: float = 0.35,
    width: int = 160,
    stamp: float = 0.0,
    paint: tuple[int, int, int] = PAINT,
) -> DepthImage:
    """See the top of a box 0.25 m deep, whose walls stay unseen."""
    height = width * 3 // 4
    camera, (rows, columns) = intrinsics(width, height), np.indices((height, width))
    seen = back_projected(rows, columns, np.full((height, width), HEIGHT - top), camera)
    x, y, _ = points_in(POSE, seen.reshape(-1, 3)).T.reshape(3, height, width)
    mask = (x >= near) & (x <= near + 0.25) & (y >= sides[0]) & (y <= sides[1])
    return DepthImage(
        stamp=stamp,
        frame="camera",
        sensor="camera",
        depth=np.where(mask, HEIGHT - top, HEIGHT - FLOOR),
        intrinsics=camera,
        colour=np.where(mask[..., None], paint, GREY).astype(np.uint8),
        mask=mask,
    )


def state() -> State:
    """The robot, its camera where the images are taken from."""
    return State(now=0.0, grid=Grid("base", 0.005), frames=FrameTree({"camera": ("base", POSE)}))
