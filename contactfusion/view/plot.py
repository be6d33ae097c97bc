"""Draws a step of the integrator for a notebook, seen along each axis (extra `plot`)."""

from typing import TYPE_CHECKING, Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.figures import AXES, VERDICT_STYLES, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from contactfusion.integrator.fusion import Fusion

SIGMAS = 2.0
"""Contacts are drawn as ellipses of so many standard deviations."""
PROJECTIONS = ((0, 1), (0, 2), (1, 2))
"""Which axes go to the right and up."""
MOST_NAMED = 8
"""Only the likeliest contacts are named beside the picture."""
MILLIMETRES = 1000.0
COLOUR = "#cc0000"


def plot_fusion(fusion: "Fusion") -> "Figure":
    """Draw voxels by verdict and contacts with their covariances, in millimetres.

    Args:
        fusion: a step of the integrator.

    Raises:
        DependencyError: matplotlib is not installed.
    """
    figure = new_figure(13.0, 4.8)
    low, high = _box(fusion)
    for axes, (right, up) in zip(figure.subplots(1, 3), PROJECTIONS, strict=True):
        _draw_voxels(axes, fusion, [right, up])
        for number, contact in enumerate(fusion.contacts):
            _draw_contact(axes, contact, number, [right, up])
        axes.set(
            xlabel=f"{AXES[right]} [mm]",
            ylabel=f"{AXES[up]} [mm]",
            xlim=(low[right], high[right]),
            ylim=(low[up], high[up]),
            aspect="equal",
        )
    count = len(fusion.contacts)
    figure.suptitle(f"{count} contact{'s' * (count != 1)} in '{fusion.space.frame}'")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize="small")
    return figure


def _box(fusion: "Fusion") -> tuple[FloatArray, FloatArray]:
    """The least and the greatest coordinates to draw, shape (3,) [mm]."""
    space = fusion.space
    ends = [space.positions, *(_ends(contact) for contact in fusion.contacts)]
    points = np.concatenate(ends) if any(map(len, ends)) else np.zeros((1, 3))
    margin = 2.0 * fusion.field.entries.grid.voxel_size
    return (
        MILLIMETRES * (points.min(axis=0) - margin),
        MILLIMETRES * (points.max(axis=0) + margin),
    )


def _ends(contact: Contact) -> FloatArray:
    """The corners of the box around a contact's ellipsoid, shape (2, 3) [m]."""
    reach = SIGMAS * np.sqrt(np.diag(contact.covariance))
    return np.stack([contact.position - reach, contact.position + reach])


def _draw_voxels(axes: Any, fusion: "Fusion", across: list[int]) -> None:
    space = fusion.space
    for verdict, (marker, colour) in VERDICT_STYLES.items():
        here = space.verdicts == verdict
        if here.any():
            x, y = MILLIMETRES * space.positions[here][:, across].T
            size = 10.0 + 80.0 * np.nan_to_num(space.likelihoods[here])
            label = verdict.replace("_", " ")
            axes.scatter(x, y, s=size, color=colour, marker=marker, alpha=0.5, label=label)


def _draw_contact(axes: Any, contact: Contact, number: int, across: list[int]) -> None:
    from matplotlib.patches import Ellipse

    variances, directions = np.linalg.eigh(contact.covariance[np.ix_(across, across)])
    width, height = 2.0 * SIGMAS * MILLIMETRES * np.sqrt(variances.clip(min=0.0))
    angle = np.degrees(np.arctan2(directions[1, 0], directions[0, 0]))
    x, y = MILLIMETRES * contact.position[across]
    axes.add_patch(
        Ellipse((x, y), width, height, angle=angle, fill=False, edgecolor=COLOUR, linewidth=1.5)
    )
    named = number < MOST_NAMED
    label = f"contact {number + 1}: {contact.likelihood:.2f}" if named else None
    axes.scatter([x], [y], s=120.0, color=COLOUR, marker="+", linewidths=2.0, label=label)
