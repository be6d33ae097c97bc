"""Pictures of hypotheses, fused voxels and contacts (extra `plot`)."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from contactfusion.errors import missing_extra

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from contactfusion.integrator.fusion import Fusion

AXES = "xyz"
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442", "#000000")
VERDICT_STYLES = {
    "contact": ("s", "#009e73"),
    "below_threshold": ("s", "#bbbbbb"),
    "support_only": ("^", "#56b4e9"),
    "nulled": ("x", "#d55e00"),
}
"""The marker and the colour of voxels, by verdict."""


def new_figure(width: float, height: float) -> "Figure":
    """Give an empty figure, drawn without a screen.

    Args:
        width: [inches].
        height: [inches].

    Raises:
        DependencyError: matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise missing_extra("matplotlib", "plot") from None
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def draw_fusion(fusion: "Fusion", path: Path) -> Path:
    """Draw what each source said, and what became of it, seen along the thinnest axis.

    Args:
        fusion: a step of the integrator.
        path: the picture to write.

    Returns:
        The path.
    """
    space = fusion.space
    positions = space.positions if len(space.positions) else np.zeros((1, 3))
    across = np.sort(np.argsort(-np.ptp(positions, axis=0), kind="stable")[:2])
    margin = 2.0 * fusion.field.entries.grid.voxel_size
    (left, low), (right, high) = (
        (positions[:, across].min(axis=0) - margin) * 1000.0,
        (positions[:, across].max(axis=0) + margin) * 1000.0,
    )
    figure = new_figure(13.0, 5.0)
    given, became = figure.subplots(1, 2)
    for number, source in enumerate(space.sources):
        _draw_source(given, fusion, number, source, across)
    given.set_title("what each source said")
    _draw_verdicts(became, fusion, across)
    became.set_title("what became of it")
    for axes in (given, became):
        axes.set_xlabel(f"{AXES[across[0]]} [mm] in '{space.frame}'")
        axes.set_ylabel(f"{AXES[across[1]]} [mm]")
        axes.set(xlim=(left, right), ylim=(low, high), aspect="equal")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2, fontsize="small")
    figure.savefig(path, dpi=120)
    return path


def _draw_source(axes: Any, fusion: "Fusion", number: int, source: str, across: Any) -> None:
    """Draw the voxels of one source; the sources stand beside each other inside a voxel."""
    space = fusion.space
    likelihoods = space.source_likelihoods[:, number]
    here = ~np.isnan(likelihoods)
    size = fusion.field.entries.grid.voxel_size
    shift = (number - (len(space.sources) - 1) / 2.0) * size / (len(space.sources) + 1)
    x, y = (space.positions[here][:, across] * 1000.0).T
    kind = fusion.report.sources[source].kind if source in fusion.report.sources else ""
    axes.scatter(
        x + shift * 1000.0,
        y,
        s=15.0 + 120.0 * likelihoods[here],
        color=COLOURS[number % len(COLOURS)],
        alpha=0.6,
        marker={"support": "^", "null": "x"}.get(kind, "o"),
        label=f"{source} ({kind})",
    )


def _draw_verdicts(axes: Any, fusion: "Fusion", across: Any) -> None:
    space = fusion.space
    for verdict, (marker, colour) in VERDICT_STYLES.items():
        here = space.verdicts == verdict
        if here.any():
            x, y = (space.positions[here][:, across] * 1000.0).T
            size = 15.0 + 120.0 * space.likelihoods[here]
            label = verdict.replace("_", " ")
            axes.scatter(x, y, s=size, color=colour, marker=marker, alpha=0.7, label=label)
    for number, contact in enumerate(fusion.contacts):
        x, y = contact.position[across] * 1000.0
        label = f"contact {number + 1}: {contact.likelihood:.2f}"
        axes.scatter([x], [y], s=220.0, color="#cc0000", marker="+", linewidths=2.5, label=label)
