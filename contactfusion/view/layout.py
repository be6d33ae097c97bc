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
"""The contact is looked at from this far, in sides of a voxel, and the scene from no nearer."""
ASIDE, ABOVE = np.radians([-50.0, 28.0])
"""Contacts are looked at from so far beside where they are on the robot, and from above [rad]."""
FIELD_OF_VIEW = np.radians(55.0)
"""Of rerun's eye, from top to bottom [rad]."""
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
        self._towards, self._ahead = np.zeros(3), np.zeros(3)
        self.touched = False
        """Whether there ever was a contact."""

    def include(
        self, body: FloatArray, contacts: FloatArray, seen: FloatArray, space: Pose
    ) -> None:
        """Go on with one step; everything is in the world.

        Args:
            body: the robot, shape (n, 3) [m].
            contacts: the likeliest first, shape (n, 3) [m].
            seen: points that sensors saw, shape (n, 3) [m].
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
            self._ahead += heading(space).T @ towards

    def _with_room(self, points: FloatArray, seen: FloatArray) -> FloatArray:
        """Leave room for the nearest of what is seen; look at that where there is no robot."""
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
    def scene_eye(self) -> FloatArray:
        """Where most contacts are seen from in the world: a direction, shape (3,)."""
        return _beside(self._towards)

    @property
    def contact_eye(self) -> FloatArray:
        """The same in the heading of the hypothesis space, which may turn with the robot."""
        return _beside(self._ahead)

    def distance(self, aspect: float) -> float:
        """How far from the middle of the box it is seen well [m].

        Args:
            aspect: the width of the picture, in its heights.
        """
        low, high = self.box
        corners = np.stack(np.meshgrid(*np.stack([low, high]).T), axis=-1).reshape(-1, 3)
        eye = self.scene_eye
        right = np.cross([0.0, 0.0, 1.0], eye) / np.cos(ABOVE)
        axes = np.stack([right, np.cross(eye, right), eye])
        across, up, towards = axes @ (corners - (low + high) / 2.0).T
        half = np.tan(FIELD_OF_VIEW / 2.0)
        return FILL * float((towards + np.maximum(abs(across) / aspect, abs(up)) / half).max())


def _beside(towards: FloatArray) -> FloatArray:
    """A direction from above, and beside where contacts are, so that the robot hides none."""
    around = np.arctan2(towards[1], towards[0]) + ASIDE
    flat = np.cos(ABOVE)
    return np.array([np.cos(around) * flat, np.sin(around) * flat, np.sin(ABOVE)])


def layout(extent: Extent, side: float, cameras: Mapping[str, str], lanes: int, scale: str) -> Any:
    """Lay the views out.

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
        below.append(_near(NEAR * side * extent.contact_eye, ["- /world/command/**", *images]))
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
    """Show how sources and controller do, and what happened."""
    import rerun.blueprint as rrb
    from rerun.blueprint.encodings import TimelineColumn

    return rrb.Vertical(
        rrb.StateTimelineView(origin="/states", name="sources and controller"),
        _lines("/contacts/likelihood", "likelihood of the best contact", SHARE),
        rrb.Tabs(
            _lines("/shares", "who feels it (shares)", SHARE),
            _lines("/contacts/count", "contacts"),
            _lines("/ages", "age [s]"),
            _lines("/rates", "rate [Hz]"),
        ),
        rrb.TextLogView(
            origin="/events",
            name="events",
            columns=rrb.TextLogColumns(
                # its column of times is too narrow: events tell theirs
                timeline_columns=[TimelineColumn(TIMELINE, visible=False)],
                text_log_columns=["loglevel", "body"],
            ),
        ),
        row_shares=[min(0.3 * lanes + 0.5, 3.8), 1, 1.8, 1.3],
    )


def _scene(extent: Extent, distance: float, name: str, but: Sequence[str]) -> Any:
    """Look at the whole scene from outside."""
    import rerun.blueprint as rrb

    low, high = extent.box
    floor = loaded_rerun().components.Plane3D.XY.with_distance(float(low[2]))
    return rrb.Spatial3DView(
        origin="/world",
        contents=["/world/**", *but],
        name=name,
        eye_controls=_eye(distance * extent.scene_eye, (low + high) / 2.0),
        line_grid=rrb.LineGrid3D(plane=floor),
        background=BACKGROUND,
    )


def _near(offset: FloatArray, but: Sequence[str]) -> Any:
    """Look at the best contact from near; its place is the origin, wherever it goes."""
    import rerun.blueprint as rrb

    return rrb.Spatial3DView(
        origin="/world/focus",
        contents=["/world/**", *but],
        name="contact",
        eye_controls=_eye(offset, np.zeros(3)),
        line_grid=False,
        background=BACKGROUND,
    )


def _eye(offset: FloatArray, target: FloatArray) -> Any:
    """Look at a place [m] from an offset to it."""
    import rerun.blueprint as rrb

    return rrb.EyeControls3D(position=target + offset, look_target=target, eye_up=[0.0, 0.0, 1.0])


def _lines(origin: str, name: str, limits: tuple[float, float] | None = None) -> Any:
    """Draw lines over time; their limits are those of their values if none are given."""
    import rerun.blueprint as rrb

    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_y=rrb.ScalarAxis(range=limits) if limits else None,
        plot_legend=rrb.Corner2D.LeftTop,
    )
