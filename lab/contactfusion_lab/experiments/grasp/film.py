"""A film of one grasp: what is, what is felt, and what the controller does about it."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from contactfusion.figures import COLOURS
from contactfusion.recordings.mcap import McapWriter
from contactfusion.run.configuration import TOPIC, Setting
from contactfusion.run.recorder import TRUTH, fixed_frames
from contactfusion.scene import Scene
from contactfusion_lab.experiments.grasp.plan import Column, Grasp, Plan
from contactfusion_lab.experiments.grasp.trial import begun
from contactfusion_lab.scenes.grasp.scene import GraspCycle, GraspScene
from contactfusion_lab.scenes.grasp.world import Viewpoint
from contactfusion_lab.trials.folder import loaded_pillow, save_film

EVERY = 0.15
"""Time of the grasp between two frames [s]."""
LAST = 2.0
"""Time for which the last frame is shown [s]."""
FELT, TRUE = COLOURS[1], COLOURS[2]
SIDE = np.array([0.2, -0.55, 0.65])
"""From where it is seen, from where the object should be [m]."""
COUNT = 64
"""Number of colours: a small file."""


def film(plan: Plan, column: Column, grasp: Grasp, folder: Path) -> tuple[Path, Path]:
    """Make a grasp once more; write it as an animated GIF, NAME.gif, and as NAME.mcap.

    Args:
        plan: the experiment.
        column: by what it is felt.
        grasp: which.
        folder: the folder that takes both.

    Returns:
        The film and the recording.

    Raises:
        DependencyError: rosbags, or matplotlib, with which pillow comes, is not installed.
        ContactFusionError: the scene cannot be set up, or the controller failed.
    """
    image = loaded_pillow()
    scene, cycles = begun(plan, column, grasp)
    middle = scene.config.object.pose.pose()[:3, 3] + [0.0, 0.0, 0.1]
    viewpoint = Viewpoint(tuple(middle + SIDE), tuple(middle))
    frames, due, recording = [], 0.0, folder / f"{grasp.name}.mcap"
    for cycle in recorded(plan, column, grasp, scene, cycles, recording):
        if cycle.truth.stamp >= due or cycle.ending:
            due += EVERY
            frames.append(_frame(scene, viewpoint, cycle))
    frames = [frame.quantize(COUNT, dither=image.Dither.NONE) for frame in frames]
    return save_film(frames, folder / f"{grasp.name}.gif", LAST), recording


def _frame(scene: GraspScene, viewpoint: Viewpoint, cycle: GraspCycle) -> Any:
    """Draw what is seen, true and felt contacts over it, and the controller's words above."""
    from PIL import Image, ImageDraw

    true = [contact.position for contact in scene.facts().contacts]
    felt = [contact.position for contact in cycle.step.fusion.contacts]
    colours, pixels = scene.seen(viewpoint, np.reshape([*true, *felt], (-1, 3)))
    picture = Image.fromarray(colours)
    draw = ImageDraw.Draw(picture)
    for number, (x, y) in enumerate(pixels.tolist()):
        if number < len(true):
            draw.ellipse((x - 3, y - 3, x + 3, y + 3), fill=TRUE)
        else:
            draw.line((x - 6, y - 6, x + 6, y + 6), fill=FELT, width=3)
            draw.line((x - 6, y + 6, x + 6, y - 6), fill=FELT, width=3)
    command = cycle.step.command
    assert command is not None
    draw.text((8, 6), f"{cycle.truth.stamp:5.1f} s  {command.mode}", fill="black")
    draw.text((8, 20), command.reason, fill="black")
    draw.text((8, viewpoint.height - 18), "x felt", fill=FELT)
    draw.text((60, viewpoint.height - 18), "o touched", fill=TRUE)
    return picture


def recorded(
    plan: Plan,
    column: Column,
    grasp: Grasp,
    scene: GraspScene,
    cycles: Iterable[GraspCycle],
    path: Path,
) -> Iterator[GraspCycle]:
    """The cycles of a grasp, each recorded as it passes.

    Args:
        plan: the experiment.
        column: by what it is felt.
        grasp: which.
        scene: of the grasp.
        cycles: as they are made.
        path: the MCAP file, which also holds the configuration: `explain` needs no other.

    Raises:
        DependencyError: rosbags is not installed.
        WritingError: the disk does not take it.
    """
    config = plan.pipeline_of(column, grasp.seed)
    fields = config.model_dump(mode="json", exclude_defaults=True, exclude={"folder"})
    # the name of a fault is a default of its model
    if config.faults:
        fields["faults"] = [fault.model_dump(mode="json") for fault in config.faults]
    fields["cycle"] = {"every": scene.config.period}
    with McapWriter(path, Scene.epoch_ns) as writer:
        writer.text(TOPIC, Setting(fields, config.folder, {}, path).text(beside=path.parent))
        writer.static(fixed_frames(config))
        for cycle in cycles:
            for reading in cycle.readings:
                writer.reading(reading)
            writer.step(cycle.step)
            facts = scene.facts()
            writer.contacts(facts.contacts, facts.frame, facts.stamp, TRUTH)
            for pose in facts.objects:
                writer.reading(pose, TRUTH)
            yield cycle
