"""Draws the robot: the shapes of its links, sampled once and moved by their poses."""

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import RobotError
from contactfusion.frames import points_in
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.robots.urdf import Link
from contactfusion.state import State
from contactfusion.surface import Surface
from contactfusion.viewing.colours import ROBOT
from contactfusion.viewing.library import entity, loaded_rerun
from contactfusion.viewing.places import Places
from contactfusion.viewing.recorder import Recorder


class Body:
    """The robot of a pipeline: by URDF, or one rigid surface, or none.

    Args:
        config: of the pipeline.
    """

    def __init__(self, config: PipelineConfig) -> None:
        self._surface: Surface | None = None
        if config.surface is not None:
            self._surface = config.surface.sampled(config.folder)
        self._boxes: dict[str, FloatArray] = {}

    def draw(self, recorder: Recorder, state: State, places: Places) -> FloatArray:
        """Draw it where it is at a state; its shapes when it is first known where.

        Returns:
            The corners of boxes around its links in the world, shape (n, 3) [m].
        """
        corners = [np.empty((0, 3))]
        for frame, pose in self._poses(state, places).items():
            path = entity("world", "robot", frame)
            if frame not in self._boxes:
                self._boxes[frame] = self._draw_shapes(recorder, state, path, frame)
            recorder.place(path, state.now, pose)
            corners.append(points_in(pose, self._boxes[frame]))
        return np.concatenate(corners)

    def top(self, frame: str) -> float:
        """Give how high a link, or the surface, is in its frame [m]; 0 if nothing is drawn."""
        return float(self._boxes[frame][:, 2].max()) if len(self._boxes.get(frame, ())) else 0.0

    def _poses(self, state: State, places: Places) -> dict[str, FloatArray]:
        """Give the poses of the links that have shapes, or of the rigid surface."""
        if self._surface is not None:
            pose = places.find(self._surface.frame)
            return {} if pose is None else {self._surface.frame: pose}
        if state.robot is None:
            return {}
        links = state.robot.model.urdf.links
        drawn = {name for name, link in links.items() if link.is_shaped}
        return {
            name: places.space @ pose for name, pose in state.robot.poses.items() if name in drawn
        }

    def _draw_shapes(self, recorder: Recorder, state: State, path: str, frame: str) -> FloatArray:
        """Draw the shapes of a link in its frame; give the corners of a box around them."""
        rerun = loaded_rerun()
        if self._surface is not None:
            points = self._surface.points
            cloud = rerun.Points3D(points, colors=ROBOT, radii=rerun.Radius.ui_points(1.5))
            recorder.draw(path, state.now, cloud)
            return _corners(points)
        assert state.robot is not None
        vertices, normals = _flat(_meshes(recorder, state.now, state.robot.model.urdf.links[frame]))
        if not len(vertices):
            return vertices
        mesh = rerun.Mesh3D(vertex_positions=vertices, vertex_normals=normals, albedo_factor=ROBOT)
        recorder.draw(path, state.now, mesh)
        return _corners(vertices)


Meshes = list[tuple[FloatArray, NDArray[np.uint32]]]


def _meshes(recorder: Recorder, stamp: float, link: Link) -> Meshes:
    """The shapes to look at of a link, or those to touch where the former cannot be used."""
    from contactfusion.robots.solids import Solid

    try:
        return Solid(link.visual or link.collision).meshes
    except RobotError as error:
        text = f"'{link.name}' is drawn by its collision shapes: {error}"
        recorder.say("events/viewer", stamp, "WARN", text)
        return Solid(link.collision).meshes


def _flat(meshes: Meshes) -> tuple[FloatArray, FloatArray]:
    """Give the corners of all triangles, three by three, each with its triangle's normal."""
    corners = np.concatenate(
        [np.empty((0, 3, 3)), *(vertices[triangles] for vertices, triangles in meshes)]
    )
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(min=1e-12)
    return corners.reshape(-1, 3), np.repeat(normals, 3, axis=0)


def _corners(points: FloatArray) -> FloatArray:
    """Give the corners of the box around points, shape (8, 3)."""
    ends = np.stack([points.min(axis=0), points.max(axis=0)])
    return np.stack(np.meshgrid(*ends.T, indexing="ij"), axis=-1).reshape(-1, 3)
