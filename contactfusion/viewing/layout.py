"""What the viewer shows first: the scene, the contact from near, time lines, and what happened."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.viewing.colours import BACKGROUND
from contactfusion.viewing.library import loaded_rerun
from contactfusion.viewing.places import Extent
from contactfusion.viewing.recorder import TIMELINE

WIDE = 0.7
"""The scene is looked at from this far, in diagonals of the box around it."""
NEAR = 45.0
"""The contact is looked at from this far, in sides of a voxel."""


def layout(extent: Extent, side: float, cameras: Mapping[str, str], lanes: int) -> Any:
    """Lay the views out.

    Args:
        extent: of the scene.
        side: of a voxel [m].
        cameras: the path of each camera's images, by name.
        lanes: how many sources and controllers have states.
    """
    import rerun.blueprint as rrb

    images = [f"- {path}" for path in cameras.values()]
    whole = _scene(extent, ["- /world/space/labels", *images])
    below = (
        [_near(NEAR * side * extent.eye, ["- /world/command", *images])] if extent.touched else []
    )
    below += [rrb.Spatial2DView(origin=path, name=name) for name, path in cameras.items()]
    left = rrb.Vertical(whole, rrb.Horizontal(*below), row_shares=[5, 4]) if below else whole
    right = rrb.Vertical(
        rrb.StateTimelineView(origin="/states", name="sources and controller"),
        _lines("/contacts", "contacts: how many, and the best one's likelihood"),
        rrb.Tabs(
            _lines("/shares", "who feels the best contact (shares)"),
            _lines("/ages", "age [s]"),
            _lines("/rates", "rate [Hz]"),
        ),
        rrb.TextLogView(
            origin="/events",
            name="events",
            columns=rrb.TextLogColumns(
                timeline_columns=[TIMELINE], text_log_columns=["loglevel", "body"]
            ),
        ),
        row_shares=[min(0.3 * lanes + 0.5, 2.6), 1, 1.8, 1.3],
    )
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[5, 3]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="playing", loop_mode="all"),
        collapse_panels=True,
    )


def _scene(extent: Extent, but: Sequence[str]) -> Any:
    """Look at the whole scene from outside."""
    import rerun.blueprint as rrb

    low, high = extent.box
    centre, distance = (low + high) / 2.0, WIDE * float(np.linalg.norm(high - low))
    floor = loaded_rerun().components.Plane3D.XY.with_distance(float(low[2]))
    return rrb.Spatial3DView(
        origin="/world",
        contents=["/world/**", *but],
        name="scene",
        eye_controls=_eye(distance * extent.eye, centre),
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


def _lines(origin: str, name: str) -> Any:
    import rerun.blueprint as rrb

    return rrb.TimeSeriesView(origin=origin, name=name)
