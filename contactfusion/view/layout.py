"""What the viewer shows first: the scene, the contact from near, time lines, and what happened."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose
from contactfusion.view.recorder import BACKGROUND, TIMELINE, loaded_rerun
from contactfusion.view.world import heading

TALL, FLAT = 1.2, 2.2
"""The width of the scene's picture, in its heights: alone, and with other views below it."""
SHARE = (-0.03, 1.05)
"""The range of lines that are likelihoods or shares."""
NEAR = 45.0
"""Distance of the view from the contact, in sides of a voxel; that of the scene is no less."""
AZIMUTH, ELEVATION = np.radians([-50.0, 28.0])
"""Direction of the view relative to that of the contacts from the robot [rad]."""
FIELD_OF_VIEW = np.radians(55.0)
"""Vertical field of view of rerun's camera [rad]."""
FILL = 0.85
"""Of the distance that is needed to see every corner of a box: nothing is in most corners."""
NEAREST = 0.25
"""So large a part of what sensors see, the nearest, is shown with the robot."""
ROOM = 1.0
"""But at most so many diagonals of the robot around it."""


class Extent:
    """The box around all that was drawn of robot and contacts, with some room around it."""

    def __init__(self) -> None:
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        self._rooms: list[float] = []
        self._towards, self._in_space = np.zeros(3), np.zeros(3)
        self.touched = False
        """Whether there ever was a contact."""

    def include(
        self, body: FloatArray, contacts: FloatArray, seen: FloatArray, space: Pose
    ) -> None:
        """Extend the box by one step; everything is in the world.

        Args:
            body: the robot, shape (n, 3) [m].
            contacts: the likeliest first, shape (n, 3) [m].
            seen: points that sensors measured, shape (n, 3) [m].
            space: the pose of the hypothesis space.
        """
        self.touched = self.touched or len(contacts) > 0
        points = np.concatenate([body, contacts])
        if len(seen):
            points = self._with_room(points, seen)
        if len(points):
            self._low = np.minimum(self._low, points.min(axis=0))
            self._high = np.maximum(self._high, points.max(axis=0))
        if len(body) and len(contacts):
            towards = contacts[0] - body.mean(axis=0)
            self._towards += towards
            self._in_space += heading(space).T @ towards

    def _with_room(self, points: FloatArray, seen: FloatArray) -> FloatArray:
        """Leave room for the nearest measured points; without a robot these make the box."""
        middle = points.mean(axis=0) if len(points) else np.median(seen, axis=0)
        away = np.linalg.norm(seen - middle, axis=1)
        near = float(np.quantile(away, NEAREST))
        if not len(points):
            points = seen[away <= near]
        room = ROOM * float(np.linalg.norm(np.ptp(points, axis=0)))
        self._rooms.append(min(near, room))
        return points

    @property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """The least and the greatest coordinates [m]; a cube of 1 m while there is nothing."""
        if not np.isfinite(self._low).all():
            return np.full(3, -0.5), np.full(3, 0.5)
        room = float(np.mean(self._rooms or [0.0])) * np.array([1.0, 1.0, 0.0])
        middle = (self._low + self._high) / 2.0
        return np.minimum(self._low, middle - room), np.maximum(self._high, middle + room)

    @property
    def scene_view(self) -> FloatArray:
        """Direction in the world from which most contacts are visible, shape (3,)."""
        return _beside(self._towards)

    @property
    def contact_view(self) -> FloatArray:
        """The same in the heading of the hypothesis space, which may rotate with the robot."""
        return _beside(self._in_space)

    def distance(self, aspect: float) -> float:
        """Distance from the middle of the box at which it fills the view [m].

        Args:
            aspect: the width of the picture, in its heights.
        """
        low, high = self.box
        corners = np.stack(np.meshgrid(*np.stack([low, high]).T), axis=-1).reshape(-1, 3)
        outward = self.scene_view
        right = np.cross([0.0, 0.0, 1.0], outward) / np.cos(ELEVATION)
        axes = np.stack([right, np.cross(outward, right), outward])
        across, up, towards = axes @ (corners - (low + high) / 2.0).T
        half = np.tan(FIELD_OF_VIEW / 2.0)
        return FILL * float((towards + np.maximum(abs(across) / aspect, abs(up)) / half).max())


def _beside(towards: FloatArray) -> FloatArray:
    """The direction of the view for a direction of contacts, so that the robot hides none."""
    around = np.arctan2(towards[1], towards[0]) + AZIMUTH
    flat = np.cos(ELEVATION)
    return np.array([np.cos(around) * flat, np.sin(around) * flat, np.sin(ELEVATION)])


def layout(extent: Extent, side: float, cameras: Mapping[str, str], lanes: int, scale: str) -> Any:
    """The arrangement of the views.

    Args:
        extent: of the scene.
        side: of a voxel [m].
        cameras: the path of each camera's images, by name.
        lanes: how many sources and controllers have states.
        scale: what an arrow of 10 cm means; empty where there are none.
    """
    import rerun.blueprint as rrb

    images = [f"- {path}" for path in cameras.values()]
    below: list[Any] = []
    if extent.touched:
        below.append(_near(NEAR * side * extent.contact_view, ["- /world/command/**", *images]))
    below += [rrb.Spatial2DView(origin=path, name=name) for name, path in cameras.items()]
    distance = max(extent.distance(FLAT if below else TALL), NEAR * side)
    name = f"scene (arrows: 10 cm is {scale})" if scale else "scene"
    whole = _scene(extent, distance, name, ["- /world/space/labels", *images])
    left = rrb.Vertical(whole, rrb.Horizontal(*below), row_shares=[5, 4]) if below else whole
    return rrb.Blueprint(
        rrb.Horizontal(left, _time_lines(lanes), column_shares=[5, 3]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="playing", loop_mode="all"),
        collapse_panels=True,
    )


def _time_lines(lanes: int) -> Any:
    """The views over time: states, likelihood, tabs of lines, events."""
    import rerun.blueprint as rrb
    from rerun.blueprint.encodings import TimelineColumn

    return rrb.Vertical(
        rrb.StateTimelineView(origin="/states", name="sources and controller"),
        _lines("/contacts/likelihood", "likelihood of the best contact", SHARE),
        rrb.Tabs(
            _lines("/shares", "shares of sources", SHARE),
            _lines("/contacts/count", "contacts"),
            _lines("/ages", "age [s]"),
            _lines("/rates", "rate [Hz]"),
        ),
        rrb.TextLogView(
            origin="/events",
            name="events",
            columns=rrb.TextLogColumns(
                # its column of times is too narrow: the text of an event holds its time
                timeline_columns=[TimelineColumn(TIMELINE, visible=False)],
                text_log_columns=["loglevel", "body"],
            ),
        ),
        row_shares=[min(0.3 * lanes + 0.5, 3.8), 1, 1.8, 1.3],
    )


def _scene(extent: Extent, distance: float, name: str, but: Sequence[str]) -> Any:
    """The view of the whole scene from outside."""
    import rerun.blueprint as rrb

    low, high = extent.box
    floor = loaded_rerun().components.Plane3D.XY.with_distance(float(low[2]))
    return rrb.Spatial3DView(
        origin="/world",
        contents=["/world/**", *but],
        name=name,
        eye_controls=_camera(distance * extent.scene_view, (low + high) / 2.0),
        line_grid=rrb.LineGrid3D(plane=floor),
        background=BACKGROUND,
    )


def _near(offset: FloatArray, but: Sequence[str]) -> Any:
    """The view of the best contact from near; its position is always the origin."""
    import rerun.blueprint as rrb

    return rrb.Spatial3DView(
        origin="/world/focus",
        contents=["/world/**", *but],
        name="contact",
        eye_controls=_camera(offset, np.zeros(3)),
        line_grid=False,
        background=BACKGROUND,
    )


def _camera(offset: FloatArray, target: FloatArray) -> Any:
    """The camera at an offset from its target [m]."""
    import rerun.blueprint as rrb

    return rrb.EyeControls3D(position=target + offset, look_target=target, eye_up=[0.0, 0.0, 1.0])


def _lines(origin: str, name: str, limits: tuple[float, float] | None = None) -> Any:
    """A view of lines over time; without limits, those of their values."""
    import rerun.blueprint as rrb

    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_y=rrb.ScalarAxis(range=limits) if limits else None,
        plot_legend=rrb.Corner2D.LeftTop,
    )
