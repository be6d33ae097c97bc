"""Figures of the push over time; in each, the moment in which the skin dies."""

import io
from typing import Any

import numpy as np

from contactfusion.figures import COLOURS, new_figure
from contactfusion_lab.demo.account import Story

SOURCES = {"skin": COLOURS[1], "lidar": COLOURS[0], "motion": COLOURS[2]}
"""The colour of each source, here and in the film."""
TRUTH, BELIEVED, DEAD = "#222222", COLOURS[3], "#cc0000"
SIZE = (5.6, 3.6)
"""Small, so that letters are large beside it [inches]."""
Figure = Any


def distance_figure(story: Story) -> bytes:
    """Draw how far the contact is from the target, in truth and as the robot believes."""
    figure, axes = _empty(story, "to the target [m]")
    alone = [one for one in story.alone if one.truth.kind != "none"]
    # between two touches the box stands still
    stamps = [*(one.stamp for one in alone), story.alone[-1].stamp]
    distances = [*(one.truth.distance for one in alone), alone[-1].truth.distance]
    style = {"color": "#888888", "linestyle": ":", "label": "with the skin alone"}
    axes.step(stamps, distances, where="post", **style)
    rows = [(one.stamp, one.truth.distance, one.left) for one in story.moments]
    stamp, true, believed = np.array(rows).T
    axes.plot(stamp, true, color=TRUTH, linewidth=2.5, label="truth")
    axes.plot(stamp, believed, color=BELIEVED, linestyle="--", label="believed")
    axes.axhspan(0.0, story.push.within, color=COLOURS[2], alpha=0.3, label="arrived")
    axes.set_ylim(bottom=0.0)
    return _png(figure, axes)


def lateral_figure(story: Story) -> bytes:
    """Draw where along the face the contact is, in truth, fused, and by each source alone."""
    figure, axes = _empty(story, "contact, left of the middle [cm]")
    stamp = [one.stamp for one in story.moments]
    true = [100.0 * one.truth.contact[1] for one in story.moments]
    fused = [100.0 * one.touch.lateral if one.touch else np.nan for one in story.moments]
    axes.plot(stamp, true, color=TRUTH, linewidth=2.5, label="truth")
    for source in story.last.alone:
        beliefs = [100.0 * one.alone[source] for one in story.moments]
        colour = SOURCES.get(source, "#555555")
        axes.plot(stamp, beliefs, ".", color=colour, markersize=4.0, label=f"{source} alone")
    axes.plot(stamp, fused, color=BELIEVED, linestyle="--", label="fused")
    axes.axhline(0.0, color="#bbbbbb", linewidth=0.8, zorder=0)
    return _png(figure, axes)


def shares_figure(story: Story) -> bytes:
    """Draw how much of the contact's likelihood each source gives."""
    figure, axes = _empty(story, "share of the contact [%]")
    stamp = [one.stamp for one in story.moments]
    shares = [
        [100.0 * one.shares.get(source, 0.0) for one in story.moments] for source in story.sources
    ]
    colours = [SOURCES.get(source, "#555555") for source in story.sources]
    axes.stackplot(stamp, shares, labels=story.sources, colors=colours, alpha=0.8)
    axes.set_ylim(0.0, 100.0)
    return _png(figure, axes)


def png_of(figure: Figure) -> bytes:
    """Give a figure as a PNG file."""
    content = io.BytesIO()
    figure.savefig(content, dpi=160, format="png")
    return content.getvalue()


def _empty(story: Story, label: str) -> tuple[Figure, Any]:
    figure = new_figure(*SIZE)
    axes = figure.subplots()
    axes.axvline(story.dies, color=DEAD, linewidth=1.5, zorder=5)
    axes.annotate(
        "the skin dies",
        (story.dies, 1.0),
        (4.0, -4.0),
        xycoords=("data", "axes fraction"),
        textcoords="offset points",
        color=DEAD,
        va="top",
        zorder=6,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5},
    )
    axes.set(xlabel="time [s]", ylabel=label, xlim=(0.0, story.last.stamp))
    axes.locator_params(axis="x", steps=[1, 2, 5, 10])
    axes.grid(linewidth=0.3, color="#cccccc")
    axes.set_axisbelow(True)
    return figure, axes


def _png(figure: Figure, axes: Any) -> bytes:
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=4, frameon=False)
    return png_of(figure)
