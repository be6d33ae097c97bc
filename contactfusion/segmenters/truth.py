"""The object as marked in the image by a simulation or a person."""

from collections.abc import Mapping
from typing import Any

from contactfusion.errors import InvalidReadingError
from contactfusion.frames import Pose
from contactfusion.hooks import hookimpl
from contactfusion.readings import DepthImage
from contactfusion.segmenter import Mask, Segmenter, SegmenterConfig


class TruthConfig(SegmenterConfig):
    """The options of `truth`."""

    type: str = "truth"
    """The segmenter, by name."""


class TruthSegmenter(Segmenter[TruthConfig]):
    """The mask that comes with the image; a mask without a pixel means that there is no object."""

    Config = TruthConfig

    def segment(self, image: DepthImage, pose: Pose) -> Mask:
        """The image's own mask.

        Raises:
            InvalidReadingError: it has none.
        """
        if image.mask is None:
            raise InvalidReadingError(
                f"{image.label} has no mask for the segmenter 'truth'; take another, as 'clusters'"
            )
        return image.mask


@hookimpl
def contactfusion_segmenters() -> Mapping[str, type[Segmenter[Any]]]:
    """The segmenter."""
    return {"truth": TruthSegmenter}
