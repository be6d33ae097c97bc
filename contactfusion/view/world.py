"""Draws the robot, voxels, contacts and commands in the fixed frame."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.controller import Command
from contactfusion.errors import FrameError, RobotError
from contactfusion.frames import FrameTree, Pose, points_in, pose_of, vectors_in
from contactfusion.integrator.fusion import HypothesisSpace
from contactfusion.pipeline import Step
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings.canvas import ACTIVE
from contactfusion.robots.urdf import Link
from contactfusion.state import State
from contactfusion.surface import Surface
from contactfusion.view.recorder import (
    COMMAND,
    ROBOT,
    THICKNESS,
    TURN,
    VOXELS,
    Arrows,
    Recorder,
    Sheaf,
    entity,
    loaded_rerun,
)

VOXEL_PERIOD = 0.05
"""Voxels are drawn at most so often [s]: there are many of them."""
SIGMAS = 2.0
"""Contacts are drawn as ellipsoids of so many standard deviations."""
EDGES = {"contact": 0.9, "below_threshold": 0.6, "support_only": 0.5, "nulled": 0.25}
"""The edges of the boxes for voxels, in sides of a voxel: between them contacts are seen."""
FAINTEST, DENSEST = 40.0, 140.0
"""How opaque the boxes of voxels of likelihood 0 and 1 are, of 255."""
BENEATH = 2.0
"""Distance of a contact's label beneath it, in sides of a voxel."""
DOT = 3.5
"""The radius of the dot in a contact, whatever its distance [points of the screen]."""
MOST_VOXELS = 5000
"""More voxels of one verdict are thinned evenly."""
METRES_PER_SPEED = 2.0
"""The length of a command's arrow: where its speed leads to in so many seconds."""
LIFT = 0.4
"""Distance of a command's reason above its arrow [m]."""


@dataclass(frozen=True, eq=False)
class Places:
    """The poses of all frames at one step, in the frame in which is drawn.

    Attributes:
        frames: the poses.
        world: the frame over all that hang together with the hypothesis space: the odometry's, or
            the space itself.
        space: the pose of the hypothesis space.
        grid: the frame of the hypothesis space.
        unknown: why the space's pose is not known at this time, and is that nearest in time; empty
            when it is known.
    """

    frames: FrameTree
    world: str
    space: Pose
    grid: str
    unknown: str = ""

    @classmethod
    def of(cls, state: State) -> "Places":
        """The poses at a state.

        Raises:
            FrameError: the frames form a circle.
        """
        frames, grid = state.frames, state.grid.frame
        try:
            world = frames.root(grid)
            return cls(frames, world, frames.pose(world, of=grid), grid)
        except FrameError as error:
            nearest = frames.nearest()
            world = nearest.root(grid)
            return cls(frames, world, nearest.pose(world, of=grid), grid, str(error))

    def find(self, frame: str) -> Pose | None:
        """The pose of a frame; None where nothing joins it to the world or to the space."""
        with suppress(FrameError):
            return self.frames.pose(self.world, of=frame)
        with suppress(FrameError):
            return self.space @ self.frames.pose(self.grid, of=frame)
        return None

    def why_lost(self, frame: str) -> str:
        """Why a frame has no pose; empty when it has one."""
        try:
            self.frames.pose(self.world, of=frame)
        except FrameError as error:
            return str(error)
        return ""


@final
class Absences:
    """What could not be placed, in the order in which it was first missing."""

    def __init__(self) -> None:
        self._spans: dict[str, tuple[float, float, str]] = {}

    def add(self, what: str, stamp: float, why: str) -> None:
        """Note that something is missing at a stamp [s]; the first reason is kept."""
        first, _, reason = self._spans.get(what, (stamp, stamp, why))
        self._spans[what] = first, stamp, reason

    def lines(self) -> Iterator[str]:
        """What was missing, from when to when, and why."""
        for what, (first, last, why) in self._spans.items():
            span = f"from {first:.3f} to {last:.3f} s" if last > first else f"at {first:.3f} s"
            yield f"{what} {span}: {why}"


def heading(pose: Pose) -> FloatArray:
    """The yaw of a pose as a rotation matrix, shape (3, 3)."""
    yaw = np.arctan2(pose[1, 0], pose[0, 0])
    return np.array(
        [[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]]
    )


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
        """Draw it at a state; its shapes once, at the first known pose.

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
        """Height of a link, or of the surface, in its frame [m]; 0 if nothing is drawn."""
        return float(self._boxes[frame][:, 2].max()) if len(self._boxes.get(frame, ())) else 0.0

    def _poses(self, state: State, places: Places) -> dict[str, FloatArray]:
        """The poses of the links that have shapes, or of the rigid surface."""
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
        """Draw the shapes of a link in its frame; the corners of a box around them."""
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
    """The visual shapes of a link, or its collision shapes where the former cannot be used."""
    from contactfusion.robots.solids import Solid

    try:
        return Solid(link.visual or link.collision).meshes
    except RobotError as error:
        text = f"'{link.name}' is drawn by its collision shapes: {error}"
        recorder.log("events/viewer", stamp, "WARN", text)
        return Solid(link.collision).meshes


def _flat(meshes: Meshes) -> tuple[FloatArray, FloatArray]:
    """The corners of all triangles, three by three, each with its triangle's normal."""
    corners = np.concatenate(
        [np.empty((0, 3, 3)), *(vertices[triangles] for vertices, triangles in meshes)]
    )
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(min=1e-12)
    return corners.reshape(-1, 3), np.repeat(normals, 3, axis=0)


def _corners(points: FloatArray) -> FloatArray:
    """The corners of the box around points, shape (8, 3)."""
    ends = np.stack([points.min(axis=0), points.max(axis=0)])
    return np.stack(np.meshgrid(*ends.T, indexing="ij"), axis=-1).reshape(-1, 3)


class Beliefs:
    """Voxels and contacts of the steps of one pipeline.

    Args:
        side: of a voxel [m].
        forces: draws forces.
    """

    def __init__(self, side: float, forces: Arrows) -> None:
        self._side, self._forces = side, forces
        self._begin: float | None = None
        self._found = False
        self._next_voxels = -float("inf")

    def draw(self, recorder: Recorder, step: Step, places: Places) -> FloatArray:
        """Draw a step.

        Args:
            recorder: to draw with.
            step: of the pipeline.
            places: the frames at the step.

        Returns:
            The contacts in the world, the most likely first, shape (n, 3) [m].
        """
        contacts, stamp, there = step.fusion.contacts, step.stamp, bool(step.fusion.contacts)
        recorder.place("world/space", stamp, places.space)
        recorder.show("world/space/contacts", stamp, _ellipsoids(contacts), there)
        recorder.show("world/space/labels", stamp, _labels(contacts, self._side), there)
        recorder.show("world/space/centres", stamp, _centres(contacts), there)
        self._draw_forces(recorder, contacts, stamp)
        if stamp >= self._next_voxels:
            self._next_voxels = stamp + VOXEL_PERIOD
            self._draw_voxels(recorder, step.fusion.space, stamp)
        where = np.array([contact.position for contact in contacts]).reshape(-1, 3)
        where = points_in(places.space, where)
        if self._begin is None:
            self._begin = stamp
        if there:  # before the first contact is looked at where it will be
            since = stamp if self._found else self._begin
            recorder.place("world/focus", since, pose_of(where[0], heading(places.space)))
            self._found = True
        return where

    def _draw_forces(self, recorder: Recorder, contacts: Sequence[Contact], stamp: float) -> None:
        """Draw the forces on the robot, where they are known: they come from outside."""
        felt = [contact for contact in contacts if np.isfinite(contact.force).all()]
        vectors = np.array([contact.force for contact in felt]).reshape(-1, 3)
        tips = np.array([contact.position for contact in felt]).reshape(-1, 3)
        sheaf = Sheaf(stamp, vectors, tips)
        self._forces.draw(recorder, "world/space/forces", ACTIVE, sheaf)

    def _draw_voxels(self, recorder: Recorder, space: HypothesisSpace, stamp: float) -> None:
        for verdict in VOXELS:
            boxes = _voxels(space, verdict, self._side)
            there = bool((space.verdicts == verdict).any())
            recorder.show(f"world/space/voxels/{verdict}", stamp, boxes, there)


def _voxels(space: HypothesisSpace, verdict: str, side: float) -> Any:
    """Draw the voxels of one verdict, the likelier the less translucent, in the frame of the space.

    Args:
        space: the hypothesis space.
        verdict: which voxels.
        side: of a voxel [m].
    """
    here = np.flatnonzero(space.verdicts == verdict)
    here = here[:: -(-len(here) // MOST_VOXELS) or 1]
    likelihoods = np.nan_to_num(space.likelihoods[here])
    colours = np.empty((len(here), 4), np.uint8)
    colours[:, :3] = VOXELS[verdict]
    colours[:, 3] = FAINTEST + (DENSEST - FAINTEST) * likelihoods
    return loaded_rerun().Boxes3D(
        centers=space.positions[here],
        half_sizes=np.full((len(here), 3), EDGES[verdict] * side / 2.0),
        colors=colours,
        fill_mode="solid",
    )


def _ellipsoids(contacts: Sequence[Contact]) -> Any:
    """Draw contacts with their covariances."""
    rerun = loaded_rerun()
    if not contacts:
        return rerun.Ellipsoids3D(half_sizes=np.empty((0, 3)))
    variances, axes = np.linalg.eigh([contact.covariance for contact in contacts])
    axes[:, :, 0] *= np.linalg.det(axes)[:, None]  # right-handed, so that they are rotations
    return rerun.Ellipsoids3D(
        centers=[contact.position for contact in contacts],
        half_sizes=SIGMAS * np.sqrt(variances.clip(min=0.0)),
        quaternions=Rotation.from_matrix(axes).as_quat(),
        colors=ACTIVE,
        fill_mode=rerun.components.FillMode.TransparentFillMajorWireframe,
        line_radii=rerun.Radius.ui_points(1.5),
    )


def _centres(contacts: Sequence[Contact]) -> Any:
    """Draw where contacts are as dots that are seen from afar."""
    rerun = loaded_rerun()
    places = np.array([contact.position for contact in contacts]).reshape(-1, 3)
    return rerun.Points3D(places, colors=ACTIVE, radii=rerun.Radius.ui_points(DOT))


def _labels(contacts: Sequence[Contact], side: float) -> Any:
    """Labels beneath contacts: likelihood, force, shares of sources.

    Args:
        contacts: of a step.
        side: of a voxel [m].
    """
    deep = [SIGMAS * np.sqrt(contact.covariance[2, 2]) + BENEATH * side for contact in contacts]
    places = np.array([contact.position for contact in contacts]).reshape(-1, 3)
    return loaded_rerun().Points3D(
        places - np.outer(deep, [0.0, 0.0, 1.0]),
        colors=ACTIVE,
        radii=1e-4,
        labels=[_label(contact) for contact in contacts],
        show_labels=True,
    )


def _label(contact: Contact) -> str:
    shares = sorted(contact.shares.items(), key=lambda item: -item[1])
    sources = ", ".join(f"{name} {share:.0%}" for name, share in shares if share >= 0.005)
    force = float(np.linalg.norm(contact.force))
    felt = f", {force:.3g} N" if np.isfinite(force) else ""
    return f"{contact.likelihood:.2f}{felt}: {sources}"


def draw_command(
    recorder: Recorder, command: Command, stamp: float, places: Places, body: Body
) -> None:
    """Draw a command's linear and angular velocity as arrows, and its reason.

    Args:
        recorder: to draw with.
        command: of the controller; without a twist in a known frame, nothing is drawn.
        stamp: of the step [s].
        places: the frames at the step.
        body: the robot, drawn.
    """
    rerun = loaded_rerun()
    arrows = rerun.Arrows3D(vectors=np.empty((0, 3)))
    reason = rerun.Points3D(np.empty((0, 3)))
    twist = command.twist
    pose = places.find(twist.frame) if twist else None
    if twist is not None and pose is not None:
        start = points_in(pose, np.array([[0.0, 0.0, body.top(twist.frame)]]))
        vectors = vectors_in(pose, np.stack([twist.linear, twist.angular]))
        moving = np.linalg.norm(vectors, axis=1) > 0.0
        arrows = rerun.Arrows3D(
            origins=np.repeat(start, int(moving.sum()), axis=0),
            vectors=METRES_PER_SPEED * vectors[moving],
            colors=np.array([COMMAND, TURN])[moving],
            radii=rerun.Radius.ui_points(THICKNESS),
        )
        reason = rerun.Points3D(
            start + [0.0, 0.0, LIFT],
            colors=COMMAND,
            radii=1e-4,
            labels=[f"{command.mode}: {command.reason}"],
            show_labels=True,
        )
    recorder.show("world/command/arrows", stamp, arrows, pose is not None)
    recorder.show("world/command/reason", stamp, reason, pose is not None)
