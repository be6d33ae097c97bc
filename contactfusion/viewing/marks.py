"""What voxels, contacts and commands look like."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.contacts import Contact
from contactfusion.controller import Command
from contactfusion.frames import Pose, vectors_in
from contactfusion.integrator.fusion import HypothesisSpace
from contactfusion.viewing.colours import (
    COMMAND,
    CONTACT,
    FORCE,
    NULLED,
    SUPPORT,
    TURN,
    Colours,
    ramp,
)
from contactfusion.viewing.library import loaded_rerun

METRES_PER_NEWTON = 0.01
"""The length of an arrow of force."""
METRES_PER_SPEED = 2.0
"""The length of a command's arrow: where its speed leads to in so many seconds."""
SIGMAS = 2.0
"""Contacts are drawn as ellipsoids of so many standard deviations."""
VOXEL_RADII = {"contact": 0.3, "below_threshold": 0.16, "support_only": 0.16, "nulled": 0.1}
"""Dots for voxels, in sides of a voxel: between them contacts are seen."""
MOST_VOXELS = 5000
"""More voxels of one verdict are thinned evenly."""


def voxels(space: HypothesisSpace, verdict: str, side: float) -> Any:
    """Draw the voxels of one verdict as dots, in the frame of the space.

    Args:
        space: the hypothesis space.
        verdict: which voxels.
        side: of a voxel [m].
    """
    here = np.flatnonzero(space.verdicts == verdict)
    here = here[:: -(-len(here) // MOST_VOXELS) or 1]
    return loaded_rerun().Points3D(
        space.positions[here],
        colors=_voxel_colours(space, verdict)[here],
        radii=VOXEL_RADII[verdict] * side,
    )


def _voxel_colours(space: HypothesisSpace, verdict: str) -> Colours:
    """Give colours by likelihood; support and nulled voxels have a hue of their own."""
    hues = {"support_only": SUPPORT, "nulled": NULLED}
    if verdict not in hues:
        return ramp(space.likelihoods)
    bright = 0.5 + 0.5 * np.nan_to_num(space.likelihoods)[:, None]
    colours: Colours = (bright * np.array(hues[verdict])).astype(np.uint8)
    return colours


def ellipsoids(contacts: Sequence[Contact]) -> Any:
    """Draw contacts with their covariances."""
    rerun = loaded_rerun()
    if not contacts:
        return rerun.Ellipsoids3D(half_sizes=np.empty((0, 3)))
    variances, axes = np.linalg.eigh([contact.covariance for contact in contacts])
    axes[:, :, 0] *= np.linalg.det(axes)[:, None]  # right-handed, so that they are rotations
    return rerun.Ellipsoids3D(
        centers=[contact.position for contact in contacts],
        half_sizes=SIGMAS * np.sqrt(variances.clip(min=0.0)),
        quaternions=Rotation.from_matrix(axes).as_quat(),
        colors=CONTACT,
        fill_mode="majorwireframe",
        line_radii=rerun.Radius.ui_points(1.5),
    )


def labels(contacts: Sequence[Contact]) -> Any:
    """Tell above each contact its likelihood, and which sources gave it."""
    tops = [np.sqrt(contact.covariance[2, 2]) for contact in contacts]
    places = np.array([contact.position for contact in contacts]).reshape(-1, 3)
    return loaded_rerun().Points3D(
        places + np.outer(SIGMAS * np.array(tops), [0.0, 0.0, 1.0]),
        colors=CONTACT,
        radii=1e-4,
        labels=[_label(contact) for contact in contacts],
        show_labels=True,
    )


def forces(contacts: Sequence[Contact]) -> Any:
    """Draw the forces of contacts on the robot, where they are known."""
    felt = [contact for contact in contacts if np.isfinite(contact.force).all()]
    vectors = np.array([contact.force for contact in felt]).reshape(-1, 3)
    return loaded_rerun().Arrows3D(
        origins=np.array([contact.position for contact in felt]).reshape(-1, 3),
        vectors=METRES_PER_NEWTON * vectors,
        colors=FORCE,
        labels=[f"{np.linalg.norm(vector):.1f} N" for vector in vectors],
    )


def command_arrows(command: Command | None, pose: Pose | None) -> Any:
    """Draw a command's velocity, and its turn as an arrow along the axis.

    Args:
        command: what is commanded; None draws nothing.
        pose: of the frame of its twist; None draws nothing.
    """
    rerun = loaded_rerun()
    if command is None or command.twist is None or pose is None:
        return rerun.Arrows3D(vectors=np.empty((0, 3)))
    vectors = vectors_in(pose, np.stack([command.twist.linear, command.twist.angular]))
    moving = np.linalg.norm(vectors, axis=1) > 0.0
    labels = np.array([f"{command.mode}: {command.reason}", "turn"])
    return rerun.Arrows3D(
        origins=np.repeat(pose[None, :3, 3], int(moving.sum()), axis=0),
        vectors=METRES_PER_SPEED * vectors[moving],
        colors=np.array([COMMAND, TURN])[moving],
        labels=labels[moving].tolist(),
    )


def _label(contact: Contact) -> str:
    shares = sorted(contact.shares.items(), key=lambda item: -item[1])
    told = ", ".join(f"{name} {share:.0%}" for name, share in shares if share >= 0.005)
    return f"{contact.likelihood:.2f}: {told}"
