"""Figures of the touch experiment."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from contactfusion.arrays import FloatArray
from contactfusion.figures import COLOURS, new_figure
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.robots.posed import PosedRobot
from contactfusion_lab.experiments.methods import Method
from contactfusion_lab.experiments.touch.rows import (
    believed_robot,
    everything,
    felt,
    fused,
    modality_of,
)
from contactfusion_lab.experiments.touch.trial import Trial
from contactfusion_lab.trials.folder import save_figure
from contactfusion_lab.trials.measures import Measure, parts_of

AROUND = 0.09
"""Pictures show so much around the contact [m]."""
HIGHEST = 16.0
"""Errors are drawn up to this [cm]."""
SLICE = 0.04
"""And the surface of the robot so far before and behind it [m]."""


def draw_touches(outcomes: pd.DataFrame, path: Path) -> Path:
    """Draw ε and σ of every touch, one panel a row of the table (as F Fig 7).

    Args:
        outcomes: of one method, of the rows that are drawn.
        path: the PNG to write.
    """
    rows = {
        row: part.sort_values(["object", "direction", "repeat"])
        for row, part in parts_of(felt(outcomes), "row").items()
    }
    figure = new_figure(13.0, 2.0 * len(rows) + 0.6)
    objects: list[str] = []
    panels = figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
    for number, (axes, (row, touches)) in enumerate(zip(panels, rows.items(), strict=True)):
        errors, sigmas = (touches[name].to_numpy() * 100.0 for name in ("error", "sigma"))
        colour = COLOURS[number % len(COLOURS)]
        x = np.arange(len(touches))
        axes.errorbar(x, errors, sigmas, fmt="o", markersize=3.0, linewidth=0.8, color=colour)
        beyond = errors > HIGHEST
        axes.plot(x[beyond], np.full(beyond.sum(), HIGHEST), "^", markersize=5.0, color=colour)
        silent = x[np.isnan(errors)]
        axes.plot(silent, np.zeros(len(silent)), "|", color="#999999", markersize=6.0)
        axes.axhline(3.0, color="#999999", linewidth=0.6, linestyle="--")
        objects = touches["object"].tolist()
        for border in (i for i in range(1, len(objects)) if objects[i] != objects[i - 1]):
            axes.axvline(border - 0.5, color="black", linewidth=0.6)
        axes.set(ylabel="ε ± σ [cm]", ylim=(-0.5, HIGHEST + 0.6))
        axes.set_title(f"{row}: {len(x) - len(silent)} of {len(x)} report", loc="left", fontsize=9)
    names = ", then ".join(dict.fromkeys(objects))
    panels[-1].set_xlabel(f"touch: {names}; grey ticks report nothing, triangles lie beyond")
    return save_figure(figure, path)


def draw_rows(measures: Sequence[Measure], rows: Sequence[str], method: str, path: Path) -> Path:
    """Draw detection, false alarms and ε of the rows with their intervals.

    Args:
        measures: as in the table.
        rows: which, in their order.
        method: which.
        path: the PNG to write.
    """
    found = {(measure.case, measure.metric): measure for measure in measures}
    figure = new_figure(13.0, 0.36 * len(rows) + 1.8)
    shown = [
        ("detected within 3 cm; × false alarms in free air [%]", 100.0,
         [("detected", "o"), ("false alarms in free air", "x")]),
        ("ε: ○ median, ◇ 90th percentile [cm]", 100.0, [("ε median", "o"), ("ε p90", "D")]),
        ("false contacts a touch", 1.0, [("false contacts a touch", "o")]),
    ]  # fmt: skip
    panels = figure.subplots(1, len(shown), sharey=True)
    places = np.arange(len(rows))[::-1]
    for axes, (title, scale, metrics) in zip(panels, shown, strict=True):
        for metric, marker in metrics:
            for place, row in zip(places, rows, strict=True):
                measure = found.get((f"{row}, {method}", metric))
                if measure is None:
                    continue
                ends = [
                    [(measure.value - measure.low) * scale],
                    [(measure.high - measure.value) * scale],
                ]
                colour = COLOURS[1] if marker == "x" else COLOURS[0]
                axes.errorbar([measure.value * scale], [place], xerr=np.maximum(ends, 0.0),
                              fmt=marker, color=colour, markersize=5.0, linewidth=1.0)  # fmt: skip
        axes.set_title(title, fontsize=9)
        axes.grid(axis="x", linewidth=0.3)
    panels[0].set_yticks(places, rows)
    figure.suptitle(method, fontsize=10)
    return save_figure(figure, path)


def draw_touch(trial: Trial, config: PipelineConfig, method: Method, path: Path) -> Path:
    """Draw the hypotheses of each modality for a touch, the fused voxels, and the contacts.

    Seen from above and from the side, around the true contact; the robot is where it believes to
    be.

    Args:
        trial: the touch.
        config: the pipeline that felt it.
        method: how all of it is fused.
        path: the PNG to write.
    """
    robot = believed_robot(trial.last, config)
    fusion = fused(trial.last, everything(config), method, config)
    middle = _middle(trial, robot)
    figure = new_figure(13.5, 9.0)
    panels = figure.subplots(2, 3, sharex="row", sharey="row")
    for row, (across, depth) in enumerate((((0, 1), 2), ((0, 2), 1))):
        near = np.abs(robot.surface.points[:, depth] - middle[depth]) < SLICE
        for axes in panels[row]:
            axes.scatter(*robot.surface.points[near][:, across].T * 1000.0, s=1.5, color="#cccccc")
        _draw_clouds(panels[row, 0], trial, config, across)
        _draw_fused(panels[row, 1], fusion.space, across)
        _draw_contacts(panels[row, 2], fusion.contacts, across)
        for axes in panels[row]:
            axes.scatter(*trial.places[:, across].T * 1000.0, s=170.0, marker="*", color="black",
                         facecolors="none", linewidths=1.3, label="truth")  # fmt: skip
            low = (middle[list(across)] - AROUND) * 1000.0
            high = (middle[list(across)] + AROUND) * 1000.0
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
            axes.set_xlabel(f"{'xyz'[across[0]]} [mm]")
        panels[row, 0].set_ylabel(f"{'xyz'[across[1]]} [mm]")
    for axes, title in zip(panels[0], ("what each said", "what is fused", "contacts"), strict=True):
        axes.set_title(title)
    for axes in panels[1]:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=3, fontsize="small")
    figure.suptitle(f"{trial.touch.name}: every generator, {method}")
    return save_figure(figure, path)


def _middle(trial: Trial, robot: PosedRobot) -> FloatArray:
    if len(trial.places):
        return np.asarray(trial.places[0])
    positions = [cloud.positions for cloud in trial.clouds.values() if cloud.single and len(cloud)]
    return np.asarray(
        np.concatenate(positions).mean(axis=0) if positions else robot.surface.points[-1]
    )


def _draw_clouds(axes: Any, trial: Trial, config: PipelineConfig, across: tuple[int, int]) -> None:
    """Draw hypotheses, larger where more likely within their cloud."""
    modalities = everything(config).modalities
    colours = {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(modalities)}
    labelled: set[str] = set()
    for name, cloud in trial.clouds.items():
        modality = modality_of(config, name)
        if not cloud.likelihoods.any() or modality in ("motion", "free space"):
            continue  # all of the hand, and all around it
        size = 4.0 + 40.0 * cloud.likelihoods / cloud.likelihoods.max()
        label = None if modality in labelled else f"{modality} ({cloud.kind})"
        labelled.add(modality)
        axes.scatter(*cloud.positions[:, across].T * 1000.0, s=size, alpha=0.5,
                     color=colours.get(modality), label=label)  # fmt: skip


def _draw_fused(axes: Any, space: Any, across: tuple[int, int]) -> None:
    chosen = space.verdicts == "contact"
    order = np.argsort(space.likelihoods[chosen])
    positions = space.positions[chosen][order]
    shown = axes.scatter(*positions[:, across].T * 1000.0, c=space.likelihoods[chosen][order],
                         s=16.0, marker="s", vmin=0.0, vmax=1.0, cmap="viridis",
                         label="voxels over the threshold")  # fmt: skip
    axes.figure.colorbar(shown, ax=axes, shrink=0.7, label="likelihood")


def _draw_contacts(axes: Any, contacts: Sequence[Any], across: tuple[int, int]) -> None:
    from matplotlib.patches import Ellipse

    for number, contact in enumerate(contacts):
        x, y = contact.position[list(across)] * 1000.0
        part = contact.covariance[np.ix_(across, across)] * 1e6
        values, vectors = np.linalg.eigh(part)
        angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
        colour = COLOURS[number % len(COLOURS)]
        wide, high = 4.0 * np.sqrt(np.maximum(values[::-1], 0.0))
        axes.add_patch(Ellipse((x, y), wide, high, angle=angle, fill=False, color=colour))
        axes.scatter([x], [y], s=120.0, marker="+", color=colour, linewidths=2.0,
                     label=f"{number + 1}: {contact.likelihood:.2f}")  # fmt: skip
