"""Contacts on the face of a base from a depth camera, by the networks of the LiDAR (O §IV)."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.errors import Guard
from contactfusion.frames import points_in
from contactfusion.generator import Generator
from contactfusion.generators.edges import Thresholds, edge_points
from contactfusion.generators.learned import LearnedConfig, LearnedFace
from contactfusion.generators.own_body import OwnBody
from contactfusion.generators.proximity import BoxConfig, without
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, Note
from contactfusion.readings import DepthImage, Reading
from contactfusion.segmenter import AnySegmenter, built_segmenter
from contactfusion.state import State
from contactfusion.units import Spread
from contactfusion.vision import loaded_opencv, returns


class RgbdCpmConfig(LearnedConfig):
    """The options of `rgbd_cpm`."""

    segmenter: AnySegmenter = Field(default="clusters", validate_default=True)
    """What finds the object in the image: its `type` and options, or the type alone."""
    ends: Literal["surface", "edge"] = "surface"
    """Where a strip's vector ends. `edge`: at the object's nearest edge (O Eq 15). `surface`: at
    the middle between that edge and the end of its cell, as a LiDAR, which the networks were
    trained on, sees a surface that begins there."""
    margin: Spread = Field(default=0.06, ge=0)
    """Edges that lie no further behind the face are taken to lie on it [m]: as much as the camera
    and its place may err."""
    body: BoxConfig | None = None
    """The body that carries the camera, in the robot's frame: its upper side and the edges of that
    mend the camera's pose. None: the pose is trusted."""
    canny: Thresholds = (50.0, 150.0)
    """The lower and the upper threshold of Canny's edges, of brightness in 0..255."""


class RgbdCpmGenerator(LearnedFace[RgbdCpmConfig]):
    """Regular, multi contact: what the last two seconds of images say of the face."""

    Config = RgbdCpmConfig
    readings = (DepthImage,)

    def __init__(self, name: str, config: RgbdCpmConfig) -> None:
        super().__init__(name, config)
        loaded_opencv()
        self._segmenter = built_segmenter(config.segmenter)
        self._body = OwnBody(config.body) if config.body else None
        self._lengths = {
            "edge": self.proximity.lengths_of_edges,
            "surface": self.proximity.lengths_of_surface_edges,
        }[config.ends]

    def reset(self) -> None:
        """Forget what was seen, and which object was followed."""
        super().reset()
        self._segmenter.reset()
        if self._body:
            self._body.reset()

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """Give the contact on the face; no cloud while the object is lost.

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
        """Move what lies a little behind the face onto it."""
        face = self.proximity.region.x[0]
        x = points[:, 0]
        behind = (x > face - self.config.margin) & (x <= face)
        return np.column_stack([np.where(behind, np.nextafter(face, np.inf), x), points[:, 1:]])


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[Any]]]:
    """Offer the generator."""
    return {"rgbd_cpm": RgbdCpmGenerator}
