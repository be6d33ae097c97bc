"""The object as tracked by SAM 2, from one of its pixels on."""

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from contactfusion.errors import ConfigurationError, InvalidReadingError, missing_extra
from contactfusion.files import GIVE_CONFIG
from contactfusion.frames import Pose
from contactfusion.hooks import hookimpl
from contactfusion.readings import DepthImage
from contactfusion.segmenter import Mask, Segmenter, SegmenterConfig
from contactfusion.segmenters.clusters import ClustersConfig, ClustersSegmenter
from contactfusion.vision import loaded_opencv

MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Mean and deviation of red, green and blue in ImageNet, of 1; they scale images as in training."""
OBJECT, INSIDE = 1, 1
"""The object's number in a session, and the label of a pixel that belongs to it."""


class Sam2Config(SegmenterConfig):
    """The options of `sam2`."""

    type: str = "sam2"
    """The segmenter, by name."""
    weights: str = Field(min_length=1)
    """A folder with the model, or its name on the Hugging Face hub, such as
    `facebook/sam2.1-hiera-tiny`."""
    folder: Path = Path()
    """The folder of a relative `weights`; that of the configuration."""
    files_within: Path | None = None
    """Set where a recording names the model, which then is refused: it might access the network, or
    hold code."""
    device: str = "cpu"
    """The device of the model, as torch calls it."""
    start: ClustersConfig = Field(default_factory=ClustersConfig)
    """The segmenter that finds the object at the start; one of its pixels then prompts SAM 2."""


class Sam2Segmenter(Segmenter[Sam2Config]):
    """SAM 2 (O §IV-A), prompted by a pixel of the object nearest to the face; tracks by colour."""

    Config = Sam2Config

    def __init__(self, config: Sam2Config) -> None:
        super().__init__(config)
        self._finder = ClustersSegmenter(config.start)
        self._model = _loaded(config)
        self.reset()

    def reset(self) -> None:
        """Forget the object."""
        self._finder.reset()
        self._session: Any = None
        self._frame = 0

    def segment(self, image: DepthImage, pose: Pose) -> Mask | None:
        """The mask of the object; None while SAM 2 does not detect it, or none has been found.

        Raises:
            InvalidReadingError: the image has no colour.
        """
        if image.colour is None:
            raise InvalidReadingError(f"{image.label} has no colour for the segmenter 'sam2'")
        if self._session is None and not self._shown(image, pose):
            return None
        mask = self._followed(image.colour)
        self._frame += 1
        return mask

    def _shown(self, image: DepthImage, pose: Pose) -> bool:
        """Prompt a new session with a pixel of the object; False when there is none."""
        found = self._finder.segment(image, pose)
        if found is None:
            return False
        torch = _torch()
        row, column = innermost(found)
        scale = self._model.config.image_size / np.array(found.shape[::-1])
        pixel = torch.tensor(np.array([column, row]) * scale, dtype=torch.float32)
        device = self.config.device
        session = _transformers().Sam2VideoInferenceSession(
            inference_device=device, inference_state_device=device, dtype=torch.float32
        )
        shown = {
            "point_coords": pixel[None, None, None],
            "point_labels": torch.full((1, 1, 1), INSIDE),
        }
        session.add_point_inputs(session.obj_id_to_idx(OBJECT), self._frame, shown)
        session.obj_with_new_inputs = [OBJECT]
        self._session = session
        return True

    def _followed(self, colour: NDArray[np.uint8]) -> Mask | None:
        torch, session = _torch(), self._session
        pixels = torch.from_numpy(normalised(colour, self._model.config.image_size))
        with torch.inference_mode():
            found = self._model(session, frame_idx=self._frame, frame=pixels)
            whole = torch.nn.functional.interpolate(
                found.pred_masks.float(), colour.shape[:2], mode="bilinear", align_corners=False
            )
        self._forget_old()
        if float(found.object_score_logits.squeeze()) <= 0.0:
            return None
        mask: Mask = (whole[0, 0] > 0.0).cpu().numpy()
        return mask if mask.any() else None

    def _forget_old(self) -> None:
        """Drop what the model attends to no more; a session keeps all frames."""
        config, session = self._model.config, self._session
        session.processed_frames.clear()
        kept = max(config.num_maskmem, config.max_object_pointers_in_encoder)
        session.output_dict_per_obj[0]["non_cond_frame_outputs"].pop(self._frame - kept, None)
        session.frames_tracked_per_obj[0].pop(self._frame - kept, None)


def innermost(mask: Mask) -> tuple[int, int]:
    """Row and column of the pixel that is furthest from the rim of a mask."""
    cv2 = loaded_opencv()
    rimmed = np.pad(mask.astype(np.uint8), 1)
    depth = cv2.distanceTransform(rimmed, cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1]
    row, column = np.unravel_index(np.argmax(depth), mask.shape)
    return int(row), int(column)


def normalised(colour: NDArray[np.uint8], side: int) -> NDArray[np.float32]:
    """An image as SAM 2 was trained on: square, scaled by mean and deviation of ImageNet.

    Args:
        colour: shape (h, w, 3), of 255.
        side: of the square [pixels].

    Returns:
        Shape (1, 3, side, side).
    """
    square = loaded_opencv().resize(colour, (side, side)).astype(np.float32) / 255.0
    scaled = (square - np.array(MEAN, np.float32)) / np.array(DEVIATION, np.float32)
    return np.ascontiguousarray(scaled.transpose(2, 0, 1))[None]


def _torch() -> Any:
    import torch

    return torch


def _transformers() -> Any:
    try:
        return import_module("transformers")
    except ImportError:
        raise missing_extra("transformers", "sam") from None


def _loaded(config: Sam2Config) -> Any:
    if config.files_within is not None:
        raise ConfigurationError(
            f"a configuration that comes from a recording may name no model of SAM 2, "
            f"not '{config.weights}'; {GIVE_CONFIG}",
            "weights",
        )
    sam2, folder = _transformers().Sam2VideoModel, config.folder / config.weights
    try:
        model = sam2.from_pretrained(folder if folder.is_dir() else config.weights)
    except (OSError, ValueError) as error:
        why = str(error).strip().splitlines()[0]
        raise ConfigurationError(f"SAM 2 cannot be loaded: {why}", "weights") from None
    try:
        return model.eval().to(config.device)
    except (AssertionError, RuntimeError) as error:
        why = str(error).strip().splitlines()[0]
        raise ConfigurationError(f"SAM 2 cannot run there: {why}", "device") from None


@hookimpl
def contactfusion_segmenters() -> Mapping[str, type[Segmenter[Any]]]:
    """The segmenter."""
    return {"sam2": Sam2Segmenter}
