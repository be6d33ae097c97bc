"""Pictures of trials: figures and films as whole files."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from contactfusion.errors import missing_extra
from contactfusion.files import write_whole

SHOWN = 0.08
"""How long a frame is shown [s]."""


def save_figure(figure: Any, path: Path, dpi: int = 110) -> Path:
    """Write a figure as PNG; the path."""
    content = io.BytesIO()
    figure.savefig(content, dpi=dpi, format="png")
    write_whole(path, content.getvalue())
    return path


def save_film(frames: Sequence[Any], path: Path, last: float, **how: Any) -> Path:
    """Write frames as an animated GIF.

    Args:
        frames: pictures of few colours.
        path: the GIF to write.
        last: how long the last frame is shown [s].
        how: options of `PIL.Image.Image.save`.

    Returns:
        The path.
    """
    first, *others = frames
    durations = [round(SHOWN * 1e3)] * len(others) + [round(last * 1e3)]
    content = io.BytesIO()
    first.save(
        content, format="GIF", save_all=True, append_images=others, duration=durations, loop=0,
        **how,
    )  # fmt: skip
    write_whole(path, content.getvalue())
    return path


def loaded_pillow() -> Any:
    """Pillow's module of images.

    Raises:
        DependencyError: matplotlib, with which it comes, is not installed.
    """
    try:
        from PIL import Image
    except ImportError:
        raise missing_extra("matplotlib", "plot") from None
    return Image
