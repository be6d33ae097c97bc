"""Common parts of pictures: figures without a screen, colours and markers (extra `plot`)."""

from typing import TYPE_CHECKING

from contactfusion.errors import missing_extra

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AXES = "xyz"
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442", "#000000")
VERDICT_STYLES = {
    "contact": ("s", "#009e73"),
    "below_threshold": ("s", "#bbbbbb"),
    "support_only": ("^", "#56b4e9"),
    "nulled": ("x", "#d55e00"),
}
"""The marker and the colour of voxels, by verdict."""


def plain(text: str) -> str:
    """A text that matplotlib draws as it is: a name may hold a `$`."""
    return text.replace("$", r"\$")


def new_figure(width: float, height: float) -> "Figure":
    """An empty figure, drawn without a screen.

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
