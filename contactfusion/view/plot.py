"""Plots a step of the integrator, seen along each axis (extra `plot`)."""

from typing import TYPE_CHECKING, Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.figures import AXES, COLOURS, VERDICT_STYLES, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from contactfusion.integrator.fusion import Fusion

SIGMAS = 2.0
"""Contacts are drawn as ellipses of so many standard deviations."""
PROJECTIONS = ((0, 1), (0, 2), (1, 2))
"""Which axes go to the right and up."""
KIND_MARKERS = {"regular": "o", "support": "^", "null": "x"}
MOST_NAMED = 8
"""Only the likeliest contacts are named beside the picture."""
MILLIMETRES = 1000.0
COLOUR = "#cc0000"


def plot_fusion(fusion: "Fusion") -> "Figure":
    """Plot the hypotheses of each source, voxels by verdict, and contacts with their covariances.

    Args:
        fusion: a step of the integrator.

    Returns:
        A figure in millimetres: above, seen along the thinnest axis, what each source reported and
        what became of it; below, what became of it along the other two.

    Raises:
        DependencyError: matplotlib is not installed.
    """
    figure = new_figure(11.0, 8.5)
    figure.set_layout_engine("compressed")  # of equal scales, without gaps between them
    low, high = _box(fusion)
    extent = high - low
    thinnest = min((2, 1, 0), key=lambda axis: extent[axis])  # from above, where they are equal
    views = sorted(PROJECTIONS, key=lambda across: thinnest in across)
    rows = [max(extent[up] for _, up in pair) for pair in (views[:1], views[1:])]
    grid = figure.subplots(2, 2, height_ratios=rows).flatten()
    for axes, (right, up) in zip(grid, (views[0], *views), strict=True):
        axes.set(
            xlabel=f"{AXES[right]} [mm] in '{fusion.space.frame}'",
            ylabel=f"{AXES[up]} [mm]",
            xlim=(low[right], high[right]),
            ylim=(low[up], high[up]),
            aspect="equal",
        )
    _draw_sources(grid[0], fusion, list(views[0]))
    for axes, across in zip(grid[1:], views, strict=True):
        _draw_voxels(axes, fusion, list(across))
        for number, contact in enumerate(fusion.contacts):
            _draw_contact(axes, contact, number, list(across))
    for axes, title in zip(grid, ("hypotheses by source", "voxels by verdict"), strict=False):
        axes.set_title(title)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2, fontsize="small")
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


def _draw_sources(axes: Any, fusion: "Fusion", across: list[int]) -> None:
    """Draw the hypotheses of each source; the sources stand beside each other inside a voxel."""
    space, entries = fusion.space, fusion.field.entries
    count = len(entries.sources)
    spacing = entries.grid.voxel_size / (count + 1)
    for number, source in enumerate(entries.sources):
        likelihoods = space.source_likelihoods[:, number]
        here = ~np.isnan(likelihoods)
        if here.any():
            x, y = MILLIMETRES * space.positions[here][:, across].T
            axes.scatter(
                x + MILLIMETRES * spacing * (number - (count - 1) / 2.0),
                y,
                s=10.0 + 80.0 * likelihoods[here],
                color=COLOURS[number % len(COLOURS)],
                marker=KIND_MARKERS[source.kind],
                alpha=0.6,
                label=f"{source.name} ({source.kind})",
            )


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
