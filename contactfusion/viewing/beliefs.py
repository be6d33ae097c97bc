"""Draws what the integrator believes."""

from collections.abc import Sequence

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.frames import points_in, pose_of
from contactfusion.integrator.fusion import HypothesisSpace
from contactfusion.pipeline import Step
from contactfusion.viewing import marks
from contactfusion.viewing.arrows import Arrows, Sheaf
from contactfusion.viewing.colours import FORCE, VOXELS
from contactfusion.viewing.places import Places, heading
from contactfusion.viewing.recorder import Recorder

VOXEL_PERIOD = 0.05
"""Voxels are drawn at most so often [s]: there are many of them."""


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
        recorder.show("world/space/contacts", stamp, marks.ellipsoids(contacts), there)
        recorder.show("world/space/labels", stamp, marks.labels(contacts, self._side), there)
        recorder.show("world/space/centres", stamp, marks.centres(contacts), there)
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
        self._forces.draw(recorder, "world/space/forces", FORCE, sheaf)

    def _draw_voxels(self, recorder: Recorder, space: HypothesisSpace, stamp: float) -> None:
        for verdict in VOXELS:
            boxes = marks.voxels(space, verdict, self._side)
            there = bool((space.verdicts == verdict).any())
            recorder.show(f"world/space/voxels/{verdict}", stamp, boxes, there)
