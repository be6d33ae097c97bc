"""Bars of what each source says at a place, and how long ago."""

from collections.abc import Sequence
from typing import Any

from contactfusion.explaining.account import Account, Said
from contactfusion.explaining.reason import Reason
from contactfusion.figures import COLOURS
from contactfusion.hypotheses import HypothesisKind

KINDS = {
    HypothesisKind.REGULAR: COLOURS[0],
    HypothesisKind.SUPPORT: COLOURS[5],
    HypothesisKind.NULL: COLOURS[1],
}
TOLD = "#cc0000"
BOX = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
Axes = Any


def draw_sources(
    likelihoods: Axes,
    ages: Axes,
    said: Sequence[Said],
    missing: Sequence[Reason],
    account: Account,
) -> None:
    """Draw a bar of likelihood and one of age for each source, missing ones below.

    Args:
        likelihoods: axes for likelihoods.
        ages: axes for ages.
        said: what sources say at the place.
        missing: why others say nothing there.
        account: of the moment.
    """
    names = [one.source for one in said] + [one.source for one in missing]
    rows = {name: -row for row, name in enumerate(names)}
    timeouts = {one.source: one.timeout for one in account.sources}
    for one in said:
        row, colour = rows[one.source], KINDS[one.kind]
        likelihoods.barh(row, one.likelihood, color=colour, height=0.4)
        ages.barh(row, one.age, color=colour, height=0.4)
        words = f"{one.source} ({one.kind})"
        likelihoods.text(0.02, row + 0.36, words, va="center", fontsize=9, bbox=BOX, zorder=4)
        ages.text(one.age, row, f" {one.age:.2f}", va="center", zorder=4)
        if one.fit == one.fit:
            label = "fit: as a part of its best place" if one is said[0] else None
            likelihoods.plot(one.fit, rows[one.source], "D", color="#000000", label=label, zorder=5)
    for reason in missing:
        row, words = rows[reason.source], reason.why.replace("_", " ")
        likelihoods.text(
            0.02, row, f"{reason.source}: {words}", va="center", color="#666666", bbox=BOX, zorder=4
        )
        age = reason.values.get("told_age_s", reason.values.get("newest_age_s", 0.0))
        ages.barh(row, age, color="#dddddd", height=0.4)
        if age:
            ages.text(age, row, f" {age:.2f}", va="center", zorder=4)
    for name, row in rows.items():
        label = "hypotheses live so long" if row == 0 else None
        ages.plot([timeouts[name]] * 2, [row - 0.4, row + 0.4], color=TOLD, label=label)
    if account.condensation != "modes":
        likelihoods.axvline(account.threshold, color=TOLD, linestyle=":", label="threshold")
    likelihoods.set(xlim=(0.0, 1.0), xlabel="likelihood", title="what each source says here")
    ages.set(xlabel="age [s]", title="how long ago")
    ages.margins(x=0.15)
    ages.set_xlim(left=0.0)
    for axes in (likelihoods, ages):
        add_legend(axes, 1)
        axes.set_ylim(-max(len(rows), 5) + 0.3, 0.7)
        axes.set_yticks([])


def add_legend(axes: Axes, columns: int) -> None:
    """Put the legend below, if there is anything to name."""
    if axes.get_legend_handles_labels()[1]:
        axes.legend(
            loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=columns, fontsize="small"
        )
