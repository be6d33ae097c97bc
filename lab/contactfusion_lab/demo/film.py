"""The push as an animated GIF, and the one picture of it in which the skin dies."""

import io
from pathlib import Path

from contactfusion.files import write_whole
from contactfusion_lab.demo.account import Story
from contactfusion_lab.demo.frames import Frames, dies

SHOWN, DEATH, LAST = 100, 1500, 3000
"""How long a frame is shown: any, the one in which the skin dies, the last one [ms]."""
COLOURS = 96
"""Of the GIF."""


def film(story: Story, path: Path, still: Path, stride: int = 2) -> tuple[int, int]:
    """Draw the push as an animated GIF.

    Args:
        story: of the push.
        path: the GIF to write.
        still: the PNG to write: the frame in which the skin dies.
        stride: every so many cycles is a frame.

    Returns:
        Width and height [pixels].
    """
    from PIL import Image

    moments = [*story.moments[:-1:stride], story.last]
    drawn = Frames(story, stride)
    pictures = [Image.fromarray(drawn.picture(one)) for one in moments]
    death = next((n for n, one in enumerate(moments) if dies(story, one, stride)), -1)
    palette = pictures[death].quantize(COLOURS)
    frames = [one.quantize(palette=palette, dither=Image.Dither.NONE) for one in pictures]
    shown = [SHOWN] * len(frames)
    shown[death], shown[-1] = DEATH, LAST
    content = io.BytesIO()
    frames[0].save(
        content,
        format="GIF",
        save_all=True,
        append_images=frames[1:],
        duration=shown,
        loop=0,
        optimize=False,
    )
    write_whole(path, content.getvalue())
    content = io.BytesIO()
    pictures[death].save(content, format="PNG")
    write_whole(still, content.getvalue())
    width, height = pictures[death].size
    return width, height
