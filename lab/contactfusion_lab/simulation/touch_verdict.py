"""What a touch really was, beside the contacts that were found."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from contactfusion.contacts import Contact
from contactfusion.frames import points_in, vectors_in
from contactfusion.pipeline import Pipeline, Step
from contactfusion.scene import Verdict
from contactfusion_lab.simulation.touch_world import Touching


def touch_verdict(touching: Touching, root: str, pipeline: Pipeline, last: Step) -> Verdict:
    """Tell where a robot is really touched, and how near the contacts of the last step came.

    Args:
        touching: in the frame of the robot's root link.
        root: that link.
        pipeline: which listened.
        last: its last step.

    Raises:
        FrameError: nothing joins the root link to the space.
    """
    state = pipeline.state(last.stamp)
    pose = state.frames.pose(state.grid.frame, of=root)
    places, forces = points_in(pose, touching.places), vectors_in(pose, touching.forces)
    truth = replace(touching, places=places, forces=forces)
    told = {
        "frame": state.grid.frame,
        "places": truth.places.tolist(),
        "forces": truth.forces.tolist(),
        "links": list(truth.links),
    }
    return Verdict(told, tuple(compared(truth, last.fusion.contacts)))


def compared(truth: Touching, contacts: Sequence[Contact]) -> Iterator[str]:
    """Say what really happened, and how near contacts came; one sentence for each true contact.

    Args:
        truth: in the frame of the contacts.
        contacts: of the last step.
    """
    found = np.reshape([contact.position for contact in contacts], (-1, 3))
    for place, link in zip(truth.places, truth.links, strict=True):
        x, y, z = place
        away = np.linalg.norm(found - place, axis=1).min(initial=np.inf) * 1000.0
        near = f"nearest contact {away:.0f} mm away" if contacts else "no contact was found"
        yield f"{link} touched at ({x:.3f}, {y:.3f}, {z:.3f}) m; {near}"
    if not truth.links and contacts:
        yield f"nothing was touched; contacts that are none: {len(contacts)}"
    elif not truth.links:
        yield "no contact, and none was there"
