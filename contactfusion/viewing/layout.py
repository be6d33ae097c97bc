"""What the viewer shows first: the scene, the contact from near, time lines, and what happened."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.viewing.colours import BACKGROUND
from contactfusion.viewing.extent import Extent
from contactfusion.viewing.library import loaded_rerun
from contactfusion.viewing.recorder import TIMELINE

TALL, FLAT = 1.2, 2.2
"""The width of the scene's picture, in its heights: alone, and with other views below it."""
SHARE = (-0.03, 1.05)
"""The range of lines that are likelihoods or shares."""
NEAR = 45.0
"""The contact is looked at from this far, in sides of a voxel, and the scene from no nearer."""


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
