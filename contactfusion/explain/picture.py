"""A picture of a place: the voxels around it by verdict, and the part of each source there."""

import io
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.explain.counterfactual import nearest
from contactfusion.explain.explanation import Explanation
from contactfusion.explain.neighbourhood import Part
from contactfusion.figures import AXES, COLOURS, VERDICT_STYLES, new_figure, plain
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator.fusion import Fusion
from contactfusion.reason import Reason

NARROWEST = 0.04
"""The least half width of the picture [m]."""
WIDEST = 0.3
"""Distance beyond which contacts do not widen the picture [m]."""
SIGMAS = 2.0
LIKELY = {"contact": "over the threshold", "nulled": "with null"}
"""Labels of verdicts where contacts do not come of voxels."""


KINDS = {
    HypothesisKind.REGULAR: COLOURS[0],
    HypothesisKind.SUPPORT: COLOURS[5],
    HypothesisKind.NULL: COLOURS[1],
}
CONTACT_COLOUR = "#cc0000"
BOX = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
Axes = Any


def picture(explanation: Explanation, fusion: Fusion) -> bytes:
    """Draw the place that was asked for, else the likeliest contact, else the first place.

    Args:
        explanation: of the moment.
        fusion: of the same moment.

    Returns:
        A PNG file.

    Raises:
        DependencyError: matplotlib is not installed.
    """
    figure = new_figure(13.0, 5.4)
    around, likelihoods, ages = figure.subplots(1, 3, width_ratios=(1.5, 1.0, 0.8))
    centre, parts, missing, title = _focus(explanation)
    half = _half_width(explanation, fusion, centre)
    across = _across(fusion, centre, half)
    names = {} if fusion.condensation.looks_at_voxels else LIKELY
    _draw_voxels(around, fusion, centre, half, across, names)
    for number, contact in enumerate(fusion.contacts[: len(explanation.contacts)], 1):
        _draw_contact(around, contact, number, across)
    for place in explanation.places:
        _draw_place(around, np.array(place.position), place.reach, across)
    x, y = centre[across] * 1000.0
    around.set(xlim=(x - half, x + half), ylim=(y - half, y + half), aspect="equal")
    around.set_xlabel(plain(f"{AXES[across[0]]} [mm] in '{explanation.frame}'"))
    around.set_ylabel(f"{AXES[across[1]]} [mm]")
    around.set_title(plain(f"{explanation.stamp:.3f} s: {title}"))
    _add_legend(around, 3)
    _draw_sources(likelihoods, ages, parts, missing, explanation)
    content = io.BytesIO()
    figure.savefig(content, dpi=120, format="png")
    return content.getvalue()


def _focus(explanation: Explanation) -> tuple[FloatArray, Sequence[Part], Sequence[Reason], str]:
    """The centre of the picture, the parts of sources there, the missing ones, and a title."""
    asked = [place for place in explanation.places if place.asked]
    if explanation.contacts and not asked:
        contact = explanation.contacts[0]
        return np.array(contact.position), contact.said, contact.missing, "around contact 1"
    if explanation.places:
        place = (asked or explanation.places)[0]
        words = place.reasons[0].why.replace("_", " ")
        return np.array(place.position), place.said, place.missing, f"the circle, {words}"
    return np.zeros(3), (), (), "no contact"


def _half_width(explanation: Explanation, fusion: Fusion, centre: FloatArray) -> float:
    """How far the picture reaches from its middle [mm]."""
    ends = [contact.extent for contact in fusion.contacts[: len(explanation.contacts)]]
    far = [float(np.abs(end - centre).max()) for end in ends]
    reaches = [4.0 * place.reach for place in explanation.places]
    return 1000.0 * max([NARROWEST, *reaches, *(1.3 * away for away in far if away < WIDEST)])


def _across(fusion: Fusion, centre: FloatArray, half: float) -> NDArray[np.intp]:
    """The two axes to draw along.

    Where the nearest contact is away from the middle, those that show how far; else those along
    which the hypotheses near the middle reach furthest.
    """
    space, found = fusion.space, nearest(centre, fusion.contacts)
    reported = _within(space.positions, centre, half) & fusion.field.entries.counted_voxels
    if found is not None and found[1] > 1e-9:
        reaches = np.abs(found[0].position - centre)
    elif reported.any():
        reaches = np.ptp(space.positions[reported], axis=0)
    else:
        return np.array([0, 1])
    return np.sort(np.argsort(-reaches, kind="stable")[:2])


def _within(positions: FloatArray, centre: FloatArray, half: float) -> NDArray[np.bool_]:
    return np.asarray((np.abs(positions - centre) * 1000.0 <= half).all(axis=1))


def _draw_voxels(
    axes: Axes,
    fusion: Fusion,
    centre: FloatArray,
    half: float,
    across: NDArray[np.intp],
    names: Mapping[str, str],
) -> None:
    space = fusion.space
    near = _within(space.positions, centre, half)
    for verdict, (marker, colour) in reversed(VERDICT_STYLES.items()):  # contacts last
        here = near & (space.verdicts == verdict)
        if here.any():
            x, y = (space.positions[here][:, across] * 1000.0).T
            size = 12.0 + 100.0 * space.likelihoods[here]
            label = f"voxel, {names.get(verdict, verdict.replace('_', ' '))}"
            axes.scatter(x, y, s=size, color=colour, marker=marker, alpha=0.6, label=label)


def _draw_contact(axes: Axes, contact: Contact, number: int, across: NDArray[np.intp]) -> None:
    """Draw a contact as the ellipse of two standard deviations of its covariance."""
    from matplotlib.patches import Ellipse

    x, y = contact.position[across] * 1000.0
    values, vectors = np.linalg.eigh(contact.covariance[np.ix_(across, across)])
    wide, high = 2.0 * SIGMAS * np.sqrt(np.maximum(values, 0.0)) * 1000.0
    angle = float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0])))
    axes.add_patch(
        Ellipse((x, y), wide, high, angle=angle, fill=False, color=CONTACT_COLOUR, linewidth=1.5)
    )
    label = f"contact {number}: {contact.likelihood:.2f}, 2σ"
    axes.scatter([x], [y], s=150.0, color=CONTACT_COLOUR, marker="+", linewidths=2.0, label=label)


def _draw_place(axes: Axes, place: FloatArray, reach: float, across: NDArray[np.intp]) -> None:
    from matplotlib.patches import Circle

    x, y = place[across] * 1000.0
    axes.add_patch(Circle((x, y), reach * 1000.0, fill=False, linestyle="--", color="#222222"))


def _draw_sources(
    likelihoods: Axes,
    ages: Axes,
    parts: Sequence[Part],
    missing: Sequence[Reason],
    explanation: Explanation,
) -> None:
    """Draw a bar of likelihood and one of age for each source, missing ones below.

    Args:
        likelihoods: axes for likelihoods.
        ages: axes for ages.
        parts: of sources at the place.
        missing: why other sources have no part there.
        explanation: of the moment.
    """
    names = [part.source for part in parts] + [part.source for part in missing]
    rows = {name: -row for row, name in enumerate(names)}
    timeouts = {source.source: source.timeout for source in explanation.sources}
    for part in parts:
        row, colour = rows[part.source], KINDS[part.kind]
        likelihoods.barh(row, part.likelihood, color=colour, height=0.4)
        ages.barh(row, part.age, color=colour, height=0.4)
        words = plain(f"{part.source} ({part.kind})")
        likelihoods.text(0.02, row + 0.36, words, va="center", fontsize=9, bbox=BOX, zorder=4)
        ages.text(part.age, row, f" {part.age:.2f}", va="center", zorder=4)
    for reason in missing:
        row, words = rows[reason.source], reason.why.replace("_", " ")
        likelihoods.text(
            0.02,
            row,
            plain(f"{reason.source}: {words}"),
            va="center",
            color="#666666",
            bbox=BOX,
            zorder=4,
        )
        age = reason.values.get("told_age_s", reason.values.get("newest_age_s", 0.0))
        ages.barh(row, age, color="#dddddd", height=0.4)
        if age:
            ages.text(age, row, f" {age:.2f}", va="center", zorder=4)
    for name, row in rows.items():
        label = "hypotheses live so long" if row == 0 else None
        ages.plot([timeouts[name]] * 2, [row - 0.4, row + 0.4], color=CONTACT_COLOUR, label=label)
    if not math.isnan(explanation.threshold):
        likelihoods.axvline(
            explanation.threshold, color=CONTACT_COLOUR, linestyle=":", label="threshold"
        )
    likelihoods.set(xlim=(0.0, 1.0), xlabel="likelihood", title="what each source says here")
    ages.set(xlabel="age [s]", title="how long ago")
    ages.margins(x=0.15)
    ages.set_xlim(left=0.0)
    for axes in (likelihoods, ages):
        _add_legend(axes, 1)
        axes.set_ylim(-max(len(rows), 5) + 0.3, 0.7)
        axes.set_yticks([])


def _add_legend(axes: Axes, columns: int) -> None:
    """A legend below the axes, where they have labels."""
    if axes.get_legend_handles_labels()[1]:
        axes.legend(
            loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=columns, fontsize="small"
        )
