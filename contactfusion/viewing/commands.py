"""Draws what a controller commands: above the robot, so that it is not hidden in it."""

import numpy as np

from contactfusion.controller import Command
from contactfusion.frames import points_in, vectors_in
from contactfusion.viewing.arrows import THICKNESS
from contactfusion.viewing.body import Body
from contactfusion.viewing.colours import COMMAND, TURN
from contactfusion.viewing.library import loaded_rerun
from contactfusion.viewing.places import Places
from contactfusion.viewing.recorder import Recorder

METRES_PER_SPEED = 2.0
"""The length of a command's arrow: where its speed leads to in so many seconds."""
LIFT = 0.4
"""The reason of a command stands so far above its arrow [m]."""


def draw_command(
    recorder: Recorder, command: Command, stamp: float, places: Places, body: Body
) -> None:
    """Draw a command's velocity, its turn as an arrow along the axis, and its reason.

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
