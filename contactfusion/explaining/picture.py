"""A picture of a place: the voxels around it by verdict, and what each source says there."""

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.explaining.account import Account, Said
from contactfusion.explaining.bars import add_legend, draw_sources
from contactfusion.explaining.reason import Reason
from contactfusion.explaining.remains import nearest
from contactfusion.figures import AXES, VERDICT_STYLES, new_figure
from contactfusion.integrator.fusion import Fusion

NARROWEST = 0.04
"""At least so much is shown to each side [m]."""
WIDEST = 0.3
"""Contacts that end further away do not widen the picture [m]."""
SIGMAS = 2.0
TOLD = "#cc0000"
LIKELY = {"contact": "over the threshold"}
"""What a verdict is called where contacts do not come of voxels."""
Axes = Any


def picture(account: Account, fusion: Fusion) -> bytes:
    """Draw the place that was asked for, else the likeliest contact, else the first place.

    Args:
        account: of the moment.
        fusion: of the same moment.

    Returns:
        A PNG file.

    Raises:
        DependencyError: matplotlib is not installed.
    """
    figure = new_figure(13.0, 5.4)
    around, likelihoods, ages = figure.subplots(1, 3, width_ratios=(1.5, 1.0, 0.8))
    centre, said, missing, title = _focus(account)
    half = _half_width(account, fusion, centre)
    across = _across(fusion, centre, half)
    _draw_voxels(
        around, fusion, centre, half, across, LIKELY if account.condensation == "modes" else {}
    )
    for number, contact in enumerate(fusion.contacts[: len(account.contacts)], 1):
        _draw_contact(around, contact, number, across)
    for place in account.places:
        _draw_place(around, np.array(place.position), place.reach, across)
    x, y = centre[across] * 1000.0
    around.set(xlim=(x - half, x + half), ylim=(y - half, y + half), aspect="equal")
    around.set_xlabel(f"{AXES[across[0]]} [mm] in '{account.frame}'")
    around.set_ylabel(f"{AXES[across[1]]} [mm]")
    around.set_title(f"{account.stamp:.3f} s: {title}")
    add_legend(around, 3)
    draw_sources(likelihoods, ages, said, missing, account)
    content = io.BytesIO()
    figure.savefig(content, dpi=120, format="png")
    return content.getvalue()


def _focus(account: Account) -> tuple[FloatArray, Sequence[Said], Sequence[Reason], str]:
    """Give where the picture looks, with what is and is not said there."""
    asked = [place for place in account.places if place.asked]
    if account.contacts and not asked:
        contact = account.contacts[0]
        return np.array(contact.position), contact.said, contact.missing, "around contact 1"
    if account.places:
        place = (asked or account.places)[0]
        words = place.reasons[0].why.replace("_", " ")
        return np.array(place.position), place.said, place.missing, f"the circle, {words}"
    return np.zeros(3), (), (), "no contact"


def _half_width(account: Account, fusion: Fusion, centre: FloatArray) -> float:
    """Give how far the picture reaches from its middle [mm]."""
    ends = [one.extent for one in fusion.contacts[: len(account.contacts)]]
    far = [float(np.abs(end - centre).max()) for end in ends]
    return 1000.0 * max(
        NARROWEST, 4.0 * account.tolerance, *(1.3 * one for one in far if one < WIDEST)
    )


def _across(fusion: Fusion, centre: FloatArray, half: float) -> NDArray[np.intp]:
    """Give the two axes to draw along.

    Where the nearest contact is away from the middle, those that show how far; else those along
    which what is told near the middle reaches furthest.
    """
    space, found = fusion.space, nearest(centre, fusion.contacts)
    told = _within(space.positions, centre, half) & fusion.field.entries.counted_voxels
    if found is not None and found[1] > 1e-9:
        reaches = np.abs(found[0].position - centre)
    elif told.any():
        reaches = np.ptp(space.positions[told], axis=0)
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
    turn = float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0])))
    axes.add_patch(Ellipse((x, y), wide, high, angle=turn, fill=False, color=TOLD, linewidth=1.5))
    label = f"contact {number}: {contact.likelihood:.2f}, 2σ"
    axes.scatter([x], [y], s=150.0, color=TOLD, marker="+", linewidths=2.0, label=label)


def _draw_place(axes: Axes, place: FloatArray, reach: float, across: NDArray[np.intp]) -> None:
    from matplotlib.patches import Circle

    x, y = place[across] * 1000.0
    axes.add_patch(Circle((x, y), reach * 1000.0, fill=False, linestyle="--", color="#222222"))
