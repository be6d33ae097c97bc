"""Draws tactile patches: every taxel at its place, coloured by how far its value has changed."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.frames import points_in
from contactfusion.patches import PatchConfig
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import TactileImage
from contactfusion.viewing.colours import ROBOT, Colours, ramp
from contactfusion.viewing.library import loaded_rerun
from contactfusion.viewing.recorder import Recorder

THICKNESS = 0.05
"""Of a drawn taxel, in parts of its shorter edge."""
UNTOUCHED = 0.1
"""Changes below this part of the largest have the colour of the robot."""


class Taxels:
    """Patches by sensor. Colours need the largest change of all, so they are written at the end.

    Args:
        config: of the pipeline, whose generators or robot say where taxels are.
    """

    def __init__(self, config: PipelineConfig) -> None:
        self._patches = _patches(config)
        self._images: dict[str, list[tuple[float, FloatArray]]] = {}
        self._refused: set[str] = set()

    def draw(self, recorder: Recorder, reading: TactileImage, path: str) -> None:
        """Draw the patch when its first image comes, and remember the image."""
        patch = self._patches.get(reading.sensor)
        if patch is None or len(patch.centres()) != len(reading.values):
            if reading.sensor not in self._refused:
                self._refused.add(reading.sensor)
                text = f"{reading.label} is not drawn: no patch says where its taxels are"
                recorder.say("events/viewer", reading.stamp, "WARN", text)
            return
        if path not in self._images:
            recorder.draw(path, reading.stamp, _boxes(patch))
        self._images.setdefault(path, []).append((reading.stamp, reading.values))

    def finish(self, recorder: Recorder) -> None:
        """Colour the taxels of all images."""
        for path, images in self._images.items():
            values = np.array([values for _, values in images])
            colours = _heat(values).reshape(-1, 3)
            columns = loaded_rerun().Boxes3D.columns(colors=colours)
            count = np.full(len(values), values.shape[1])
            recorder.send(path, np.array([stamp for stamp, _ in images]), columns.partition(count))


def _heat(values: FloatArray) -> Colours:
    """Give the colours of images, shape (k, n, 3), of k images (k, n) in any unit.

    The change is counted from the first image, in parts of the largest change of all taxels.
    """
    change = abs(values - values[0])
    share = change / max(float(change.max()), np.finfo(float).tiny)
    return np.where(share[..., None] < UNTOUCHED, np.array(ROBOT, np.uint8), ramp(share))


def _boxes(patch: PatchConfig) -> Any:
    """Draw taxels as flat boxes in the frame of the patch."""
    centres, halves, turns = [], [], []
    for pose, places, edges in patch.sheets():
        centres.append(points_in(pose, places))
        half = np.array([*edges, THICKNESS * min(edges)]) / 2.0
        halves.append(np.tile(half * [0.94, 0.94, 1.0], (len(places), 1)))
        turn = Rotation.from_matrix(pose[:3, :3]).as_quat()
        turns.append(np.tile(turn, (len(places), 1)))
    return loaded_rerun().Boxes3D(
        centers=np.concatenate(centres),
        half_sizes=np.concatenate(halves),
        quaternions=np.concatenate(turns),
        fill_mode="solid",
    )


def _patches(config: PipelineConfig) -> dict[str, PatchConfig]:
    """Give the patches by sensor: those of the robot, and those that generators are told."""
    known = dict(config.robot.patches) if config.robot else {}
    found: dict[str, PatchConfig] = {**known}
    for options in config.generators.values():
        sensor, patch = options.get("sensor"), options.get("patch")
        if sensor is None or patch is None:
            continue
        if isinstance(patch, str) and patch in known:
            found[sensor] = known[patch]
        elif isinstance(patch, PatchConfig):
            found[sensor] = patch
        elif isinstance(patch, Mapping):
            found[sensor] = PatchConfig(**patch)
    return found
