"""Learning curves of both networks over all rounds (extra `plot`)."""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.figures import COLOURS, new_figure
from contactfusion.files import write_whole

TITLES = {
    "location": "location: mean square error of the scaled l",
    "type": "type: cross-entropy",
}


def draw_curves(histories: Mapping[str, Sequence[FloatArray]], path: Path) -> Path:
    """Draw the losses of all epochs; rounds follow each other, each with its lowest one marked.

    Args:
        histories: for each network those of its rounds, shape (epochs, 2): training, validation.
        path: the PNG to write.

    Returns:
        The path.
    """
    figure = new_figure(6.0 * len(histories), 4.0)
    panels = figure.subplots(1, len(histories), squeeze=False)[0]
    for axes, (name, rounds) in zip(panels, histories.items(), strict=True):
        before = 0
        for number, history in enumerate(rounds):
            epochs = before + np.arange(1, len(history) + 1)
            best = int(np.argmin(history[:, 1]))
            first = number == 0
            for column, what in enumerate(("training", "validation")):
                label = what if first else None
                axes.plot(epochs, history[:, column], color=COLOURS[column], label=label)
            axes.scatter([epochs[best]], [history[best, 1]], color=COLOURS[2], zorder=3,
                         label="lowest of the round" if first else None)  # fmt: skip
            axes.axvline(before + 0.5, color="#999999", linewidth=0.5)
            axes.annotate(f"round {number}", (before + 0.5, 1.0), (3.0, -10.0), fontsize=8,
                          xycoords=("data", "axes fraction"), textcoords="offset points",
                          color="#555555")  # fmt: skip
            before += len(history)
        axes.set(title=TITLES.get(name, name), xlabel="epoch", yscale="log")
        axes.grid(which="both", linewidth=0.2)
        axes.legend(fontsize="small", loc="upper right", bbox_to_anchor=(1.0, 0.94))
    content = io.BytesIO()
    figure.savefig(content, dpi=110, format="png")
    write_whole(path, content.getvalue())
    return path
