"""Draws what the integrator believes, and what the controller makes of it."""

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.controller import Command
from contactfusion.frames import points_in, pose_of
from contactfusion.integrator.fusion import HypothesisSpace
from contactfusion.pipeline import Step
from contactfusion.viewing import marks
from contactfusion.viewing.places import Places
from contactfusion.viewing.recorder import Recorder

VOXEL_PERIOD = 0.05
"""Voxels are drawn at most so often [s]: there are many of them."""


class Beliefs:
    """Voxels, contacts and commands of the steps of one pipeline.

    Args:
        side: of a voxel [m].
    """

    def __init__(self, side: float) -> None:
        self._side = side
        self._next_voxels = -float("inf")

    def draw(self, recorder: Recorder, step: Step, frame: str, places: Places) -> FloatArray:
        """Draw a step.

        Args:
            recorder: to draw with.
            step: of the pipeline.
            frame: of the hypothesis space.
            places: the frames at the step.

        Returns:
            The contacts in the world, the most likely first, shape (n, 3) [m].
        """
        contacts, stamp, there = step.fusion.contacts, step.stamp, bool(step.fusion.contacts)
        space = places.space(frame)
        recorder.place("world/space", stamp, space)
        recorder.show("world/space/contacts", stamp, marks.ellipsoids(contacts), there)
        recorder.show("world/space/labels", stamp, marks.labels(contacts), there)
        recorder.show("world/space/forces", stamp, marks.forces(contacts), there)
        if stamp >= self._next_voxels:
            self._next_voxels = stamp + VOXEL_PERIOD
            self._draw_voxels(recorder, step.fusion.space, stamp)
        if step.command is not None:
            _draw_command(recorder, step.command, stamp, places)
        where = np.array([contact.position for contact in contacts]).reshape(-1, 3)
        where = points_in(space, where)
        if there:
            recorder.place("world/focus", stamp, pose_of(where[0]))
        return where

    def _draw_voxels(self, recorder: Recorder, space: HypothesisSpace, stamp: float) -> None:
        for verdict in marks.VOXEL_RADII:
            dots = marks.voxels(space, verdict, self._side)
            there = bool((space.verdicts == verdict).any())
            recorder.show(f"world/space/voxels/{verdict}", stamp, dots, there)


def _draw_command(recorder: Recorder, command: Command, stamp: float, places: Places) -> None:
    pose = places.find(command.twist.frame) if command.twist else None
    arrows = marks.command_arrows(command, pose)
    recorder.show("world/command", stamp, arrows, pose is not None)
