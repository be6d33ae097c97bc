"""Contacts on the face of a base from a depth camera, by the networks of the LiDAR (O §IV)."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, Guard
from contactfusion.frames import points_in
from contactfusion.generator import Generator
from contactfusion.generators.networks import LearnedConfig, LearnedFace
from contactfusion.generators.own_body import OwnBody
from contactfusion.generators.proximity import BoxConfig, without
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, Note
from contactfusion.readings import DepthImage, Reading
from contactfusion.segmenter import AnySegmenter, Mask, built_segmenter
from contactfusion.state import State
from contactfusion.units import Spread
from contactfusion.vision import back_projected, grey, loaded_opencv, returns

RIM = 2
"""Margin of the image around the object [pixels]."""

Threshold = Annotated[float, Field(ge=0)]
Thresholds = tuple[Threshold, Threshold]


class RgbdCpmConfig(LearnedConfig):
    """The options of `rgbd_cpm`."""

    segmenter: AnySegmenter = Field(default="clusters", validate_default=True)
    """The segmenter of the object: its `type` and options, or the type alone."""
    ends: Literal["surface", "edge"] = "surface"
    """The end of a strip's vector. `edge`: at the object's nearest edge (O Eq 15). `surface`: at
    the middle between that edge and the end of its cell, where a LiDAR, on which the networks were
    trained, measures a surface that begins there."""
    margin: Spread = Field(default=0.06, ge=0)
    """The greatest distance behind the face at which edges are moved onto it [m]; at least the
    error of the camera and its pose."""
    body: BoxConfig | None = None
    """The body that carries the camera, in the robot's frame: the edges of its upper side correct
    the camera's pose. None: no correction."""
    canny: Thresholds = (50.0, 150.0)
    """The lower and the upper threshold of Canny's edges, of brightness in 0..255."""


class RgbdCpmGenerator(LearnedFace[RgbdCpmConfig]):
    """Regular, multi contact: the face's contact by the last two seconds of images."""

    Config = RgbdCpmConfig
    readings = (DepthImage,)

    def __init__(self, name: str, config: RgbdCpmConfig) -> None:
        super().__init__(name, config)
        loaded_opencv()
        try:
            self._segmenter = built_segmenter(config.segmenter)
        except ConfigurationError as error:
            raise error.under("segmenter") from None
        self._body = OwnBody(config.body) if config.body else None
        self._lengths = {
            "edge": self.proximity.lengths_of_edges,
            "surface": self.proximity.lengths_of_surface_edges,
        }[config.ends]

    def reset(self) -> None:
        """Clear the memory, and drop the object."""
        super().reset()
        self._segmenter.reset()
        if self._body:
            self._body.reset()

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """The contact on the face; no cloud while the object is lost.

        Raises:
            FrameError: nothing joins the camera's frame to the robot's.
            InvalidReadingError: the image lacks what the segmenter needs.
        """
        assert isinstance(reading, DepthImage)
        depth = returns(reading.depth)
        if not depth.any():
            return (self.nothing(reading, notes=(Note.UNHEALTHY,)),)
        pose = state.frames.pose(self.config.frame, of=reading.frame)
        if self._body:
            pose = self._body.mended(depth, reading.intrinsics, pose)
        with Guard(f"the segmenter of '{self.name}'", type(self._segmenter)):
            mask = self._segmenter.segment(reading, pose)
        if mask is None:
            return ()
        edges = edge_points(depth, mask, reading, self.config.canny)
        points = self._before(without(points_in(pose, edges), self.config.robot))
        return self.perceived(reading, state, self._lengths(points))

    def _before(self, points: FloatArray) -> FloatArray:
        """Points with those a little behind the face moved onto it."""
        face = self.proximity.region.x[0]
        x = points[:, 0]
        behind = (x > face - self.config.margin) & (x <= face)
        return np.column_stack([np.where(behind, np.nextafter(face, np.inf), x), points[:, 1:]])


def edge_points(
    depth: FloatArray, mask: Mask, image: DepthImage, thresholds: Thresholds
) -> FloatArray:
    """The positions of an object's edges.

    Depth is worst at the silhouette, where it is missing, or is that of the floor behind. So each
    edge pixel takes the depth of the nearest pixel that has one and whose neighbours all belong to
    the object; or, where the object is too thin for that, of the nearest of its own.

    Args:
        depth: shape (h, w) [m], 0 where there is no return.
        mask: shape (h, w), of the object.
        image: with the camera matrix, and colours if any.
        thresholds: the lower and the upper one of Canny, of brightness in 0..255.

    Returns:
        Shape (n, 3) [m], in the camera's frame; empty when the object has no depth at all.
    """
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return np.empty((0, 3))
    top, left = max(rows[0] - RIM, 0), max(columns[0] - RIM, 0)
    window = slice(top, rows[-1] + RIM + 1), slice(left, columns[-1] + RIM + 1)
    colour = None if image.colour is None else image.colour[window]
    nearest = nearest_depth(depth[window], mask[window])
    edges = edge_pixels(mask[window], colour, thresholds) & (nearest > 0.0)
    v, u = np.nonzero(edges)
    return back_projected(v + top, u + left, nearest[edges], image.intrinsics)


def edge_pixels(mask: Mask, colour: NDArray[np.uint8] | None, thresholds: Thresholds) -> Mask:
    """The edges of the masked image by Canny, all of them on the object.

    Outside the mask the image is black, or white if the object is dark. Edges just outside are
    moved to the object's side. The rim of the image is no edge.

    Args:
        mask: shape (h, w).
        colour: shape (h, w, 3); None: the edges of the mask alone.
        thresholds: of Canny.
    """
    cv2 = loaded_opencv()
    bright = np.full(mask.shape, 255, np.uint8) if colour is None else grey(colour)
    outside = 0 if bright[mask].mean() > 127.0 else 255
    masked = np.where(mask, bright, np.uint8(outside))
    found = cv2.Canny(masked, *thresholds) > 0
    beyond = (found & ~mask).astype(np.uint8)
    beside = cv2.dilate(beyond, np.ones((3, 3), np.uint8)) > 0
    edges: Mask = mask & (found | beside)
    return edges


def nearest_depth(depth: FloatArray, mask: Mask) -> FloatArray:
    """The depth of the nearest pixel that surely belongs to the object, for each pixel, or 0.

    Args:
        depth: shape (h, w) [m], 0 where there is no return.
        mask: shape (h, w), of the object.
    """
    cv2 = loaded_opencv()
    solid = (cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0) & (depth > 0.0)
    if not solid.any():
        solid = mask & (depth > 0.0)
    if not solid.any():
        return np.zeros(depth.shape)
    labels = cv2.distanceTransformWithLabels(
        (~solid).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )[1]
    of_label = np.zeros(labels.max() + 1)
    of_label[labels[solid]] = depth[solid]
    nearest: FloatArray = of_label[labels]
    return nearest


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[Any]]]:
    """The generator."""
    return {"rgbd_cpm": RgbdCpmGenerator}
