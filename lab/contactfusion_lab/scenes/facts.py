"""Ground truth of a scene at one instant: contacts and poses of objects."""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.frames import Pose
from contactfusion.readings import ObjectPose


def true_contact(
    stamp: float,
    frame: str,
    position: FloatArray,
    force: FloatArray,
    ends: FloatArray | None = None,
) -> Contact:
    """A contact of the ground truth: likelihood 1, covariance 0.

    Args:
        stamp: [s].
        frame: of the arrays.
        position: shape (3,) [m].
        force: shape (3,) [N], on the robot.
        ends: shape (2, 3) [m], of a line contact; None: a point.
    """
    return Contact(
        position=position,
        likelihood=1.0,
        scatter=np.zeros((3, 3)),
        covariance=np.zeros((3, 3)),
        extent=np.stack([position, position]) if ends is None else ends,
        force=force,
        voxels=0,
        shares={},
        stamp=stamp,
        frame=frame,
    )


def standing(stamp: float, frame: str, poses: Mapping[str, Pose]) -> tuple[ObjectPose, ...]:
    """The true poses of objects.

    Args:
        stamp: [s].
        frame: of the poses.
        poses: by the name of the object.
    """
    return tuple(
        ObjectPose(
            stamp=stamp,
            frame=frame,
            name=name,
            position=pose[:3, 3],
            orientation=Rotation.from_matrix(pose[:3, :3]).as_quat(),
        )
        for name, pose in poses.items()
    )
