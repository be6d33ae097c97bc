"""What voxels and contacts look like."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.contacts import Contact
from contactfusion.integrator.fusion import HypothesisSpace
from contactfusion.viewing.colours import CONTACT, VOXELS
from contactfusion.viewing.library import loaded_rerun

SIGMAS = 2.0
"""Contacts are drawn as ellipsoids of so many standard deviations."""
EDGES = {"contact": 0.9, "below_threshold": 0.6, "support_only": 0.5, "nulled": 0.25}
"""The edges of the boxes for voxels, in sides of a voxel: between them contacts are seen."""
FAINTEST, DENSEST = 40.0, 140.0
"""How opaque the boxes of voxels of likelihood 0 and 1 are, of 255."""
BENEATH = 2.0
"""What is told of a contact stands so far beneath it, in sides of a voxel."""
DOT = 3.5
"""The radius of the dot in a contact, whatever its distance [points of the screen]."""
MOST_VOXELS = 5000
"""More voxels of one verdict are thinned evenly."""


def voxels(space: HypothesisSpace, verdict: str, side: float) -> Any:
    """Draw the voxels of one verdict, the likelier the less translucent, in the frame of the space.

    Args:
        space: the hypothesis space.
        verdict: which voxels.
        side: of a voxel [m].
    """
    here = np.flatnonzero(space.verdicts == verdict)
    here = here[:: -(-len(here) // MOST_VOXELS) or 1]
    likelihoods = np.nan_to_num(space.likelihoods[here])
    colours = np.empty((len(here), 4), np.uint8)
    colours[:, :3] = VOXELS[verdict]
    colours[:, 3] = FAINTEST + (DENSEST - FAINTEST) * likelihoods
    return loaded_rerun().Boxes3D(
        centers=space.positions[here],
        half_sizes=np.full((len(here), 3), EDGES[verdict] * side / 2.0),
        colors=colours,
        fill_mode="solid",
    )


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
        fill_mode=rerun.components.FillMode.TransparentFillMajorWireframe,
        line_radii=rerun.Radius.ui_points(1.5),
    )


def centres(contacts: Sequence[Contact]) -> Any:
    """Draw where contacts are as dots that are seen from afar."""
    rerun = loaded_rerun()
    places = np.array([contact.position for contact in contacts]).reshape(-1, 3)
    return rerun.Points3D(places, colors=CONTACT, radii=rerun.Radius.ui_points(DOT))


def labels(contacts: Sequence[Contact], side: float) -> Any:
    """Tell beneath each contact its likelihood, its force, and which sources gave it.

    Args:
        contacts: of a step.
        side: of a voxel [m].
    """
    deep = [SIGMAS * np.sqrt(contact.covariance[2, 2]) + BENEATH * side for contact in contacts]
    places = np.array([contact.position for contact in contacts]).reshape(-1, 3)
    return loaded_rerun().Points3D(
        places - np.outer(deep, [0.0, 0.0, 1.0]),
        colors=CONTACT,
        radii=1e-4,
        labels=[_label(contact) for contact in contacts],
        show_labels=True,
    )


def _label(contact: Contact) -> str:
    shares = sorted(contact.shares.items(), key=lambda item: -item[1])
    told = ", ".join(f"{name} {share:.0%}" for name, share in shares if share >= 0.005)
    force = float(np.linalg.norm(contact.force))
    felt = f", {force:.3g} N" if np.isfinite(force) else ""
    return f"{contact.likelihood:.2f}{felt}: {told}"
