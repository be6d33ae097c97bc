"""One push again, as a film and as a recording."""

from pathlib import Path

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.pipeline import Pipeline
from contactfusion.readings import ObjectPose
from contactfusion.recordings.mcap import McapWriter
from contactfusion.robots.urdf import read_urdf
from contactfusion.shapes import ShapeConfig
from contactfusion_lab.experiments.push.animation import Shapes, film
from contactfusion_lab.experiments.push.plan import Plan, Push
from contactfusion_lab.experiments.push.trial import push_cycles, track_of
from contactfusion_lab.scenes.push.objects import outlines
from contactfusion_lab.scenes.push.scene import PushTruth

TRUTH = "truth"
"""Topics of what no sensor tells begin with this."""


def record(plan: Plan, push: Push, controller: str, folder: Path) -> tuple[Path, Path]:
    """Push once more; write NAME.gif and NAME.mcap.

    The recording holds what the sensors read, before any faults, contacts and commands, and under
    "truth" the pose of the object in `odom`.

    Args:
        plan: the experiment.
        push: which.
        controller: by name.
        folder: the folder that takes both.

    Returns:
        The film and the recording.

    Raises:
        DependencyError: rosbags or matplotlib is not installed.
    """
    pipeline = Pipeline(plan.pipeline_of(push, controller), plan.sensing.ask)
    cycles = list(push_cycles(plan, push, pipeline))
    recording = folder / f"{push.name}.mcap"
    with McapWriter(recording) as writer:
        for cycle in cycles:
            for reading in cycle.readings:
                writer.reading(reading)
            writer.reading(_object(push, cycle.truth), prefix=TRUTH)
            writer.step(cycle.step)
    track = track_of(plan, push, controller, cycles)
    reasons = [cycle.step.command.reason if cycle.step.command else "" for cycle in cycles]
    shapes = Shapes(chassis(plan), outlines(plan.objects[push.object]), plan.face)
    return film(track, reasons, shapes, folder / f"{push.name}.gif"), recording


def _object(push: Push, truth: PushTruth) -> ObjectPose:
    x, y, yaw = truth.object
    return ObjectPose(
        stamp=truth.stamp,
        frame="odom",
        sensor="object",
        name=push.object,
        position=np.array([x, y, 0.0]),
        orientation=np.array([0.0, 0.0, np.sin(yaw / 2.0), np.cos(yaw / 2.0)]),
    )


def chassis(plan: Plan) -> FloatArray:
    """Give the corners of the robot seen from above, shape (4, 2) [m]."""
    urdf = read_urdf(plan.robot.path(), plan.robot.package_folders())
    box = next(
        shape
        for link in urdf.links.values()
        for shape in link.collision
        if isinstance(shape, ShapeConfig) and shape.size is not None
    )
    assert box.size is not None
    half, middle = np.array(box.size[:2]) / 2.0, np.array(box.xyz[:2])
    corners: FloatArray = middle + half * np.array(
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
    )
    return corners
