"""What is true in a touch or a push at one instant, as contacts and poses of objects."""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.frames import Pose
from contactfusion.readings import ObjectPose


def true_contact(
    stamp: float, frame: str, place: FloatArray, force: FloatArray, ends: FloatArray | None = None
) -> Contact:
    """A contact that is beyond doubt.

    Args:
        stamp: [s].
        frame: of the arrays.
        place: shape (3,) [m].
        force: shape (3,) [N], on the robot.
        ends: shape (2, 3) [m], of a line; None: the contact is a point.
    """
    return Contact(
        position=place,
        likelihood=1.0,
        dispersion=0.0,
        covariance=np.zeros((3, 3)),
        extent=np.stack([place, place]) if ends is None else ends,
        force=force,
        voxels=0,
        shares={},
        stamp=stamp,
        frame=frame,
    )


def standing(stamp: float, frame: str, poses: Mapping[str, Pose]) -> tuple[ObjectPose, ...]:
    """Where objects stand.

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
